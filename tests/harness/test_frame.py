"""Frames: inside the viewport, on the grid, with notes about lost polygons."""

import pickle

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon, box

from harness.errors import InputError, UsageError
from harness.frame import MARGIN_PX, View, make_frame, make_grid_frame
from harness.grid import SUBPIXEL, to_grid
from triangulators import vertices

L_SHAPE = Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)])
COURTYARD = box(10, 10, 20, 20).difference(box(12, 12, 18, 18))

position, size = st.floats(-1e6, 1e6), st.floats(1e-3, 1e4)
boxes = st.builds(lambda x, y, w, h: box(x, y, x + w, y + h), position, position, size, size)


@given(
    st.lists(boxes, min_size=1, max_size=8),
    st.integers(8, 4096),
    st.floats(-720, 720),
    st.sampled_from(["box", "circle"]),
)
def test_every_vertex_is_on_the_grid_and_inside_the_viewport(polygons, resolution, turn, fit):
    frame = make_frame(polygons, View(resolution, turn, fit))
    assert (frame.points >= 0).all()
    assert (frame.points <= resolution * SUBPIXEL).all()
    for number, polygon in enumerate(frame.polygons):
        part, _ = frame.grid.rings_of(number)
        assert (vertices(polygon) * SUBPIXEL == part).all()
        assert polygon.is_valid
        assert polygon.area > 0
    named = {number for number, _ in frame.dropped} | set(frame.source.tolist())
    assert named == set(range(len(polygons)))


def test_a_scene_fills_the_viewport():
    frame = make_frame([L_SHAPE, COURTYARD], View(512))
    assert frame.points.min() == MARGIN_PX * SUBPIXEL
    assert frame.points.max() == (512 - MARGIN_PX) * SUBPIXEL
    assert frame.scale == pytest.approx(510 / 20)
    assert frame.dropped == frame.repaired == ()


def test_a_quarter_turn_is_exact_and_counter_clockwise():
    upright = make_frame([L_SHAPE], View(256)).points
    turned = make_frame([L_SHAPE], View(256, 90)).points
    x, y = upright[:, 0], upright[:, 1]
    assert (turned == np.column_stack([256 * SUBPIXEL - y, x])).all()


def test_circle_keeps_the_scale_at_every_rotation():
    scales = {make_frame([L_SHAPE], View(256, a, "circle")).scale for a in range(0, 360, 15)}
    assert max(scales) == pytest.approx(min(scales))


def test_rings_are_oriented_and_owned():
    frame = make_frame([COURTYARD, L_SHAPE], View(256))
    assert frame.polygons[0].exterior.is_ccw
    assert not frame.polygons[0].interiors[0].is_ccw
    assert frame.grid.geom_offsets.tolist() == [0, 2, 3]
    parts = [np.array([[0, 1, 4]], np.int32), np.array([[0, 1, 2], [0, 2, 3]])]
    joined = frame.join_triangles(parts)
    assert frame.find_owners(joined).tolist() == [0, 1, 1]
    assert joined[1].tolist() == [8, 9, 10]
    assert frame.join_triangles([None, None]).shape == (0, 3)


def test_merged_vertices_and_vanished_polygons_are_named():
    polygon = Polygon([(0, 0), (10, 0), (10, 10), (10 - 1e-7, 10), (0, 10)])
    frame = make_frame([polygon, box(5, 5, 5 + 1e-9, 9)], View(64))
    assert (len(frame.polygons), len(frame.points)) == (1, 4)
    assert frame.dropped[0][0] == 1
    assert "vanishes" in frame.dropped[0][1]
    assert frame.repaired[0][0] == 0
    assert "1 vertices coincide" in frame.repaired[0][1]


def test_a_polygon_that_snapping_pinches_is_split_and_named():
    # Two squares joined by a bridge much thinner than the grid.
    e = 1e-6
    polygon = shapely.union_all([box(0, 0, 4, 5), box(4, 2, 6, 2 + e), box(6, 0, 10, 5)])
    frame = make_frame([box(0, 6, 4, 8), polygon, box(6, 6, 10, 8)], View(64))
    assert frame.source.tolist() == [0, 1, 1, 2]
    assert frame.repaired[0][0] == 1
    assert "into 2 pieces" in frame.repaired[0][1]
    assert shapely.union_all(frame.polygons[1:3]).is_valid
    assert shapely.bounds(frame.polygons[3])[0] > 32


@pytest.mark.parametrize("resolution", [0, 7, 1 << 20])
def test_resolutions_out_of_range_are_refused(resolution):
    with pytest.raises(UsageError, match=f"resolution {resolution}: out of range"):
        View(resolution)


def test_scenes_without_polygons_or_extent_are_refused():
    with pytest.raises(InputError, match="no polygon"):
        make_frame([], View())
    with pytest.raises(UsageError, match="not a finite number"):
        View(64, float("nan"))


@given(st.lists(st.tuples(st.integers(0, 400), st.integers(0, 4)), min_size=1, max_size=4))
def test_frames_have_the_same_polygons_in_a_worker(squares):
    """Squares with up to four triangular holes, on the 1/256 px grid."""
    polygons = []
    for west, count in squares:
        starts = range(west + 4, west + 4 + 7 * count, 7)
        holes = [[(x, 8), (x + 5 / SUBPIXEL, 8), (x, 9 + x % 9)] for x in starts]
        polygons.append(Polygon(box(west, 0, west + 40, 40).exterior, holes))
    frame = make_grid_frame(512, to_grid(polygons))
    assert list(frame.polygons) == polygons
    sent = pickle.loads(pickle.dumps(frame))
    assert "polygons" not in vars(sent)
    assert list(sent.polygons) == polygons
