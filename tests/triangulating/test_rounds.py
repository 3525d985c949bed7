"""Triangulating timed in rounds: every triangulator in each, what is too slow left out."""

from __future__ import annotations

import numpy as np
import pytest
from shapely import box

from harness.measuring.processes import FEWEST_ROUNDS, MOST_ROUNDS, Bench
from harness.triangulating import frames
from harness.triangulating.recipes import parse
from tests.inline import Inline

POLYGONS = [box(k, 0, k + 1, 1) for k in range(3)]
RECIPES = [parse("ear-clipping"), parse("fan")]


@pytest.fixture
def calls(monkeypatch):
    """The names of triangulators in the order in which they were timed, and no others' time."""
    found = []

    def batch(recipe, polygons, result):
        found.append(str(recipe))
        result.seconds += len(found)
        return dict.fromkeys(range(len(polygons)))

    monkeypatch.setattr(frames, "_batch", batch)
    monkeypatch.setattr(frames, "warm_up", lambda *_: None)
    return found


def test_each_round_has_every_triangulator_once_in_changing_order(calls):
    samples = frames.time_in_rounds(RECIPES, POLYGONS, 12, seed=0)
    pairs = [tuple(calls[2 * k : 2 * k + 2]) for k in range(12)]
    assert all(sorted(pair) == ["ear-clipping", "fan"] for pair in pairs)
    assert len(set(pairs)) == 2
    by_round = np.array(samples)
    assert by_round.shape == (2, 12)
    # a call's time stands with its triangulator and its round
    assert sorted(by_round.ravel()) == list(range(1, 25))
    assert (np.abs(by_round[0] - by_round[1]) == 1).all()


def test_what_a_batch_leaves_is_timed_one_by_one(monkeypatch):
    seen = []
    monkeypatch.setattr(frames, "_batch", lambda recipe, polygons, result: {0: None})
    monkeypatch.setattr(frames, "_seconds_of", lambda recipe, polygon: seen.append(polygon) or 0.5)
    assert frames.time_in_rounds(RECIPES[:1], POLYGONS, 5, seed=0) == [[1.0] * 5]
    assert seen[:2] == POLYGONS[1:]


@pytest.mark.parametrize(
    ("seconds", "rounds"), [(1e-6, MOST_ROUNDS), (0.04, 8), (0.4, FEWEST_ROUNDS), (0.6, 0)]
)
def test_a_budget_gives_the_rounds_and_leaves_out_what_is_too_slow(seconds, rounds):
    bench = Bench(lambda *_: Inline(), 60.0, None)
    once = dict.fromkeys(RECIPES, seconds)
    found = bench.time_triangulating(once, POLYGONS, 1.0, 0)
    bench.close()
    assert {recipe: len(samples) for recipe, samples in found.items()} == (
        dict.fromkeys(RECIPES, rounds) if rounds else {}
    )
