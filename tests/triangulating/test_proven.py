"""How many polygons an optimum is proven for, as they are computed and as they are read."""

from __future__ import annotations

import math

import numpy as np
import pytest
from shapely import Polygon, box

from harness.frame import View, make_frame
from harness.measuring import records
from harness.triangulating import database as store
from harness.triangulating.frames import FrameTriangulation, triangulate_polygons
from harness.triangulating.recipes import Recipe, parse
from tests.measuring.test_run import nothing_at_once
from triangulators.certificate import proof
from triangulators.methods import optimal


def ring(n: int, radius: float, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    turn = 2 * np.pi * (np.arange(n) + random.uniform(-0.3, 0.3, n)) / n
    reach = radius * random.uniform(0.9, 1.0, n)
    return 200 + reach[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])


@pytest.fixture(scope="module")
def polygons() -> list[Polygon]:
    holed = Polygon(ring(130, 190, 1), [ring(80, 90, 2)])
    return make_frame([box(0, 0, 9, 9), holed, box(300, 300, 320, 310)], View(512)).polygons


@pytest.fixture
def apart(monkeypatch):
    """Let no skeleton connect the rings, and let the linear program not be asked."""
    monkeypatch.setattr(proof, "cuts_of", lambda *_: None)
    monkeypatch.setattr(optimal, "PROVEN", 0)


def cut(name: str, polygons: list[Polygon], database=None) -> FrameTriangulation:
    return triangulate_polygons(parse(name), polygons, database)


def test_an_optimum_is_proven_and_others_say_nothing(polygons):
    assert cut("optimal:half-perimeter", polygons).gaps == [0.0, 0.0, 0.0]
    for name in ("delaunay", "refined", "worst:half-perimeter"):
        assert cut(name, polygons).gaps == []


def test_what_a_search_found_is_not_called_proven(polygons, apart):
    gaps = cut("optimal:half-perimeter", polygons).gaps
    assert [gaps[0], gaps[2]] == [0.0, 0.0]
    assert gaps[1] > 0.0


def test_what_is_read_is_as_proven_as_what_was_computed(polygons, tmp_path, monkeypatch):
    monkeypatch.setattr(store, "KEEP_S", 0.0)
    monkeypatch.setattr(Recipe, "attempt", nothing_at_once)
    database = tmp_path / "kept.sqlite"
    first = cut("optimal:half-perimeter", polygons, database)
    again = cut("optimal:half-perimeter", polygons, database)
    assert (first.cached, again.cached) == (0, 3)
    assert again.gaps == first.gaps == [0.0, 0.0, 0.0]


def test_what_is_not_proven_is_computed_again(polygons, tmp_path, monkeypatch, apart):
    monkeypatch.setattr(store, "KEEP_S", 0.0)
    monkeypatch.setattr(Recipe, "attempt", nothing_at_once)
    database = tmp_path / "kept.sqlite"
    cut("optimal:half-perimeter", polygons, database)
    again = cut("optimal:half-perimeter", polygons, database)
    assert again.cached == 2
    assert again.gaps[1] > 0.0


@pytest.mark.parametrize(
    ("gaps", "told"),
    [
        ([], {}),
        ([0.0, 0.0], {"proven": 2, "largest_gap": 0.0}),
        ([0.0, 0.25], {"proven": 1, "largest_gap": 0.25}),
        ([0.0, math.inf], {"proven": 1, "largest_gap": None}),
    ],
)
def test_a_record_says_how_many_are_proven(gaps, told):
    assert records.proven_of(gaps) == told
