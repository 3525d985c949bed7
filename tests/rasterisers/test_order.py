import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.errors import UsageError
from harness.rasterisers import Options
from harness.rasterisers.base import ORDERS, order_submission
from tests.rasterisers.conftest import loose_triangles, random_triangles
from triangulators.geometry.order import put_in_walk_order, sort_for_vertex_cache


@settings(deadline=None)
@given(st.integers(0, 60), st.sampled_from(ORDERS), st.integers(0, 2**32))
def test_orders_permute_triangles_without_changing_them(number, order, seed):
    frame, triangles = random_triangles(seed=1, size=512, number=max(number, 1), grid=1)
    triangles = triangles[:number]
    case = (frame, triangles, Options(order=order, seed=seed))
    ordered, again = (order_submission(*case) for _ in range(2))
    assert sorted(map(tuple, ordered)) == sorted(map(tuple, triangles))
    assert np.array_equal(ordered, again)


def test_native_order_is_unchanged_and_seeds_differ():
    frame, triangles = random_triangles(seed=1, size=512, number=60, grid=1)
    assert np.array_equal(order_submission(frame, triangles, Options()), triangles)
    options = (Options(order="shuffled", seed=seed) for seed in (1, 2))
    one, two = (order_submission(frame, triangles, shuffled) for shuffled in options)
    assert not np.array_equal(one, two)


@pytest.mark.parametrize(
    ("order", "reorder"),
    [("walk", put_in_walk_order), ("vertex-cache", sort_for_vertex_cache)],
)
def test_orders_by_neighbours_are_those_of_their_functions(order, reorder):
    frame, _ = random_triangles(seed=1, size=512, number=60, grid=1)
    first = np.random.default_rng(0).permutation(len(frame.points) - 2).astype(np.int32)
    strip = np.column_stack([first, first + 1, first + 2])
    ordered = order_submission(frame, strip, Options(order=order))
    assert np.array_equal(ordered, reorder(strip, len(frame.points)))


def test_morton_order_visits_quadrant_after_quadrant():
    corners = []
    for column, row in [(1, 1), (0, 0), (3, 2), (0, 1), (2, 0), (1, 0), (0, 3)]:
        x, y = column * 64 * 256, row * 64 * 256
        corners += [[x, y], [x + 512, y], [x, y + 512]]
    frame, triangles = loose_triangles(corners, 256)
    ordered = order_submission(frame, triangles, Options(order="morton"))
    places = [tuple(frame.points[first] // (64 * 256)) for first in ordered[:, 0]]
    assert places == [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 3), (3, 2)]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"order": "mortan"}, "unknown order 'mortan'; did you mean 'morton'"),
        ({"samples": 2}, r"unsupported 2 samples per pixel \(choose from 1, 4, 8\)"),
        ({"work": -1}, r"work -1 is out of range \(0 to 65000"),
        ({"work": 100_000}, "out of range"),
    ],
)
def test_invalid_options_are_refused(wrong, message):
    with pytest.raises(UsageError, match=message):
        Options(**wrong)
