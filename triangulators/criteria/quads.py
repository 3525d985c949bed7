"""Quads that a triangle shades where it lies on the pixel grid: counted, not expected.

Coordinates are pixels, y up, and are taken to the nearest 1/256. A pixel's centre is at (128, 128)
of its 256 x 256 units. It is covered where it is inside all three edge functions of the
counter-clockwise triangle; a centre on an edge belongs to a left edge (it runs down) or a bottom
edge (level, it runs right): the top-left rule of Direct3D and of Mesa, seen with y up.

Derivation. The edge function of a-b at the centre of pixel (x, y) is

    (bx - ax) * (256 y + 128 - ay) - (by - ay) * (256 x + 128 - ax) = value(y) - step * x,

with step = 256 (by - ay). An edge that does not own its points is moved by one unit of that, the
least there is, so that inside is >= 0 for all edges. In a row, each edge lets through all x up to
a last one (step > 0), from a first one on (step < 0), or all or none: one floor division each. What
is left of the row is one span. The quads of two rows are the pairs of columns that either span
touches: both lengths in pairs, less what they have in common.

Loop order. Rows in pairs, from the lowest; the spans need no memory, so the function is called
for millions of triangles without allocating anything.

Integers. Coordinates below 2^14 px are below 2^22 units, products below 2^45.
"""

import numpy as np

from triangulators.compute.kernels import njit

_UNIT, _HALF = 256, 128


@njit(inline="always")
def _within(value: int, step: int, left: int, right: int) -> tuple[int, int]:
    """Return what an edge leaves of the span left..right."""
    if step > 0:
        return left, min(right, value // step)
    if step < 0:
        return max(left, -(value // -step)), right
    return (left, right) if value >= 0 else (left, left - 1)


@njit(error_model="numpy")
def exact_quads(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the 2x2 pixel quads with a pixel that the triangle a, b, c covers."""
    x0, y0 = int(np.rint(ax * _UNIT)), int(np.rint(ay * _UNIT))
    x1, y1 = int(np.rint(bx * _UNIT)), int(np.rint(by * _UNIT))
    x2, y2 = int(np.rint(cx * _UNIT)), int(np.rint(cy * _UNIT))
    doubled = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    if doubled == 0:
        return 0.0
    if doubled < 0:
        x1, y1, x2, y2 = x2, y2, x1, y1
    left, right = -((_HALF - min(x0, x1, x2)) // _UNIT), (max(x0, x1, x2) - _HALF) // _UNIT
    first, last = -((_HALF - min(y0, y1, y2)) // _UNIT), (max(y0, y1, y2) - _HALF) // _UNIT
    if left > right:
        return 0.0
    # What each edge function is in row 0, less 1 where the edge owns none of its points.
    u0, v0, u1, v1, u2, v2 = x1 - x0, y1 - y0, x2 - x1, y2 - y1, x0 - x2, y0 - y2
    c0 = u0 * (_HALF - y0) - v0 * (_HALF - x0) - (0 if v0 < 0 or (v0 == 0 and u0 > 0) else 1)
    c1 = u1 * (_HALF - y1) - v1 * (_HALF - x1) - (0 if v1 < 0 or (v1 == 0 and u1 > 0) else 1)
    c2 = u2 * (_HALF - y2) - v2 * (_HALF - x2) - (0 if v2 < 0 or (v2 == 0 and u2 > 0) else 1)
    total, before_low, before_high = 0, 0, -1
    for y in range(first & ~1, last + 1):
        low, high = left, right if y >= first else left - 1
        low, high = _within(c0 + _UNIT * u0 * y, _UNIT * v0, low, high)
        low, high = _within(c1 + _UNIT * u1 * y, _UNIT * v1, low, high)
        low, high = _within(c2 + _UNIT * u2 * y, _UNIT * v2, low, high)
        if low > high:
            low, high = 0, -1
        else:
            low, high = low >> 1, high >> 1
            total += high - low + 1
        if y % 2 == 1:
            total -= max(0, min(high, before_high) - max(low, before_low) + 1)
        before_low, before_high = low, high
    return float(total)
