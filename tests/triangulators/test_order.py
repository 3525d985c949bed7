from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from harness.frame import View, make_frame
from harness.rasterisers.vertex_batches import count_batches
from scenes import load
from tests.ports.polygons import earcut_rings
from tests.triangulators.cases import hard_polygons, smooth, star, with_hole
from triangulators import (
    UnknownNameError,
    dropin,
    flip,
    triangulate,
    triangulate_many,
    triangulate_with_gap,
    vertices,
)
from triangulators.geometry.order import (
    CACHE_SIZE,
    ORDERS,
    put_in_walk_order,
    sort_for_vertex_cache,
)

BATCH = 120
"""Number of indices in a batch of the simulated GPU, which shades a vertex once per batch."""


def count_shaded(triangles: np.ndarray) -> int:
    """Return the number of shaded vertices if each is shaded once in every batch of indices."""
    indices = triangles.ravel()
    return sum(len(np.unique(indices[i : i + BATCH])) for i in range(0, len(indices), BATCH))


def normalise(triangles: np.ndarray) -> list[tuple[int, ...]]:
    """Return the triangles, rotated to begin with their lowest vertex, sorted."""
    rows = triangles.tolist()
    return sorted(min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in rows)


@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(*[st.integers(0, 9)] * 3), max_size=30))
def test_walk_permutes_triangles(rows):
    triangles = np.array(rows, np.int32).reshape(-1, 3)
    ordered = put_in_walk_order(triangles, 10)
    assert normalise(ordered) == normalise(triangles)


@settings(deadline=None, max_examples=40)
@given(hard_polygons())
def test_walk_visits_neighbours_consecutively(polygon):
    triangles = triangulate(polygon, "delaunay")
    shuffled = np.random.default_rng(0).permutation(triangles)
    ordered = put_in_walk_order(shuffled, len(vertices(polygon)))
    edges: set[frozenset[int]] = set()
    met: set[int] = set()
    for number, (a, b, c) in enumerate(ordered.tolist()):
        edges_of_triangle = {frozenset((a, b)), frozenset((b, c)), frozenset((c, a))}
        assert number == 0 or edges_of_triangle & edges
        assert number == 0 or {a, b} <= met
        edges |= edges_of_triangle
        met |= {a, b, c}
    assert normalise(ordered) == normalise(triangles)


@pytest.mark.parametrize("name", ["optimal:overdraw", "optimal:half-perimeter", "optimal:shape"])
def test_optimum_is_in_walk_order(name):
    rng = np.random.default_rng(1)
    for polygon in (star(400, spread=0.4), smooth(90), with_hole(rng, 14, 6)):
        triangles = triangulate(polygon, name)
        assert np.array_equal(triangles, put_in_walk_order(triangles, len(vertices(polygon))))


@pytest.mark.parametrize("name", ["ear-clipping", "delaunay", "flips", "flips:shape", "refined"])
def test_order_of_all_interfaces(name):
    rng = np.random.default_rng(4)
    polygons = [star(90, seed, spread=0.4) for seed in range(5)] + [with_hole(rng, 14, 6)]
    polygons.append(Polygon([(0, 0), (1, 0), (2, 0), (2, 2), (0, 2)]))  # earcut drops a vertex
    batches = {order: triangulate_many(polygons, name, order=order) for order in (*ORDERS, None)}
    moved = 0
    for index, polygon in enumerate(polygons):
        native, ordered, default = (batches[order][index] for order in (*ORDERS[::-1], None))
        assert np.array_equal(ordered, put_in_walk_order(native, len(vertices(polygon))))
        assert np.array_equal(default, native if name in ("ear-clipping", "delaunay") else ordered)
        assert np.array_equal(default, triangulate_with_gap(polygon, name)[0])
        for order in ORDERS:
            single = triangulate(polygon, name, order=order)
            assert np.array_equal(single, batches[order][index])
        moved += not np.array_equal(native, ordered)
    assert (moved > 3) == (name != "refined")


def test_dropin_and_flip_have_both_orders():
    polygon = star(90, spread=0.4)
    points, ends = earcut_rings(polygon)
    raw = triangulate(polygon, "ear-clipping")
    for order in ORDERS:
        expected = triangulate(polygon, "flips:l1", order=order)
        assert np.array_equal(flip(points, raw, order=order), expected)
        result = dropin.triangulate_float64(points, ends, order=order)
        assert np.array_equal(result.reshape(-1, 3), expected)
    native = flip(points, raw, order="native")
    assert np.array_equal(flip(points, raw), put_in_walk_order(native, len(points)))


