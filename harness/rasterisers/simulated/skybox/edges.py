"""What Skybox's raster slice is fed: edge functions in pixels, and the tiles that may be met.

A counter-clockwise triangle covers a pixel's centre P where, for each edge from A to B,

    E(P) = (B - A) x (P - A) > 0,

or E(P) = 0 and the edge is a left or a bottom one (`harness.rasterisers.spans` has the rule). All
of that is in whole 1/256 px, so "or 0" is made part of the test by taking 1 from E of the other
edges. With P = (256 x + 128, 256 y + 128), the centre of pixel (x, y), and (dx, dy) = B - A,

    E = 256 (a x + b y) + k,   a = -dy,   b = dx,   k = dx (128 - Ay) - dy (128 - Ax) - (0 or 1).

256 (a x + b y) + k >= 0 exactly where a x + b y + floor(k / 256) >= 0, because a x + b y is whole.
So the slice gets a, b and c = floor(k / 256): exact at 1/256 px, with eight bits less.

Whether 32 bits hold: all that the slice works out is a x + b y + c at pixels of tiles that it is
given, and at tiles' far corners. It adds up modulo 2**32, so sums on the way do no harm. The
function is linear: over the rectangle of a triangle's tiles it is largest and smallest at the
rectangle's corners, and those are looked at. At 1024 px |a|, |b| <= 2**18 and distances from the
edge are at most 1024 px, so 2 * 2**18 * 2**10 = 2**29 is the most: 32 bits hold every triangle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.frame import SUBPIXEL
from harness.rasterisers.base import Triangles
from harness.rasterisers.reference import tile_box, tile_span
from triangulators.compute.kernels import njit

LIMIT = 2**31
"""What a signed number of the slice's 32 bits stays below."""


class Work(NamedTuple):
    """What is drawn.

    edges : (m, 3, 3) int32, a, b, c of the three edges of each triangle
    pairs : (n, 3) int32, the triangle and its tile's lower left pixel, in the order of drawing
    ends : (d,) int32, how many pairs there are up to the end of each draw
    """

    edges: NDArray[np.int32]
    pairs: NDArray[np.int32]
    ends: NDArray[np.int32]


def edge_functions(points: NDArray[np.int32], triangles: Triangles) -> NDArray[np.int64]:
    """Return (m, 3, 3): a, b and c of the edges of each triangle, whichever way it winds."""
    corners = points[triangles].astype(np.int64)
    first, second = (corners[:, k] - corners[:, 0] for k in (1, 2))
    clockwise = first[:, 0] * second[:, 1] < first[:, 1] * second[:, 0]
    corners[clockwise] = corners[clockwise][:, ::-1]
    step = np.roll(corners, -1, axis=1) - corners
    dx, dy = step[..., 0], step[..., 1]
    closed = (dy < 0) | ((dy == 0) & (dx > 0))
    half = SUBPIXEL // 2 - corners
    constant = dx * half[..., 1] - dy * half[..., 0] - ~closed
    return np.stack([-dy, dx, constant // SUBPIXEL], axis=-1)


def work(
    points: NDArray[np.int32],
    triangles: Triangles,
    draws: list[slice],
    window: NDArray[np.int64],
    tile: int,
    exact: bool,
) -> Work:
    """Set up the triangles (m, 3) of each draw and put them into tiles of `tile` px.

    Tiles are drawn row by row, each with its triangles in their order, as Skybox's driver sorts
    them. The driver takes all tiles that a bounding box meets; `exact` takes those alone that the
    triangle itself meets, which is not Skybox's. A triangle without area is in no tile.

    Raises
    ------
    UsageError
        if a triangle is too large for the slice's 32 bits
    """
    edges = edge_functions(points, triangles)
    _refuse_overflow(points, triangles, edges, tile)
    parts, ends, total = [], [], 0
    for rows in draws:
        pairs = bins(points, triangles[rows], tile * SUBPIXEL, window // tile, exact)
        pairs = pairs[np.lexsort((pairs[:, 0], pairs[:, 1], pairs[:, 2]))]
        pairs[:, 0] += rows.start
        pairs[:, 1:] *= tile
        parts.append(pairs)
        total += len(pairs)
        ends.append(total)
    pairs = np.concatenate(parts) if parts else np.empty((0, 3), np.int32)
    return Work(edges.astype(np.int32), pairs, np.array(ends, np.int32))


def _refuse_overflow(
    points: NDArray[np.int32], triangles: Triangles, edges: NDArray[np.int64], tile: int
) -> None:
    side = tile * SUBPIXEL
    corners = points[triangles].astype(np.int64)
    low = corners.min(axis=1) // side * tile
    high = ((corners.max(axis=1) - 1) // side + 1) * tile
    most = np.zeros(len(triangles), np.int64)
    for x in (low[:, 0], high[:, 0]):
        for y in (low[:, 1], high[:, 1]):
            values = edges[..., 0] * x[:, None] + edges[..., 1] * y[:, None] + edges[..., 2]
            most = np.maximum(most, np.abs(values).max(axis=1, initial=0))
    most = np.maximum(most, np.abs(edges).max(axis=(1, 2), initial=0))
    if (most >= LIMIT).any():
        number = int(np.argmax(most >= LIMIT))
        extent = np.ptp(corners[number], axis=0).max() / SUBPIXEL
        raise UsageError(
            f"skybox has 32 bits, too few for a triangle of {extent:.0f} px: "
            "choose a resolution of 1024 or less"
        )


@njit(error_model="numpy")
def bins(
    points: NDArray[np.int32],
    triangles: NDArray[np.int32],
    side: int,
    window: NDArray[np.int64],
    exact: bool,
) -> NDArray[np.int32]:
    """Return (n, 3): a triangle, and column and row of a tile of `side` (1/256 px) it is put into.

    window : first column and row, last column and row of the tiles that are drawn
    """
    found = np.empty((64, 3), np.int32)
    corners = np.zeros((3, 2), np.int64)
    number = 0
    for t in range(len(triangles)):
        left, right, bottom, top = tile_box(points, triangles[t], side, window, corners)
        for row in range(bottom, top + 1):
            low, high = left, right
            if exact:
                low, high = tile_span(corners, row, side, left, right)
            for column in range(low, high + 1):
                if number == len(found):
                    larger = np.empty((2 * number, 3), np.int32)
                    larger[:number] = found
                    found = larger
                found[number] = t, column, row
                number += 1
    return found[:number].copy()
