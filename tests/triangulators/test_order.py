"""The order of triangles: all of them, neighbours together, the new vertex last."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.triangulators.cases import hard_polygons, smooth, star, with_hole
from triangulators import triangulate, triangulate_many, vertices
from triangulators.geometry.order import walk

BATCH = 120
"""Indices after which a drawing program may start anew, and meets its vertices again."""


def invocations(triangles: np.ndarray) -> int:
    """Vertices shaded, if each is shaded once in every batch of indices."""
    indices = triangles.ravel()
    return sum(len(np.unique(indices[i : i + BATCH])) for i in range(0, len(indices), BATCH))


def turned(triangles: np.ndarray) -> list[tuple[int, ...]]:
    """Return the triangles, each turned to begin with its lowest vertex, in order of number."""
    rows = triangles.tolist()
    return sorted(min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in rows)


@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(*[st.integers(0, 9)] * 3), max_size=30))
def test_it_is_a_permutation_of_whatever_it_is_given(rows):
    triangles = np.array(rows, np.int32).reshape(-1, 3)
    ordered = walk(triangles, 10)
    assert turned(ordered) == turned(triangles)


@settings(deadline=None, max_examples=40)
@given(hard_polygons())
def test_neighbours_follow_each_other(polygon):
    triangles = triangulate(polygon, "delaunay")
    ordered = walk(np.random.default_rng(0).permutation(triangles), len(vertices(polygon)))
    edges: set[frozenset[int]] = set()
    met: set[int] = set()
    for number, (a, b, c) in enumerate(ordered.tolist()):
        own = {frozenset((a, b)), frozenset((b, c)), frozenset((c, a))}
        assert number == 0 or own & edges
        assert number == 0 or {a, b} <= met
        edges |= own
        met |= {a, b, c}
    assert turned(ordered) == turned(triangles)


@pytest.mark.parametrize("name", ["optimal:overdraw", "optimal:half-perimeter", "optimal:shape"])
def test_the_optimum_comes_in_this_order(name):
    rng = np.random.default_rng(1)
    for polygon in (star(400, spread=0.4), smooth(90), with_hole(rng, 14, 6)):
        triangles = triangulate(polygon, name)
        assert np.array_equal(triangles, walk(triangles, len(vertices(polygon))))


def test_few_vertices_are_met_again():
    rng = np.random.default_rng(2)
    for polygon in (star(400, spread=0.4), smooth(300)):
        n = len(vertices(polygon))
        shuffled = rng.permutation(triangulate(polygon, "delaunay"))
        batches = -(-3 * len(shuffled) // BATCH)
        # At most two vertices of each of log2(m) waiting edges, at the start of each batch.
        assert invocations(walk(shuffled, n)) <= n + batches * 2 * np.log2(len(shuffled))
        assert invocations(shuffled) > 1.5 * invocations(walk(shuffled, n))


def test_batches_keep_to_it_too():
    rng = np.random.default_rng(3)
    polygons = [star(150, seed, spread=0.4) for seed in range(3)] + [with_hole(rng, 14, 6)]
    for polygon, triangles in zip(polygons, triangulate_many(polygons), strict=True):
        n = len(vertices(polygon))
        assert isinstance(polygon, shapely.Polygon)
        assert invocations(triangles) <= n + 10 * 2 * np.log2(len(triangles))
