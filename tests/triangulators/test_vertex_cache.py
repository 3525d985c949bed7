"""The order for vertex caches: a permutation that shades fewer vertices again."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes import load
from triangulators import triangulate, vertices
from triangulators.geometry.vertex_cache import CACHE_SIZE, vertex_cache_order


def shaded(triangles, size):
    """Return how many vertices a first-in first-out cache of `size` vertices misses."""
    cache, missed = deque(maxlen=size), 0
    for vertex in np.asarray(triangles).ravel().tolist():
        if vertex not in cache:
            cache.append(vertex)
            missed += 1
    return missed


def grid(side):
    """Return the triangles of a square grid of vertices, and how many vertices it has."""
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    low = np.column_stack([corner, corner + 1, corner + side])
    high = np.column_stack([corner + 1, corner + side + 1, corner + side])
    return np.concatenate([low, high]).astype(np.int32), side * side


@settings(deadline=None)
@given(st.integers(0, 60), st.integers(3, 40), st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_it_is_a_permutation_of_any_triangles(number, count, cache_size, seed):
    rng = np.random.default_rng(seed)
    triangles = rng.integers(0, count, (number, 3)).astype(np.int32)
    ordered = vertex_cache_order(triangles, count, cache_size)
    assert sorted(map(tuple, ordered)) == sorted(map(tuple, triangles))
    assert np.array_equal(ordered, vertex_cache_order(triangles, count, cache_size))


@pytest.mark.parametrize("side", [20, 60])
def test_a_shuffled_grid_shades_few_vertices_twice(side):
    triangles, count = grid(side)
    shuffled = np.random.default_rng(1).permutation(triangles)
    misses = shaded(vertex_cache_order(shuffled, count), CACHE_SIZE) / len(triangles)
    # A large grid has half as many vertices as triangles: no order is below 0.5.
    assert 0.5 <= misses < 0.8
    assert shaded(shuffled, CACHE_SIZE) / len(triangles) > 2.5


def test_a_fan_shades_each_vertex_once():
    triangles = np.array([[0, k, k + 1] for k in range(1, 30)], np.int32)
    shuffled = np.random.default_rng(2).permutation(triangles)
    # Around the centre all triangles are given at once; the centre itself must stay in the cache.
    assert shaded(vertex_cache_order(shuffled, 31, 64), 64) == 31


def test_triangulations_of_buildings_shade_each_vertex_hardly_more_than_once():
    for polygon in load("city:buildings=30").polygons:
        triangles = triangulate(polygon, "delaunay")
        count = len(vertices(polygon))
        ordered = vertex_cache_order(np.random.default_rng(3).permutation(triangles), count)
        assert shaded(ordered, CACHE_SIZE) <= 1.25 * count