def test_unknown_order_is_refused():
    polygon = star(9)
    message = "unknown order 'best'; known: walk, native"
    for call in (
        lambda: triangulate(polygon, "delaunay", order="best"),
        lambda: triangulate_many([polygon], "flips", order="best"),
        lambda: flip(vertices(polygon), triangulate(polygon, "fan"), order="best"),
        lambda: dropin.triangulate_float64(*earcut_rings(polygon), order="best"),
    ):
        with pytest.raises(UnknownNameError, match=message):
            call()


@pytest.mark.parametrize(
    "scene", ["city", "glyphs", "cad", "helsinki", "stress", "counties:level=state"]
)
def test_shipped_orders_need_no_more_vertex_batches_than_ear_clipping(scene, tmp_path):
    polygons = make_frame(load(scene).polygons, View(1024)).polygons
    # Optima of large polygons with holes take seconds.
    polygons = polygons.take(np.flatnonzero(polygons.vertex_counts <= 200).tolist())
    limit = count_scene_batches(polygons, triangulate_many(polygons, "ear-clipping"))
    flips = [f"flips:{by}" for by in ("l1", "euclidean", "delaunay", "expected-quads")]
    for name in ("optimal:half-perimeter", "refined", "earcut-refine", *flips):
        assert count_scene_batches(polygons, triangulate_many(polygons, name)) <= limit, name
    native = triangulate_many(polygons, "flips", order="native")
    assert count_scene_batches(polygons, native) > limit


def count_scene_batches(polygons, triangulations):
    """Return the vertex batches of all triangles, in one index buffer."""
    assert not triangulations.failed
    first = np.repeat(polygons.vertex_offsets[:-1], np.diff(triangulations.triangle_offsets))
    return count_batches((triangulations.triangles + first[:, None]).astype(np.int32))[0]


def test_walk_shades_few_vertices_again():
    rng = np.random.default_rng(2)
    for polygon in (star(400, spread=0.4), smooth(300)):
        n = len(vertices(polygon))
        shuffled = rng.permutation(triangulate(polygon, "delaunay"))
        batches = -(-3 * len(shuffled) // BATCH)
        shaded = count_shaded(put_in_walk_order(shuffled, n))
        # At most two vertices of each of log2(m) waiting edges, at the start of each batch.
        assert shaded <= n + batches * 2 * np.log2(len(shuffled))
        assert count_shaded(shuffled) > 1.5 * shaded


def test_batches_shade_few_vertices_again():
    rng = np.random.default_rng(3)
    polygons = [star(150, seed, spread=0.4) for seed in range(3)] + [with_hole(rng, 14, 6)]
    for polygon, triangles in zip(polygons, triangulate_many(polygons), strict=True):
        n = len(vertices(polygon))
        assert count_shaded(triangles) <= n + 10 * 2 * np.log2(len(triangles))


def count_misses(triangles, size):
    """Return the number of misses of a first-in first-out cache of `size` vertices."""
    cache, missed = deque(maxlen=size), 0
    for vertex in np.asarray(triangles).ravel().tolist():
        if vertex not in cache:
            cache.append(vertex)
            missed += 1
    return missed


def grid(side):
    corner = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    low = np.column_stack([corner, corner + 1, corner + side])
    high = np.column_stack([corner + 1, corner + side + 1, corner + side])
    return np.concatenate([low, high]).astype(np.int32), side * side


@given(st.integers(0, 60), st.integers(3, 40), st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_vertex_cache_order_permutes_triangles(number, count, cache_size, seed):
    rng = np.random.default_rng(seed)
    triangles = rng.integers(0, count, (number, 3)).astype(np.int32)
    ordered = sort_for_vertex_cache(triangles, count, cache_size)
    assert sorted(map(tuple, ordered)) == sorted(map(tuple, triangles))
    assert np.array_equal(ordered, sort_for_vertex_cache(triangles, count, cache_size))


@pytest.mark.parametrize("side", [20, 60])
def test_a_shuffled_grid_shades_few_vertices_twice(side):
    triangles, count = grid(side)
    shuffled = np.random.default_rng(1).permutation(triangles)
    misses = count_misses(sort_for_vertex_cache(shuffled, count), CACHE_SIZE) / len(triangles)
    # A large grid has half as many vertices as triangles: no order is below 0.5.
    assert 0.5 <= misses < 0.8
    assert count_misses(shuffled, CACHE_SIZE) / len(triangles) > 2.5


def test_a_fan_shades_each_vertex_once():
    triangles = np.array([[0, k, k + 1] for k in range(1, 30)], np.int32)
    shuffled = np.random.default_rng(2).permutation(triangles)
    # Around the centre all triangles are given at once; the centre itself must stay in the cache.
    assert count_misses(sort_for_vertex_cache(shuffled, 31, 64), 64) == 31
