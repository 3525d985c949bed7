import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes import load
from scenes.cleaning.fill import fill_contours, fill_even_odd
from scenes.cleaning.repair import clean

number = st.floats(-1e6, 1e6) | st.integers(-5, 5).map(float)
point = st.tuples(number, number)
polygon = st.lists(point, min_size=3, max_size=12).map(shapely.Polygon)
# coordinates whose products are no less than doubles can hold
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
@given(st.lists(plain.filter(lambda p: p.is_valid and p.area > 0), min_size=1, max_size=5))
def test_valid_polygons_stay_as_they_are(polygons):
    cleaned = clean(polygons)
    assert cleaned.dropped == cleaned.repaired == []
    assert all(a.equals(b) for a, b in zip(polygons, cleaned.polygons, strict=True))


def test_repeated_vertices_are_removed():
    ring = [(0, 0), (0, 0), (4, 0), (4, 3), (4, 3), (0, 0)]
    assert len(clean([shapely.Polygon(ring)]).polygons[0].exterior.coords) == 4


def test_holes_are_retained_and_oriented_clockwise():
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


def test_polygons_whose_area_is_lost_in_rounding_are_dropped():
    """Where a coordinate's last digit is worth 4 units, the way round decides about the area."""
    thin = shapely.Polygon([(2.7e16, 2.7e16), (1, 0), (1, 5), (4.5e15, 4.5e15)])
    assert thin.is_valid
    assert thin.area > 0
    cleaned = clean([thin, shapely.box(0, 0, 1, 1)])
    assert len(cleaned.polygons) == len(cleaned.source) == 1
    assert cleaned.dropped == [("feature 0", "area is lost in rounding")]


def test_empty_holes_are_removed():
    (out,) = clean([shapely.from_wkt("POLYGON ((0 0, 4 0, 4 4, 0 0), EMPTY)")]).polygons
    assert len(out.interiors) == 0
    assert out.area == 8


class TestManyCrossings:
    def test_faces_are_those_of_make_valid(self):
        """Without edges that lie on each other, as here, both fill by parity."""
        rng = np.random.default_rng(8)
        for corners in (5, 12, 40):
            ring = shapely.Polygon(rng.random((corners, 2)))
            expected = shapely.make_valid(ring)
            found = fill_even_odd(shapely.get_rings(ring))
            assert found.is_valid
            assert shapely.symmetric_difference(found, expected).area < 1e-12
            assert shapely.get_num_geometries(found) == shapely.get_num_geometries(expected)

    def test_coincident_edges_count_twice(self):
        pair = [shapely.box(0, 0, 2, 2), shapely.box(1, 0, 3, 2), shapely.box(3, 0, 4, 2)]
        found = fill_even_odd(shapely.get_exterior_ring(pair))
        assert found.equals(shapely.union_all([shapely.box(0, 0, 1, 2), shapely.box(2, 0, 4, 2)]))

    def test_a_ring_of_many_is_repaired(self, monkeypatch):
        monkeypatch.setattr(shapely, "make_valid", None)  # it would take a minute
        ring = np.random.default_rng(8).random((250, 2))
        cleaned = clean([shapely.Polygon(ring)])
        assert len(cleaned.polygons) > 3000
        assert "self-intersects" in cleaned.repaired[0][1]

    def test_a_ring_of_too_many_is_named(self):
        ring = np.random.default_rng(8).random((2500, 2))
        cleaned = clean([shapely.Polygon(ring), shapely.box(0, 0, 1, 1)])
        assert len(cleaned.polygons) == 1
        assert "could not be repaired" in cleaned.dropped[0][1]


@pytest.mark.parametrize("rule", ["nonzero", "evenodd"])
def test_contours_with_many_holes_keep_their_vertices(rule):
    """Islands in holes in one outline: nothing crosses, so nothing is added."""
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


STAR = np.array([(100, 10), (40, 180), (190, 70), (10, 70), (160, 180)])


