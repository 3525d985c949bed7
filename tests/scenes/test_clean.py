import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes.cleaning.clean import clean

number = st.floats(-1e6, 1e6) | st.integers(-5, 5).map(float)
point = st.tuples(number, number)
polygon = st.lists(point, min_size=3, max_size=12).map(shapely.Polygon)
geometry = (
    st.none()
    | polygon
    | st.lists(polygon, max_size=3).map(shapely.MultiPolygon)
    | point.map(shapely.Point)
    | st.lists(polygon | point.map(shapely.Point), max_size=3).map(shapely.GeometryCollection)
)


@settings(max_examples=200, deadline=None)
@given(st.lists(geometry, max_size=6))
def test_anything_in_sound_polygons_out_and_the_rest_named(geometries):
    cleaned = clean(geometries)
    assert shapely.is_valid(cleaned.polygons).all()
    assert (shapely.area(cleaned.polygons) > 0).all()
    assert all(p.geom_type == "Polygon" and p.exterior.is_ccw for p in cleaned.polygons)
    assert (np.diff(cleaned.source) >= 0).all()
    named = {which for which, _ in cleaned.dropped}
    lost = set(range(len(geometries))) - set(cleaned.source.tolist())
    assert {f"feature {i}" for i in lost} <= named


@settings(max_examples=100, deadline=None)
@given(st.lists(polygon.filter(lambda p: p.is_valid and p.area > 0), min_size=1, max_size=5))
def test_valid_polygons_stay_as_they_are(polygons):
    cleaned = clean(polygons)
    assert cleaned.dropped == cleaned.repaired == []
    assert all(a.equals(b) for a, b in zip(polygons, cleaned.polygons, strict=True))


def test_repeated_vertices_are_removed():
    ring = [(0, 0), (0, 0), (4, 0), (4, 3), (4, 3), (0, 0)]
    assert len(clean([shapely.Polygon(ring)]).polygons[0].exterior.coords) == 4


def test_holes_are_kept_and_wound_clockwise():
    outer, inner = shapely.box(0, 0, 9, 9), shapely.box(2, 2, 4, 4)
    holed = shapely.Polygon(outer.exterior.coords[::-1], [inner.exterior.coords])
    (out,) = clean([holed]).polygons
    assert out.exterior.is_ccw
    assert not out.interiors[0].is_ccw


def test_huge_and_tiny_coordinates():
    huge, tiny, beyond = (shapely.box(0, 0, s, s) for s in (1e9, 1e-12, 1e200))
    cleaned = clean([huge, tiny, beyond])
    assert [p.area for p in cleaned.polygons] == [huge.area, tiny.area]
    assert cleaned.dropped == [("feature 2", "area overflows: coordinates too large")]


def test_what_rounding_leaves_no_area_is_dropped():
    """Where a coordinate's last digit is worth 4 units, the way round decides about the area."""
    thin = shapely.Polygon([(2.7e16, 2.7e16), (1, 0), (1, 5), (4.5e15, 4.5e15)])
    assert thin.is_valid
    assert thin.area > 0
    cleaned = clean([thin, shapely.box(0, 0, 1, 1)])
    assert len(cleaned.polygons) == len(cleaned.source) == 1
    assert cleaned.dropped == [("feature 0", "its area is lost in rounding")]


def test_empty_holes_are_left_out():
    (out,) = clean([shapely.from_wkt("POLYGON ((0 0, 4 0, 4 4, 0 0), EMPTY)")]).polygons
    assert len(out.interiors) == 0
    assert out.area == 8
