"""Tiles against polygon clipping by shapely, and against what a bounding box touches."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon, box

from harness.errors import UsageError
from harness.frame import WHOLE
from harness.rasterisers import Options, find_device, get
from harness.rasterisers.reference import TILES, count_tiles

corner = st.tuples(*[st.integers(0, 64)] * 2) | st.tuples(
    *[st.integers(0, 4).map(lambda v: v * 16)] * 2
)


@settings(deadline=None)  # the first call compiles
@given(st.lists(corner, min_size=3, max_size=3))
def test_tiles_are_those_whose_inside_meets_the_triangles(corners):
    """Tiles of 16 units in a field of 64; the exact count is checked by clipping."""
    points = np.array(corners, np.int32)
    by_box, exact = count_tiles(points, np.array([[0, 1, 2]], np.int32), 16, WHOLE)[0]
    triangle = Polygon(corners)
    if triangle.area == 0:
        assert (by_box, exact) == (0, 0)
        return
    tiles = [box(x, y, x + 16, y + 16) for x in range(0, 64, 16) for y in range(0, 64, 16)]
    # Coordinates are small integers: a real overlap has more area than clipping's rounding.
    assert exact == sum(shapely.intersection(tile, triangle).area > 1e-9 for tile in tiles)
    bounds = box(*triangle.bounds)
    assert by_box == sum(shapely.intersection(tile, bounds).area > 1e-9 for tile in tiles)


def test_counts_are_per_polygon_and_larger_tiles_are_fewer(scattered):
    frame, triangles = scattered(seed=2, size=512, number=40, grid=1)
    counters = get("binning")(find_device("binning")).count(frame, triangles, Options())
    for side in TILES:
        assert counters[f"tiles_{side}"].shape == (40,)
        assert (counters[f"tiles_{side}_exact"] <= counters[f"tiles_{side}"]).all()
    assert counters["tiles_64"].sum() < counters["tiles_32"].sum() < counters["tiles_16"].sum()


def test_it_has_no_time(scattered):
    frame, triangles = scattered(seed=2, size=64, number=2, grid=1)
    binning = get("binning")(find_device("binning"))
    assert not binning.timed
    with pytest.raises(UsageError, match="no time to measure"):
        binning.prepare(frame, triangles, Options())