class TestFillRules:
    @settings(max_examples=150, deadline=None)
    @given(st.integers(0, 2**32 - 1), st.sampled_from(["nonzero", "evenodd"]))
    def test_points_are_inside_by_their_angles(self, seed, rule):
        """The winding number as the sum of angles under which a point sees the edges."""
        rng = np.random.default_rng(seed)
        rings = [rng.integers(0, 7, (rng.integers(3, 8), 2)) for _ in range(rng.integers(1, 5))]
        points = rng.random((40, 2)) * 7
        turns = np.zeros(len(points))
        for ring in rings:
            seen = ring[None] - points[:, None]
            x, y = np.moveaxis(seen, 2, 0)
            after_x, after_y = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
            turns += np.arctan2(x * after_y - y * after_x, x * after_x + y * after_y).sum(axis=1)
        winding = np.rint(turns / (2 * np.pi)).astype(int)
        expected = winding != 0 if rule == "nonzero" else winding % 2 == 1
        (area,) = fill_contours(rings, rule)
        assert (shapely.contains_xy(area, *points.T) == expected).all()

    def test_self_crossing_glyph_covers_the_area_that_freetype_draws(self, tmp_path):
        import freetype
        from fontTools.fontBuilder import FontBuilder
        from fontTools.pens.ttGlyphPen import TTGlyphPen

        pen = TTGlyphPen(None)
        for ring in (5 * STAR, 5 * STAR[::-1] + (450, 0), np.array([(0, 0), (900, 0), (0, 99)])):
            pen.moveTo(tuple(ring[0].tolist()))
            for vertex in ring[1:].tolist():
                pen.lineTo(tuple(vertex))
            pen.closePath()
        empty, path = TTGlyphPen(None).glyph(), str(tmp_path / "star.ttf")
        font = FontBuilder(1000, isTTF=True)
        font.setupGlyphOrder([".notdef", "A"])
        font.setupCharacterMap({65: "A"})
        font.setupGlyf({".notdef": empty, "A": pen.glyph()})
        font.setupHorizontalMetrics({".notdef": (2000, 0), "A": (2000, 0)})
        font.setupHorizontalHeader(ascent=1000, descent=-200)
        font.setupNameTable({"familyName": "Star", "styleName": "Regular"})
        font.setupOS2()
        font.setupPost()
        font.save(path)
        face = freetype.Face(path)
        face.set_pixel_sizes(0, 500)
        face.load_char("A", freetype.FT_LOAD_RENDER | freetype.FT_LOAD_NO_HINTING)
        drawn = 4 * sum(face.glyph.bitmap.buffer) / 255
        filled = sum(p.area for p in load("glyphs", font=path, text="A").polygons)
        assert filled == pytest.approx(drawn, rel=0.003)

    @pytest.mark.parametrize(("rule", "area"), [("nonzero", 10319.4), ("evenodd", 7138.7)])
    def test_a_star(self, rule, area):
        (filled,) = fill_contours([STAR], rule)
        assert filled.area == pytest.approx(area, abs=0.1)
        assert shapely.get_num_coordinates(filled) == (11 if rule == "nonzero" else 20)

    def test_rings_within_rings_keep_their_vertices(self):
        """Twice round, then back once: no edge of the two inner rings is of the area."""
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
            # within the first, the other two cross: there the winding number is 1 again
            ([(0, 0, 9, 9, 1), (1, 1, 5, 5, 1), (3, 3, 7, 7, -1)], 81 - 12, 81 - 24),
            ([(0, 0, 4, 4, 1), (4, 0, 8, 4, 1)], 32, 32),
            ([(0, 0, 4, 4, 1), (2, 0, 4, 4, -1)], 8, 8),
        ],
    )
    def test_simple_rings_that_are_equal_cross_or_touch(self, boxes, nonzero, evenodd):
        rings = [np.array([(a, b), (c, b), (c, d), (a, d)])[::way] for a, b, c, d, way in boxes]
        assert shapely.area(fill_contours(rings, "nonzero")).sum() == nonzero
        assert shapely.area(fill_contours(rings, "evenodd")).sum() == evenodd
