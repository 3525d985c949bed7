"""A second run reads the triangulations of the first, reports that, and verifies them."""

import importlib.metadata
import io
import re
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from harness.frame import View, make_frame
from harness.measuring.run import RunOptions, run
from harness.progress import Reporter
from harness.results.run_folder import read_run
from harness.triangulating import database as database_module
from harness.triangulating import triangulate
from harness.triangulating.database import MIN_CACHED_S, CacheLookup, ModelDatabase
from harness.triangulating.recipes import Recipe, parse
from harness.triangulating.triangulate import triangulate_polygons
from scenes import load
from tests.conftest import require_ok
from tests.harness.test_cli import MOCK
from tests.measuring.test_run import inline, make_plan, quiet, skip_batch
from tests.mock import Clock
from tests.records import get_rows
from triangulators import PolygonArray, vertices

pytestmark = pytest.mark.usefixtures("no_plots", "in_process")


def triangulate_named(name, polygons, seed=0, calibration=None, database=None):
    recipe = parse(name, seed=seed, calibration=calibration)
    return triangulate_polygons(recipe, polygons, database)


POLYGONS = make_frame(load("stress:vertices=150").polygons, View(512)).polygons
NAMES = ("delaunay", "optimal:half-perimeter", "optimal:calibrated", "random#3", "exhaustive:shape")


@pytest.fixture
def database(tmp_path) -> Path:
    return tmp_path / "model.sqlite"


@pytest.fixture(autouse=True)
def _cache_everything(monkeypatch):
    monkeypatch.setattr(database_module, "MIN_CACHED_S", 0.0)


def act_before(monkeypatch, name, action) -> None:
    """Call an action with the recipe before each call of a method."""
    method = getattr(Recipe, name)

    def call(recipe, polygons):
        action(recipe)
        return method(recipe, polygons)

    monkeypatch.setattr(Recipe, name, call)


@pytest.fixture
def computed(monkeypatch) -> list[str]:
    """Names of called triangulators, one per polygon, without warm-up."""
    calls: list[str] = []
    act_before(monkeypatch, "triangulate_with_gap", lambda recipe: calls.append(str(recipe)))
    monkeypatch.setattr(Recipe, "triangulate_batch", skip_batch)
    monkeypatch.setattr(triangulate, "warm_up", lambda _: None)
    return calls


@pytest.mark.parametrize("name", NAMES)
def test_a_second_run_reads_the_first_ones_triangulations(database, computed, name):
    first = triangulate_named(name, POLYGONS, database=database)
    assert len(computed) == len(POLYGONS)
    computed.clear()
    second = triangulate_named(name, POLYGONS, database=database)
    done = sum(part is not None for part in first.parts)
    assert (first.cached, second.cached) == (0, done)
    # skipped and failed polygons are computed again, with the same reasons
    assert len(computed) == len(POLYGONS) - done
    assert (second.skipped, second.failed) == (first.skipped, first.failed)
    for one, other in zip(first.parts, second.parts, strict=True):
        assert (one is None) == (other is None)
        assert one is None or (one == other).all()
    assert second.t_junctions == first.t_junctions
    # the stored time is the time of computing, not of reading
    if done == len(POLYGONS):
        assert second.seconds == pytest.approx(first.seconds, rel=1e-9)


@pytest.mark.parametrize("base", ["pareto", "listed", "random"])
def test_each_number_has_separate_entries(database, base):
    """The number decides the triangulation, so entries of other numbers must not be read."""
    polygons = make_frame(load("paper").polygons, View(512)).polygons
    names = [f"{base}#{k}" for k in range(3)]
    computed = [triangulate_named(name, polygons) for name in names]
    for _ in range(2):
        for name, expected in zip(names, computed, strict=True):
            (part,) = triangulate_named(name, polygons, database=database).parts
            (other,) = expected.parts
            assert (part is None) == (other is None)
            assert part is None or np.array_equal(part, other)


@pytest.fixture
def clock(monkeypatch) -> Clock:
    """A clock that only `spend` advances, in place of the triangulators' clock."""
    fake_clock = Clock()
    monkeypatch.setattr(triangulate, "cpu_clock", fake_clock)
    return fake_clock


