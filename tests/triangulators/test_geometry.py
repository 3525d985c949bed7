"""Predicates and visibility against exact arithmetic and shapely."""

import math
from fractions import Fraction

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from scenes import load
from tests.triangulators.cases import diagonals, hard_polygons, random_simple, star, with_hole
from triangulators.geometry.half_edges import (
    find_twins,
    grow_tree,
    replace_tree_triangles,
    unfold_tree,
)
from triangulators.geometry.predicates import orient, twice_area
from triangulators.geometry.visibility import find_visible_sites
from triangulators.initial import find_any_triangulation, make_cycle
from triangulators.polygon import (
    CLOCKWISE,
    COUNTERCLOCKWISE,
    MAX_SIMPLE_VERTICES,
    UNSURE,
    boundary,
    checked_boundary,
    find_ring_orientation,
    make_boundary,
    rings_of,
)
from triangulators.verify import verify


def next_to_line(x, y, up, right, k, m):
    return x, y, x * k + up * 2.0**-52, y * k + right * 2.0**-52, x * m, y * m


doubles = st.floats(-1e9, 1e9, allow_nan=False, allow_subnormal=False)
doubles = doubles.map(lambda value: value if abs(value) > 1e-100 else 0.0)
base, steps, factor = st.floats(0.1, 1.0), st.integers(-3, 3), st.integers(1, 40)
near_line = st.builds(next_to_line, base, base, steps, steps, factor, factor)
signed = st.tuples(st.sampled_from([-1.0, 0.0, 1.0]), st.floats(1e-280, 9.0)).map(math.prod)
denormal = st.integers(-9, 9).map(lambda k: k * 5e-324)
of_doubles, *of_small = (st.tuples(*[each] * 6) for each in (doubles, signed, denormal))
underflowing = st.one_of(*of_small)


def exact_area(*values):
    ax, ay, bx, by, cx, cy = map(Fraction, values)
    return (ax - cx) * (by - cy) - (ay - cy) * (bx - cx)


def exact_sign(*values):
    value = exact_area(*values)
    return (value > 0) - (value < 0)


@settings(max_examples=400, deadline=None)
@given(of_doubles | near_line | underflowing)
@example((0.0, 0.011, 0.0, 0.007, 5e-324, 0.009))  # at a denormal distance from a side
def test_orientation_is_exact(values):
    assert np.sign(orient(*values)) == exact_sign(*values)


@given(near_line)
def test_sliver_area_is_independent_of_first_vertex(values):
    a, b, c = values[:2], values[2:4], values[4:]
    area = float(abs(exact_area(*values)))
    for first, second, third in ((a, b, c), (b, c, a), (c, a, b), (c, b, a)):
        assert twice_area(*first, *second, *third) == pytest.approx(area, rel=1e-11, abs=0.0)


def test_visible_pairs_are_the_diagonals():
    rng = np.random.default_rng(8)
    for _ in range(150):
        polygon = random_simple(rng, int(rng.integers(3, 16)), 12)
        ring = make_cycle(boundary(polygon), "test")
        n = len(ring.cycle)
        tails = np.repeat(np.arange(n), np.diff(ring.start))
        pairs = np.sort(ring.cycle[np.column_stack((tails, ring.target))], axis=1)
        assert {tuple(pair) for pair in pairs.tolist()} == diagonals(polygon), polygon.wkt
        outline = boundary(polygon)
        start = find_any_triangulation(outline)
        everywhere = find_visible_sites(outline.points, start, find_twins(start))
        assert {tuple(pair) for pair in everywhere.tolist()} == diagonals(polygon)


