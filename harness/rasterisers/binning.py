"""Counts the screen tiles each triangle is binned into, as the first pass of a tiled GPU does.

A tile counts if its inside meets the triangle's inside. Binning by bounding box asks only the
box; exact binning also asks the three edges, at the tile's corner that lies furthest inside
(T. Akenine-Moller, "Conservative rasterization", GPU Gems 2, chapter 42).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.frame import SUBPIXEL, WHOLE, Frame
from harness.rasterisers.base import Counters, OnCpu, Options, Triangles, per_polygon
from triangulators.compute.kernels import njit

TILES = (16, 32, 64)
"""Sides of a tile, px."""


def predict(
    points: NDArray[np.int32], triangles: Triangles, window: NDArray[np.int64] = WHOLE
) -> dict[str, NDArray[np.int64]]:
    """Predict the tiles with a pixel of the window each triangle is put into, (m,) a name.

    tiles_16, tiles_32, tiles_64 : by bounding box
    tiles_16_exact, ... : by exact overlap
    """
    counts = {}
    for side in TILES:
        binned = count_tiles(points, triangles, side * SUBPIXEL, window // side)
        counts[f"tiles_{side}"] = binned[:, 0]
        counts[f"tiles_{side}_exact"] = binned[:, 1]
    return counts


@njit(error_model="numpy")
def count_tiles(
    points: NDArray[np.int32],
    triangles: NDArray[np.int32],
    side: int,
    window: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Count tiles of `side` (1/256 px) for each triangle: (m, 2), by bounding box and exactly.

    Tiles out of the window (first column and row, last column and row) do not count. A triangle
    without area is in no tile.
    """
    counts = np.zeros((len(triangles), 2), np.int64)
    corners = np.zeros((3, 2), np.int64)
    for t in range(len(triangles)):
        left, right, bottom, top = tile_box(points, triangles[t], side, window, corners)
        counts[t, 0] = max(0, right - left + 1) * max(0, top - bottom + 1)
        for row in range(bottom, top + 1):
            low, high = tile_span(corners, row, side, left, right)
            counts[t, 1] += max(0, high - low + 1)
    return counts


@njit(error_model="numpy")
def tile_box(
    points: NDArray[np.int32],
    triangle: NDArray[np.int32],
    side: int,
    window: NDArray[np.int64],
    corners: NDArray[np.int64],
) -> tuple[int, int, int, int]:
    """First and last column, first and last row of the tiles that a triangle's box has in `window`.

    A triangle without area has none. `corners` (3, 2) gets its corners, counter-clockwise.
    """
    for k in range(3):
        corners[k, 0] = points[triangle[k], 0]
        corners[k, 1] = points[triangle[k], 1]
    doubled = (corners[1, 0] - corners[0, 0]) * (corners[2, 1] - corners[0, 1]) - (
        corners[1, 1] - corners[0, 1]
    ) * (corners[2, 0] - corners[0, 0])
    if doubled == 0:
        return 0, -1, 0, -1
    if doubled < 0:
        for axis in range(2):
            corners[1, axis], corners[2, axis] = corners[2, axis], corners[1, axis]
    left, right = corners[:, 0].min() // side, (corners[:, 0].max() - 1) // side
    bottom, top = corners[:, 1].min() // side, (corners[:, 1].max() - 1) // side
    return max(left, window[0]), min(right, window[2]), max(bottom, window[1]), min(top, window[3])


@njit(error_model="numpy", inline="always")
def tile_span(
    corners: NDArray[np.int64], row: int, side: int, left: int, right: int
) -> tuple[int, int]:
    """First and last tile of a row that no edge of the triangle keeps wholly outside."""
    for k in range(3):
        x, y = corners[k, 0], corners[k, 1]
        dx, dy = corners[(k + 1) % 3, 0] - x, corners[(k + 1) % 3, 1] - y
        furthest_row = row + 1 if dx > 0 else row
        # Inside at column x' if value > dy * side * x', x' a corner of the tile.
        value = dx * (side * furthest_row - y) + dy * x
        if dy > 0:
            right = min(right, (value - 1) // (dy * side))
        elif dy < 0:
            left = max(left, -((value - 1) // (-dy * side)) - 1)
        elif value <= 0:
            return left, left - 1
    return left, right


class Binning(OnCpu):
    """A binner on the CPU; it counts and draws nothing."""

    name = "binning"
    counters: ClassVar[tuple[str, ...]] = tuple(
        f"tiles_{side}{how}" for side in TILES for how in ("", "_exact")
    )
    timed = False
    cuts = True

    def _count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        tiles = predict(frame.points, triangles, frame.window)
        return {name: per_polygon(frame, triangles, tiles[name]) for name in self.counters}