@pytest.mark.parametrize(("seconds", "count"), [(0.9 * MIN_CACHED_S, 0), (1.1 * MIN_CACHED_S, 4)])
def test_quickly_computed_triangulations_are_not_stored(
    database, monkeypatch, clock, seconds, count
):
    small = make_frame(load("city:buildings=4").polygons, View(512)).polygons
    monkeypatch.setattr(database_module, "MIN_CACHED_S", MIN_CACHED_S)
    act_before(monkeypatch, "triangulate_with_gap", lambda _: clock.spend(seconds))
    monkeypatch.setattr(Recipe, "triangulate_batch", skip_batch)
    triangulate_named("ear-clipping", small, database=database)
    with ModelDatabase(database) as model:
        assert model.count_entries().get("ear-clipping", (0,))[0] == count


def test_other_parameters_have_other_entries(database, computed):
    two_polygons = POLYGONS[:2]
    weights = {"draw": 1.0, "triangles": 1.0, "area": 0.5, "half_perimeter": 2.0}
    asked = [
        ("random", 1, None),
        ("random", 2, None),
        ("optimal:overdraw", 0, None),
        ("optimal:calibrated", 0, None),
        ("optimal:calibrated", 0, weights),
        ("optimal:calibrated", 0, {**weights, "half_perimeter": 3.0}),
    ]
    for name, seed, calibration in asked:
        assert triangulate_named(name, two_polygons, seed, calibration, database).cached == 0
    computed.clear()
    for name, seed, calibration in asked:
        assert triangulate_named(name, two_polygons, seed, calibration, database).cached == 2
    # neither depends on the run's seed, and the cost of a draw is not part of a criterion
    assert triangulate_named("random#2", two_polygons, 7, None, database).cached == 2
    assert triangulate_named("optimal:overdraw", two_polygons, 7, None, database).cached == 2
    changed = {**weights, "draw": 9.0}
    assert triangulate_named("optimal:calibrated", two_polygons, 0, changed, database).cached == 2
    assert computed == []


def test_another_version_computes_again(database, monkeypatch):
    triangulate_named("delaunay", POLYGONS[:2], database=database)
    monkeypatch.setattr(database_module, "get_triangulators_version", lambda: "another")
    assert triangulate_named("delaunay", POLYGONS[:2], database=database).cached == 0


def test_another_processor_reads_the_entries_and_reports_their_times(database, monkeypatch):
    monkeypatch.setattr(Recipe, "triangulate_batch", skip_batch)
    first = triangulate_named("delaunay", POLYGONS[:2], database=database)
    assert triangulate_named("delaunay", POLYGONS[:2], database=database).notes == []
    monkeypatch.setattr(database_module, "describe_processor", lambda: {"name": "another"})
    second = triangulate_named("delaunay", POLYGONS[:2], database=database)
    assert (second.cached, second.seconds) == (2, pytest.approx(first.seconds))
    (note,) = second.notes
    assert "model database: 2 triangulations by delaunay were timed on another processor" in note


@pytest.mark.parametrize(
    ("name", "matters"), [("numpy", False), ("shapely", True), ("highspy", True)]
)
def test_only_versions_of_libraries_that_compute_triangles_matter(monkeypatch, name, matters):
    """A database can be copied to a machine with another NumPy."""
    version = database_module.get_triangulators_version.__wrapped__
    before, find, changed = version(), importlib.metadata.version, {name: "99"}
    monkeypatch.setattr(importlib.metadata, "version", lambda n: changed.get(n) or find(n))
    assert (version() != before) == matters


def test_third_party_triangulations_are_not_stored(database):
    name = "tests.broken:triangulate_clockwise"
    assert triangulate_named(name, POLYGONS[:2], database=database).failed == []
    assert not database.exists()


def test_invalid_entries_are_computed_again(database):
    polygon = POLYGONS[0]
    good = triangulate_named("delaunay", [polygon], database=database)
    with CacheLookup(database, "delaunay", {}) as model:
        model.find(PolygonArray.from_shapely([polygon]))
        assert good.parts[0] is not None
        # an intact entry, but not a triangulation of the polygon
        model.store(0, good.parts[0][1:], 1.0)
    result = triangulate_named("delaunay", [polygon], database=database)
    assert (result.cached, result.failed) == (0, [])
    assert result.parts[0] is not None
    assert (result.parts[0] == good.parts[0]).all()
    assert triangulate_named("delaunay", [polygon], database=database).cached == 1


def test_entries_are_written_at_once(database):
    with CacheLookup(database, "delaunay", {}) as model:
        model.find(POLYGONS[:1])
        model.store(0, np.array([[0, 1, 2]], dtype=np.int32), 1.0)
        with ModelDatabase(database) as other:  # as after a kill
            assert other.count_entries()["delaunay"][0] == 1


