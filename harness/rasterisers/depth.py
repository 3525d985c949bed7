"""Exact rasterisation with a depth test, as far as a device can be followed (Numba).

Coverage is that of `spans`. Depth is a plane through the triangle's corners, where the grid puts
them, here in double precision. A device computes it in single precision, so where two surfaces are
nearer to each other than that explains, either may win: such a test is a *tie*. What differs from a
device is at most what ties can change, one pixel and one quad each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.rasterisers.spans import Points, Triangles, Window, setup, span
from triangulators.compute.kernels import njit

FRAGMENTS, QUADS, PARTIAL_QUADS, TIES = range(4)
"""Columns of what `count_visible` fills."""

DEEPEST = float(1 << 24)
"""What the depth is where nothing is; only what is less is drawn."""

STEPS = 16.0
"""Of the depth's grid, by which a device's depth may be off."""

SHARE = 2.0**-20
"""Of how much a triangle's plane changes across the picture, by which it may be off, too.

Single precision has 24 bits; the slope itself is known to 22 or so."""


@njit(error_model="numpy")
def count_visible(
    points: Points,
    depths: NDArray[np.int32],
    triangles: Triangles,
    begins: NDArray[np.int64],
    colours: NDArray[np.uint32],
    window: Window,
    picture: NDArray[np.uint32],
) -> NDArray[np.int64]:
    """Count for each triangle what passes the depth test, (m, 4), and draw it.

    points : (n, 2) in 1/256 px; depths : (n,) from 0, near, to `DEEPEST`
    begins : (v + 1,) rows of triangles at which views begin; each begins with nothing drawn
    picture : (height, width), even, row 0 at the bottom; gets `colours` (m,)
    Columns: FRAGMENTS, pixels that pass; QUADS, 2x2 blocks with such a pixel; PARTIAL_QUADS,
    those of them with another pixel, too; TIES.
    """
    counts = np.zeros((len(triangles), 4), np.int64)
    edges = np.zeros((3, 3), np.int64)
    rows = np.zeros((2, 2), np.int64)
    height, width = picture.shape
    nearest, slack = np.empty((height, width)), np.empty((height, width))
    for view in range(len(begins) - 1):
        nearest[:], slack[:] = DEEPEST, -1.0
        for t in range(begins[view], begins[view + 1]):
            first, last, left, right, solid = setup(points, triangles[t], edges, window)
            left, right = max(left, 0), min(right, width - 1)
            if not solid or left > right:
                continue
            x0, y0, z0, across, up = _plane(points, depths, triangles[t])
            loose = STEPS + SHARE * 256.0 * (abs(across) * width + abs(up) * height)
            for bottom in range(max(first, 0) & ~1, min(last, height - 1) + 1, 2):
                low, high = right + 1, left - 1
                for k in range(2):
                    rows[k, 0], rows[k, 1] = span(edges, bottom + k, left, right)
                    if not first <= bottom + k <= last or rows[k, 0] > rows[k, 1]:
                        rows[k, 0], rows[k, 1] = right + 1, left - 1
                    low, high = min(low, rows[k, 0]), max(high, rows[k, 1])
                for column in range(low & ~1, high + 1, 2):
                    passed = 0
                    for lane in range(4):
                        x, k = column + (lane & 1), lane >> 1
                        if not rows[k, 0] <= x <= rows[k, 1]:
                            continue
                        y = bottom + k
                        z = z0 + across * (256 * x + 128 - x0) + up * (256 * y + 128 - y0)
                        gap = nearest[y, x] - z
                        counts[t, TIES] += slack[y, x] >= 0.0 and abs(gap) <= loose + slack[y, x]
                        if gap > 0.0:
                            nearest[y, x], slack[y, x] = z, loose
                            picture[y, x] = colours[t]
                            passed += 1
                    counts[t, FRAGMENTS] += passed
                    counts[t, QUADS] += passed > 0
                    counts[t, PARTIAL_QUADS] += 0 < passed < 4
    return counts


@njit(error_model="numpy")
def _plane(
    points: Points, depths: NDArray[np.int32], triangle: NDArray[np.int32]
) -> tuple[float, float, float, float, float]:
    """Return a corner, x, y and depth, and by how much depth changes over 1/256 px in x and y."""
    a, b, c = triangle
    x0, y0, z0 = float(points[a, 0]), float(points[a, 1]), float(depths[a])
    bx, by, bz = points[b, 0] - x0, points[b, 1] - y0, depths[b] - z0
    cx, cy, cz = points[c, 0] - x0, points[c, 1] - y0, depths[c] - z0
    area = bx * cy - by * cx
    return x0, y0, z0, (bz * cy - cz * by) / area, (cz * bx - bz * cx) / area