@pytest.mark.parametrize("depth_first", [False, True])
def test_replacing_a_tree_by_its_triangles_changes_nothing(depth_first):
    polygon = star(60)
    outline = boundary(polygon)
    triangles = np.ascontiguousarray(find_any_triangulation(outline))
    twin = find_twins(triangles)
    for root in range(0, 58, 7):
        tree, rows = np.zeros((58, 3), dtype=bool), np.empty(20, dtype=np.int32)
        visited, position_of = np.zeros(58, dtype=bool), np.full(174, -1, dtype=np.int32)
        marks = visited, visited
        assert grow_tree(twin, root, depth_first, root % 3, tree, rows, *marks, 0) == 20
        cycle, local, around = unfold_tree(triangles, twin, tree, root, 20)
        unfolded, before = cycle[local].tolist(), triangles[rows].tolist()
        assert sorted(map(sorted, unfolded)) == sorted(map(sorted, before))
        replace_tree_triangles(triangles, twin, rows, cycle, around, local, position_of)
        assert not visited.any()
        assert (position_of == -1).all()
        assert np.array_equal(twin, find_twins(triangles))
    assert verify(polygon, triangles).conforming


def test_a_tree_contains_few_covered_triangles():
    twin = find_twins(find_any_triangulation(boundary(star(60))))
    tree, rows = np.zeros((58, 3), dtype=bool), np.empty(20, dtype=np.int32)
    covered, visited = np.ones(58, dtype=bool), np.zeros(58, dtype=bool)
    covered[7] = False
    for max_covered in (0, 1, 5):
        tree[:] = False
        size = grow_tree(twin, 7, False, 0, tree, rows, visited, covered, max_covered)
        assert size == 1 + max_covered
        assert not visited.any()


grid = st.tuples(st.integers(0, 6), st.integers(0, 6))


@settings(max_examples=1000, deadline=None)
@given(st.lists(grid, min_size=3, max_size=9), st.sampled_from([1.0, 0.1, 1e-3, 1e6]))
def test_ring_orientation_accepts_only_valid_rings(points, scale):
    polygon = shapely.Polygon(np.array(points, dtype=float) * scale)
    turning = find_ring_orientation(shapely.get_coordinates(polygon))
    if turning != UNSURE:
        assert polygon.is_valid
        assert polygon.exterior.is_ccw == (turning == COUNTERCLOCKWISE)


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(hard_polygons(), st.booleans())
def test_simple_ring_boundary_equals_general_boundary(polygon, backwards):
    if not polygon.is_valid:
        return
    polygon = shapely.reverse(polygon) if backwards else polygon
    quick, general = checked_boundary(polygon), make_boundary(*rings_of(polygon))
    for one, other in zip(quick, general, strict=True):
        assert np.array_equal(one, other)
    for one, other in zip(quick[:4], general[:4], strict=True):
        assert one.dtype == other.dtype
    assert quick.expected_triangles == general.expected_triangles


def test_ring_orientation_accepts_buildings_and_rejects_holes():
    def find(polygon):
        return find_ring_orientation(shapely.get_coordinates(polygon))

    for polygon in load("city").polygons:
        is_small = len(polygon.exterior.coords) <= MAX_SIMPLE_VERTICES + 1
        assert (find(polygon) != UNSURE) == (is_small and not polygon.interiors)
    assert find(shapely.reverse(star(20))) in (COUNTERCLOCKWISE, CLOCKWISE)
    assert find(with_hole(np.random.default_rng(0), 8, 4)) == UNSURE
    assert find(star(MAX_SIMPLE_VERTICES + 1)) == UNSURE
    assert find_ring_orientation(np.empty((0, 2))) == UNSURE


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_ring_orientation_rejects_nan_and_overflow(value):
    ring = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, value), (0.0, 4.0), (0.0, 0.0)])
    assert find_ring_orientation(ring) == UNSURE


def test_boundary_arrays_are_copies():
    outline = boundary(star(12))
    outline.edges[:] = 0
    outline.site[:] = 0
    assert np.array_equal(boundary(star(12)).site, np.arange(12))
    assert len(np.unique(boundary(star(12)).edges)) == 12