def test_a_run_reports_the_number_of_cached_polygons(block, database, tmp_path, monkeypatch):
    monkeypatch.setattr(Recipe, "triangulate_batch", skip_batch)
    plan = make_plan(block)
    options = RunOptions(database=database)
    warnings = io.StringIO()
    reporter = Reporter(quiet=True, console=Console(file=warnings))
    runs = [
        get_rows(run(plan, tmp_path / str(n), reporter, options, open_worker=inline))
        for n in range(2)
    ]
    cached = [[record["polygons_cached"] for record in rows] for rows in runs]
    assert cached == [[0] * len(runs[0]), [3] * len(runs[1])], warnings.getvalue()
    for first, second in zip(*runs, strict=True):
        for record in (first, second):
            rounds = record.get("triangulate_samples_s") or [first["triangulate_s"]]
            assert record["triangulate_s"] == pytest.approx(np.median(rounds), rel=1e-5)
        for name in ("key", "triangles", "predicted", "counters", "conforming", "coverage_error"):
            assert first[name] == second[name]
    plain = get_rows(run(plan, tmp_path / "plain", quiet(), open_worker=inline))
    assert [record["polygons_cached"] for record in plain] == [0] * len(plain)


@pytest.fixture
def own_database(monkeypatch, tmp_path) -> Path:
    path = tmp_path / "own" / "model.sqlite"
    monkeypatch.setenv("RASTER_HARNESS_CACHE", str(path))
    return path


SPIRAL = ("run", "--scene", "stress:family=spiral,vertices=400", *MOCK)


def cached_of(folder: str) -> int:
    (record,) = get_rows(read_run(Path(folder)))
    return record["polygons_cached"]


def test_no_cache_bypasses_the_database(harness, own_database):
    arguments = (*SPIRAL, "--triangulators", "greedy")
    assert harness(*arguments, "--out", "none", "--no-cache")[0] == 0
    assert not own_database.exists()
    for folder, expected in (("first", 0), ("second", 1)):
        assert harness(*arguments, "--out", folder)[0] == 0
        assert cached_of(folder) == expected
    assert harness(*arguments, "--out", "without", "--no-cache")[0] == 0
    assert cached_of("without") == 0


def test_damage_is_reported_and_the_run_continues(harness, own_database):
    ModelDatabase(own_database).close()
    own_database.write_bytes(b"this is no database" * 50)
    _, err = require_ok(harness(*SPIRAL, "--triangulators", "greedy,delaunay", "--out", "run"))
    assert len(re.findall(r": damaged \(", err)) == 1


def test_an_unwritable_folder_is_reported_once(harness, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("x")
    monkeypatch.setenv("RASTER_HARNESS_CACHE", str(tmp_path / "file" / "model.sqlite"))
    _, err = require_ok(harness(*SPIRAL, "--triangulators", "greedy,delaunay", "--out", "run"))
    assert len(re.findall("cannot be opened.*continuing without the cache", err)) == 1


def test_times_exclude_loading(monkeypatch, clock):
    """The time of loading compiled code does not count, for any kind of polygon."""
    calls: list[int] = []

    def slow_at_first(_recipe, polygon):
        kind = min(len(polygon.interiors), 2), len(vertices(polygon)) > 160
        if kind not in calls:
            calls.append(kind)
            clock.spend(0.05)
        clock.spend(1e-3)
        raise RuntimeError

    monkeypatch.setattr(triangulate, "_warm", set())
    monkeypatch.setattr(Recipe, "triangulate_with_gap", slow_at_first)
    result = triangulate_named("delaunay", POLYGONS, 0)
    assert result.seconds == pytest.approx(1e-3 * len(POLYGONS))


def test_a_batch_is_timed_as_a_unit(monkeypatch, clock):
    small = make_frame(load("city:buildings=9").polygons, View(512)).polygons

    def spent(recipe, polygon):
        clock.spend(9.0)
        raise AssertionError

    expected = triangulate_named("optimal:half-perimeter", small)
    triangulate.warm_up(parse("optimal:half-perimeter"))
    act_before(monkeypatch, "triangulate_batch", lambda _: clock.spend(0.25))
    monkeypatch.setattr(Recipe, "triangulate_with_gap", spent)
    result = triangulate_named("optimal:half-perimeter", small)
    assert result.seconds == 0.25
    assert not result.failed
    assert result.gaps == [0.0] * len(small)
    for one, other in zip(result.parts, expected.parts, strict=True):
        assert np.array_equal(one, other)
