import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes import load
from scenes.fill import fill_contours
from scenes.real import find_font
from scenes.repair import clean

number = st.floats(-1e6, 1e6) | st.integers(-5, 5).map(float)
point = st.tuples(number, number)
polygon = st.lists(point, min_size=3, max_size=12).map(shapely.Polygon)
# Coordinates with products that do not underflow.
plain_point = st.tuples(*[number.map(lambda value: round(value, 6))] * 2)
plain = st.lists(plain_point, min_size=3, max_size=12).map(shapely.Polygon)
geometry = (
    st.none()
    | polygon
    | st.lists(polygon, max_size=3).map(shapely.MultiPolygon)
    | point.map(shapely.Point)
    | st.lists(polygon | point.map(shapely.Point), max_size=3).map(shapely.GeometryCollection)
)


@settings(max_examples=200, deadline=None)
@given(st.lists(geometry, max_size=6))
def test_clean_returns_valid_polygons_and_names_dropped_geometries(geometries):
    cleaned = clean(geometries)
    assert shapely.is_valid(cleaned.polygons).all()
    assert (shapely.area(cleaned.polygons) > 0).all()
    assert all(p.geom_type == "Polygon" and p.exterior.is_ccw for p in cleaned.polygons)
    assert (np.diff(cleaned.source) >= 0).all()
    names = {name for name, _ in cleaned.dropped}
    missing = set(range(len(geometries))) - set(cleaned.source.tolist())
    assert {f"feature {i}" for i in missing} <= names


@settings(max_examples=100, deadline=None)
@given(st.lists(plain.filter(lambda p: p.is_valid and p.area > 0), min_size=1, max_size=5))
def test_clean_leaves_valid_polygons_unchanged(polygons):
    cleaned = clean(polygons)
    assert cleaned.dropped == cleaned.repaired == []
    assert all(a.equals(b) for a, b in zip(polygons, cleaned.polygons, strict=True))


def test_repeated_vertices_and_empty_holes_are_removed():
    ring = [(0, 0), (0, 0), (4, 0), (4, 3), (4, 3), (0, 0)]
    assert len(clean([shapely.Polygon(ring)]).polygons[0].exterior.coords) == 4
    (polygon,) = clean([shapely.from_wkt("POLYGON ((0 0, 4 0, 4 4, 0 0), EMPTY)")]).polygons
    assert len(polygon.interiors) == 0
    assert polygon.area == 8


def test_huge_and_tiny_coordinates():
    huge, tiny, beyond = (shapely.box(0, 0, s, s) for s in (1e9, 1e-12, 1e200))
    cleaned = clean([huge, tiny, beyond])
    assert [p.area for p in cleaned.polygons] == [huge.area, tiny.area]
    assert cleaned.dropped == [("feature 2", "area overflows: coordinates too large")]


def test_polygons_whose_area_is_lost_in_rounding_are_dropped():
    """If the last digit of coordinates is 4 units, the area depends on the orientation."""
    thin = shapely.Polygon([(2.7e16, 2.7e16), (1, 0), (1, 5), (4.5e15, 4.5e15)])
    assert thin.is_valid
    assert thin.area > 0
    cleaned = clean([thin, shapely.box(0, 0, 1, 1)])
    assert len(cleaned.polygons) == len(cleaned.source) == 1
    assert cleaned.dropped == [("feature 0", "area is lost in rounding")]


class TestManyCrossings:
    def test_polygon_with_many_crossings_is_repaired(self, monkeypatch):
        monkeypatch.setattr(shapely, "make_valid", None)  # takes a minute
        ring = np.random.default_rng(8).random((250, 2))
        cleaned = clean([shapely.Polygon(ring)])
        assert len(cleaned.polygons) > 3000
        assert "self-intersects" in cleaned.repaired[0][1]

    def test_polygon_with_too_many_crossings_is_dropped(self):
        ring = np.random.default_rng(8).random((2500, 2))
        cleaned = clean([shapely.Polygon(ring), shapely.box(0, 0, 1, 1)])
        assert len(cleaned.polygons) == 1
        assert "could not be repaired" in cleaned.dropped[0][1]


@pytest.mark.parametrize("rule", ["nonzero", "evenodd"])
def test_contours_with_many_holes_keep_their_vertices(rule):
    """Islands in holes in an outline: without crossings no vertices are added."""
    k = 40
    outline = shapely.box(0, 0, 10 * k, 10 * k)
    corners = [(10 * x + 1, 10 * y + 1) for x in range(k) for y in range(k)]
    holes = [shapely.box(x, y, x + 8, y + 8).exterior.reverse() for x, y in corners]
    islands = [shapely.box(x + 2, y + 2, x + 4, y + 4).exterior for x, y in corners]
    rings = [outline.exterior, *holes, *islands]
    (area,) = fill_contours([shapely.get_coordinates(ring)[:-1] for ring in rings], rule)
    assert area.area == 100 * k * k - 64 * k * k + 4 * k * k
    assert shapely.get_num_coordinates(area) == 5 * len(rings)
    assert shapely.get_num_geometries(area) == 1 + k * k


