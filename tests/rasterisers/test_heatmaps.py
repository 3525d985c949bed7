"""Heatmaps: sums equal the counters, and pictures contain the triangulations."""

from io import BytesIO

import numpy as np
import pytest
from PIL import Image
from shapely import Polygon

from harness.frame import View, make_bare_frame, make_frame
from harness.grid import SUBPIXEL
from harness.heatmaps import PANEL_PX, draw_heatmaps, make_lane_maps
from harness.rasterisers import Options
from tests.rasterisers.conftest import loose_triangles, random_triangles
from triangulators import triangulate

ELL = Polygon([(40, 0), (60, 0), (60, 8), (48, 8), (48, 20), (40, 20)])


@pytest.mark.parametrize("size", [64, 65, 300])
@pytest.mark.parametrize("grid", [1, 128])
def test_maps_add_up_to_the_counters(reference, size, grid):
    frame, triangles = random_triangles(seed=size, size=size, number=80, grid=grid)
    covered, helpers = make_lane_maps(frame, triangles)
    counters = reference.draw_and_count(frame, triangles, Options())
    assert covered.shape == (size, size)
    assert covered.sum() == counters["fragments"].sum()
    assert helpers.sum() <= counters["helper_lanes"].sum()
    if size % 2 == 0:
        assert helpers.sum() == counters["helper_lanes"].sum()


def test_single_pixel_has_three_helper_lanes():
    frame, triangles = loose_triangles([[800, 800], [1000, 800], [800, 1000]], 8)
    covered, helpers = make_lane_maps(frame, triangles)
    assert np.argwhere(covered).tolist() == [[3, 3]]
    assert np.argwhere(helpers).tolist() == [[2, 2], [2, 3], [3, 2]]


def test_picture_shows_triangulations_side_by_side():
    frame = make_frame([ELL], View(256, 10))
    pictures = []
    for names in (("delaunay",), ("delaunay", "ear-clipping", "fan")):
        triangulations = {name: triangulate(frame.polygons[0], name) for name in names}
        pictures.append(draw_heatmaps(frame, triangulations))
    one, three = (np.asarray(Image.open(BytesIO(png)).convert("RGB")) for png in pictures)
    assert three.shape[1] > one.shape[1] + PANEL_PX
    assert three.shape[0] == one.shape[0]
    assert one.shape[0] > PANEL_PX
    # White, two palettes and lines.
    assert len(np.unique(three @ [1, 1 << 8, 1 << 16])) > 20


@pytest.mark.parametrize("reach", [8, 10])
def test_triangles_are_drawn_on_the_pixels_that_they_cover(reach):
    """Draw squares of complete quads, one of which ends at the edge of the viewport."""
    points = np.array([[2, 2], [reach, 2], [reach, reach], [2, reach]], np.int32) * SUBPIXEL
    rows = np.array([[0, 1, 2], [0, 2, 3]])
    png = draw_heatmaps(make_bare_frame(10, points), {"both": rows})
    picture = np.asarray(Image.open(BytesIO(png)).convert("RGB"))[100:]
    coloured = np.argwhere((picture[:, :, 0] > 200) & (picture[:, :, 2] < 130))[:, 0]
    lines = np.argwhere((picture == 0x20).all(axis=2))[:, 0]
    assert abs(lines.min() - coloured.min()) <= 2
