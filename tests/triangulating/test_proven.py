import math
import pickle

import numpy as np
import pytest
import shapely
from shapely import Polygon, box

from harness.frame import View, make_frame
from harness.measuring import records
from harness.measuring.pool import MAX_ROUNDS, MIN_ROUNDS, MeasuringPool
from harness.settings import DEFAULT_TRIANGULATORS
from harness.triangulating import database as database_module
from harness.triangulating import triangulate
from harness.triangulating.recipes import Recipe, parse, parse_all
from harness.triangulating.triangulate import FrameTriangulation, triangulate_polygons
from scenes import load
from tests.inline import InlineWorker
from tests.measuring.test_run import skip_batch
from tests.mock import Clock
from triangulators.certificate import proof
from triangulators.methods import optimal
from triangulators.polygon_arrays import PolygonArray


def ring(n: int, radius: float, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    turn = 2 * np.pi * (np.arange(n) + random.uniform(-0.3, 0.3, n)) / n
    reach = radius * random.uniform(0.9, 1.0, n)
    return 200 + reach[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])


@pytest.fixture(scope="module")
def polygons() -> list[Polygon]:
    holed = Polygon(ring(130, 190, 1), [ring(80, 90, 2)])
    return make_frame([box(0, 0, 9, 9), holed, box(300, 300, 320, 310)], View(512)).polygons


def triangulate_named(name: str, polygons: list[Polygon], database=None) -> FrameTriangulation:
    return triangulate_polygons(parse(name), polygons, database)


def test_only_optima_have_gaps(polygons):
    assert triangulate_named("optimal:half-perimeter", polygons).gaps == [0.0, 0.0, 0.0]
    for name in ("delaunay", "refined", "worst:half-perimeter"):
        assert triangulate_named(name, polygons).gaps == []


@pytest.mark.parametrize("is_proven", [True, False])
def test_results_are_cached_with_their_gaps(polygons, tmp_path, monkeypatch, is_proven):
    if not is_proven:
        monkeypatch.setattr(proof, "solve_by_bridges", lambda *_: np.empty(0, np.int64))
        monkeypatch.setattr(proof, "solve_skeleton", lambda *_: None)
        monkeypatch.setattr(optimal, "MAX_PROGRAM_VERTICES", 0)
    monkeypatch.setattr(database_module, "MIN_CACHED_S", 0.0)
    monkeypatch.setattr(Recipe, "triangulate_batch", skip_batch)
    first, second = (
        triangulate_named("optimal:half-perimeter", polygons, tmp_path / "kept.sqlite")
        for _ in range(2)
    )
    assert (first.cached, second.cached) == (0, 3)
    assert second.gaps == first.gaps
    assert first.gaps[::2] == [0.0, 0.0]
    assert (first.gaps[1] == 0.0) == is_proven


@pytest.mark.parametrize(
    ("gaps", "expected"),
    [
        ([], (None, None)),
        ([0.0, 0.0], (2, 0.0)),
        ([0.0, 0.25], (1, 0.25)),
        ([0.0, math.inf], (1, None)),
    ],
)
def test_records_have_the_number_of_proven_optima(gaps, expected):
    assert records.summarise_gaps(gaps) == expected


POLYGONS = [box(k, 0, k + 1, 1) for k in range(3)]
RECIPES = [parse("ear-clipping"), parse("fan")]


@pytest.fixture
def calls(monkeypatch):
    """Names of triangulators in the order of timing, without the time of others."""
    names = []

    def batch(recipe, polygons, result):
        names.append(str(recipe))
        result.seconds += len(names)
        return dict.fromkeys(range(len(polygons)))

    monkeypatch.setattr(triangulate, "triangulate_in_batch", batch)
    monkeypatch.setattr(triangulate, "warm_up", lambda *_: None)
    return names


def test_each_round_has_every_triangulator_once_in_changing_order(calls):
    samples = triangulate.time_in_rounds(RECIPES, POLYGONS, 12, seed=0)
    pairs = [tuple(calls[2 * k : 2 * k + 2]) for k in range(12)]
    assert all(sorted(pair) == ["ear-clipping", "fan"] for pair in pairs)
    assert len(set(pairs)) == 2
    by_round = np.array(samples)
    assert by_round.shape == (2, 12)
    # a call's time belongs to its triangulator and round
    assert sorted(by_round.ravel()) == list(range(1, 25))
    assert (np.abs(by_round[0] - by_round[1]) == 1).all()


def test_polygons_outside_a_batch_are_timed_one_by_one(monkeypatch):
    seen, clock = [], Clock()

    def timed(_recipe, polygon):
        seen.append(polygon)
        clock.spend(0.5)
        raise ValueError

    monkeypatch.setattr(triangulate, "cpu_clock", clock)
    monkeypatch.setattr(triangulate, "warm_up", lambda *_: None)
    monkeypatch.setattr(triangulate, "triangulate_in_batch", lambda *_: {0: None})
    monkeypatch.setattr(Recipe, "triangulate_with_gap", timed)
    assert triangulate.time_in_rounds(RECIPES[:1], POLYGONS, 5, seed=0) == [[1.0] * 5]
    assert seen[:2] == POLYGONS[1:]


@pytest.mark.parametrize(
    ("seconds", "rounds"), [(1e-6, MAX_ROUNDS), (0.04, 8), (0.4, MIN_ROUNDS), (0.6, 0)]
)
def test_the_budget_limits_rounds_and_skips_slow_triangulators(seconds, rounds):
    pool = MeasuringPool(lambda *_: InlineWorker(), 60.0, None)
    seconds_by_recipe = dict.fromkeys(RECIPES, seconds)
    times = pool.time_triangulating(seconds_by_recipe, POLYGONS, 1.0, 0)
    pool.close()
    assert {recipe: len(samples) for recipe, samples in times.items()} == (
        dict.fromkeys(RECIPES, rounds) if rounds else {}
    )


def test_polygons_of_a_view_are_converted_twice_for_any_number_of_triangulators(monkeypatch):
    """From shapely for the frame, and to shapely for triangulators that work one by one."""
    conversions = []
    from_shapely, to_shapely = PolygonArray.from_shapely, shapely.from_ragged_array

    def count(name, convert):
        return lambda *arguments: (conversions.append(name), convert(*arguments))[1]

    scene = load("city:buildings=20").polygons
    recipes = parse_all([*DEFAULT_TRIANGULATORS, "flips:l1", "random#1", "greedy"])
    triangulate.warm_up(*recipes)
    monkeypatch.setattr(PolygonArray, "from_shapely", count("arrays", from_shapely))
    monkeypatch.setattr(shapely, "from_ragged_array", count("shapely", to_shapely))
    polygons = pickle.loads(pickle.dumps(make_frame(scene, View(256)))).polygons
    sent = pickle.dumps(polygons)
    for recipe in recipes:  # as in a worker
        result = triangulate_polygons(recipe, pickle.loads(sent))
        assert result.drawn.any()
    triangulate.time_in_rounds(recipes, pickle.loads(sent), 2, seed=0)
    assert conversions == ["arrays", "shapely"]
