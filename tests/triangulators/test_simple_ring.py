"""What the compiled pass calls a simple ring is a valid polygon, and is read as any other."""

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scenes import load
from tests.triangulators.cases import hard_polygons, star, with_hole
from triangulators.geometry.simple_ring import LEFT, MOST, RIGHT, UNSURE, winding
from triangulators.polygon import boundary, boundary_of_rings, checked_boundary, rings_of

grid = st.tuples(st.integers(0, 6), st.integers(0, 6))


@settings(max_examples=1000, deadline=None)
@given(st.lists(grid, min_size=3, max_size=9), st.sampled_from([1.0, 0.1, 1e-3, 1e6]))
def test_only_valid_rings_pass(points, scale):
    polygon = shapely.Polygon(np.array(points, dtype=float) * scale)
    turning = winding(shapely.get_coordinates(polygon))
    if turning != UNSURE:
        assert polygon.is_valid
        assert polygon.exterior.is_ccw == (turning == LEFT)


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(hard_polygons(), st.booleans())
def test_the_boundary_is_the_one_of_the_general_way(polygon, backwards):
    if not polygon.is_valid:
        return
    polygon = shapely.reverse(polygon) if backwards else polygon
    quick, general = checked_boundary(polygon), boundary_of_rings(*rings_of(polygon))
    for one, other in zip(quick, general, strict=True):
        assert np.array_equal(one, other)
    for one, other in zip(quick[:4], general[:4], strict=True):
        assert one.dtype == other.dtype
    assert quick.expected_triangles == general.expected_triangles


def test_buildings_pass_and_what_is_no_single_ring_does_not():
    passed = [winding(shapely.get_coordinates(p)) for p in load("city").polygons]
    simple = [not p.interiors and len(p.exterior.coords) <= MOST + 1 for p in load("city").polygons]
    assert [turning != UNSURE for turning in passed] == simple
    assert winding(shapely.get_coordinates(shapely.reverse(star(20)))) in (LEFT, RIGHT)
    assert winding(shapely.get_coordinates(with_hole(np.random.default_rng(0), 8, 4))) == UNSURE
    assert winding(shapely.get_coordinates(star(MOST + 1))) == UNSURE
    assert winding(np.empty((0, 2))) == UNSURE


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_what_cannot_be_computed_with_is_left_to_geos(value):
    ring = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, value), (0.0, 4.0), (0.0, 0.0)])
    assert winding(ring) == UNSURE


def test_copies_are_handed_out():
    outline = boundary(star(12))
    outline.edges[:] = 0
    outline.site[:] = 0
    assert np.array_equal(boundary(star(12)).site, np.arange(12))
    assert len(np.unique(boundary(star(12)).edges)) == 12