class TestFillRules:
    @settings(max_examples=150, deadline=None)
    @given(st.integers(0, 2**32 - 1), st.sampled_from(["nonzero", "evenodd"]))
    def test_area_agrees_with_winding_numbers_of_points(self, seed, rule):
        """The winding number is the sum of the angles of edges as seen from a point."""
        rng = np.random.default_rng(seed)
        rings = [rng.integers(0, 7, (rng.integers(3, 8), 2)) for _ in range(rng.integers(1, 5))]
        points = rng.random((40, 2)) * 7
        angles = np.zeros(len(points))
        for ring in rings:
            offsets = ring[None] - points[:, None]
            x, y = np.moveaxis(offsets, 2, 0)
            after_x, after_y = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
            angles += np.arctan2(x * after_y - y * after_x, x * after_x + y * after_y).sum(axis=1)
        winding = np.rint(angles / (2 * np.pi)).astype(int)
        expected = winding != 0 if rule == "nonzero" else winding % 2 == 1
        (area,) = fill_contours(rings, rule)
        assert area.is_valid
        assert (shapely.contains_xy(area, *points.T) == expected).all()

    def test_letters_cover_the_area_that_freetype_draws(self):
        import freetype

        face = freetype.Face(find_font())
        face.set_pixel_sizes(0, 512)
        for character in "AB8%&@\N{COPYRIGHT SIGN}":
            face.load_char(character, freetype.FT_LOAD_RENDER | freetype.FT_LOAD_NO_HINTING)
            drawn = (face.units_per_EM / 512) ** 2 * sum(face.glyph.bitmap.buffer) / 255
            filled = sum(p.area for p in load("glyphs", text=character).polygons)
            assert filled == pytest.approx(drawn, rel=0.005), character

    def test_rings_within_rings_keep_their_vertices(self):
        """With winding numbers 1, 2 and 1 the inner rings do not bound the area."""
        rings = [shapely.box(i, i, 90 - i, 90 - i).exterior for i in (0, 10, 30)]
        contours = [shapely.get_coordinates(ring)[:-1] for ring in rings]
        contours[2] = contours[2][::-1]
        (area,) = fill_contours(contours)
        assert area.equals(shapely.box(0, 0, 90, 90))
        assert shapely.get_num_coordinates(area) == 5

    @pytest.mark.parametrize(
        ("boxes", "nonzero", "evenodd"),
        [
            ([(0, 0, 4, 4, 1), (0, 0, 4, 4, 1)], 16, 0),
            ([(0, 0, 4, 4, 1), (0, 0, 4, 4, -1)], 0, 0),
            # The other two cross within the first; the winding number of their overlap is 1.
            ([(0, 0, 9, 9, 1), (1, 1, 5, 5, 1), (3, 3, 7, 7, -1)], 81 - 12, 81 - 24),
            ([(0, 0, 4, 4, 1), (4, 0, 8, 4, 1)], 32, 32),
            ([(0, 0, 4, 4, 1), (2, 0, 4, 4, -1)], 8, 8),
        ],
    )
    def test_simple_rings_that_are_equal_cross_or_touch(self, boxes, nonzero, evenodd):
        rings = [np.array([(a, b), (c, b), (c, d), (a, d)])[::way] for a, b, c, d, way in boxes]
        assert shapely.area(fill_contours(rings, "nonzero")).sum() == nonzero
        assert shapely.area(fill_contours(rings, "evenodd")).sum() == evenodd


def test_contours_that_coincide_too_often_are_refused():
    """Coincident edges do not cross, but each pair is a pair to resolve."""
    there_and_back = np.tile([(0.0, 0.0), (2.0, 1.0)], (2000, 1))
    with pytest.raises(shapely.GEOSException, match="crosses itself more than"):
        fill_contours([np.vstack([there_and_back, [(1.0, 3.0)]])])
    wheel = [
        np.array([(0, 0), (np.cos(a), np.sin(a)), (np.cos(a + 1e-3), np.sin(a + 1e-3))])
        for a in np.linspace(0, 6, 1500)
    ]
    (area,) = fill_contours(wheel)  # edges that only touch are no crossings
    assert area.area == pytest.approx(1500 * np.sin(1e-3) / 2)
