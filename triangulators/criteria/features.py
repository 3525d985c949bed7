"""Features of a triangle: Numba functions of three points as six numbers.

A new feature is added to `criterion.FEATURES`, `FEATURE_COUNT`, `weigh_triangle`, `weigh_triangles`
and `sum_features`. `exact_quads`, not in `FEATURES`, depends on the position on the pixel grid.
"""

import math
from typing import Any

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import twice_area

FEATURE_COUNT = 10  # `cost` asserts that it is the length of `criterion.FEATURES`
SIGNATURE = f"float64({', '.join(['float64'] * 6)})"  # a feature or a user's criterion


@njit
def area(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the area of a triangle (S)."""
    return 0.5 * abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


@njit
def half_perimeter(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the width plus the height of a triangle's bounding box (H)."""
    return (max(ax, bx, cx) - min(ax, bx, cx)) + (max(ay, by, cy) - min(ay, by, cy))


@njit
def bbox_area(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the width times the height of a triangle's bounding box."""
    return (max(ax, bx, cx) - min(ax, bx, cx)) * (max(ay, by, cy) - min(ay, by, cy))


@njit
def edge_length(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the perimeter of a triangle (E)."""
    ab = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    bc = math.sqrt((cx - bx) ** 2 + (cy - by) ** 2)
    ca = math.sqrt((ax - cx) ** 2 + (ay - cy) ** 2)
    return ab + bc + ca


@njit
def shape(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return |60 - q| + |60 - r| + |60 - n| for the angles q, r, n in degrees (D): 0 to 240."""
    cross = twice_area(ax, ay, bx, by, cx, cy)
    q = math.atan2(cross, (bx - ax) * (cx - ax) + (by - ay) * (cy - ay))
    r = math.atan2(cross, (ax - bx) * (cx - bx) + (ay - by) * (cy - by))
    third = math.pi / 3.0
    total = abs(third - q) + abs(third - r) + abs(third - (math.pi - q - r))
    return total * 180.0 / math.pi


@njit
def beauty(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the area over the perimeter of a triangle: half the radius of the inscribed circle."""
    around = edge_length(ax, ay, bx, by, cx, cy)
    return area(ax, ay, bx, by, cx, cy) / around if around > 0.0 else 0.0


@njit(forceinline=True, error_model="numpy")
def _find_common_share(lost: float, doubled_area: float) -> float:
    """Return the fraction of a triangle's area that it has in common with shifted copies."""
    side = 1.0 - lost / doubled_area
    return side * side if side > 0.0 else 0.0


@njit(forceinline=True)
def _sum_triple(p: float, q: float, u: float, v: float, x: float, y: float) -> float:
    """Return L of a triple in `_average_blocks`: the sum of max(0, -first, -second) over edges."""
    return -(min(0.0, p, q) + min(0.0, u, v)) - min(0.0, x, y)


@njit(forceinline=True, error_model="numpy")
def _average_blocks(
    size: float, ax: float, ay: float, bx: float, by: float, cx: float, cy: float
) -> float:
    """Return the mean number of b x b pixel blocks, b = `size`, with a covered pixel centre.

    The mean is over all positions of the triangle on the grid. A block has a covered centre if one
    of b^2 copies of the triangle, shifted by 0 to b - 1 pixels along x and y, covers its first
    centre. So the mean is the area of the union of the copies over b^2.

    Intersection of copies. A counter-clockwise triangle T of area S is the set n.p >= c for each
    edge e = (ex, ey), with the inward normal n = (-ey, ex); a copy shifted by m is n.p >= c + n.m.
    So the intersection of T and the copies by all m of a set M is similar to T by the factor
    1 - L / (2 S), and empty if L > 2 S:

        L(M) = sum over the edges of max(0, n.m for m in M),     common(M) = (1 - L / (2 S))^2 S

    The edges sum to zero, so the positive components along a direction add up to the extent there:

        pair      {(1, 0)}                  max(0, -ey)           L = height of the box
        pair      {(0, 1)}                  max(0, ex)            L = width
        diagonal  {(1, 1)}                  max(0, ex - ey)       L = extent of x - y
        diagonal  {(1, -1)}                 max(0, -ex - ey)      L = extent of x + y
        triple    {(r, 0), (0, u)}          max(0, -r ey, u ex)   r and u are 1 or -1: four of them
        four      {(1, 0), (0, 1), (1, 1)}  max(0, -ey) + max(0, ex)    L = width + height

    Inclusion and exclusion: there are b (b - 1) pairs in rows, as many in columns, and (b - 1)^2
    unit squares, each with two diagonals, four triples, one four. With sums of common(M) / S of
    each kind:

        union / S = b^2 - b (b - 1) (pairs) + (b - 1)^2 (triples - diagonals - four)

    This is exact for b = 2. For larger b a block counts once for each 8-connected group of covered
    centres, so slivers that cover several groups of centres in a block are overestimated.

    There are no branches, so that `weigh_triangles` evaluates eight triangles at a time. Zero area
    gives 0: L / 0 is infinite or NaN, so no area is in common.
    """
    ux, uy, vx, vy, wx, wy = bx - ax, by - ay, cx - bx, cy - by, ax - cx, ay - cy
    cross = ux * vy - uy * vx  # 2 S
    sign = 1.0 if cross >= 0.0 else -1.0
    cross = abs(cross)  # also turns -0.0 into 0.0: L / -0.0 would be -inf
    ux, uy, vx, vy, wx, wy = sign * ux, sign * uy, sign * vx, sign * vy, sign * wx, sign * wy
    width = max(ax, bx, cx) - min(ax, bx, cx)
    height = max(ay, by, cy) - min(ay, by, cy)
    falling = max(ax - ay, bx - by, cx - cy) - min(ax - ay, bx - by, cx - cy)
    rising = max(ax + ay, bx + by, cx + cy) - min(ax + ay, bx + by, cx + cy)
    pairs = _find_common_share(width, cross) + _find_common_share(height, cross)
    diagonals = _find_common_share(falling, cross) + _find_common_share(rising, cross)
    triples = _find_common_share(_sum_triple(-uy, -ux, -vy, -vx, -wy, -wx), cross)
    triples += _find_common_share(_sum_triple(-uy, ux, -vy, vx, -wy, wx), cross)
    triples += _find_common_share(_sum_triple(uy, -ux, vy, -vx, wy, -wx), cross)
    triples += _find_common_share(_sum_triple(uy, ux, vy, vx, wy, wx), cross)
    inner = size - 1.0
    squares = triples - diagonals - _find_common_share(width + height, cross)
    share = size * size - size * inner * pairs + inner * inner * squares
    return 0.5 * cross * share / (size * size)


@njit(forceinline=True, error_model="numpy")
def expected_quads(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the mean number of 2x2 pixel quads with a covered pixel centre (Q)."""
    return _average_blocks(2.0, ax, ay, bx, by, cx, cy)


@njit(forceinline=True, error_model="numpy")
def expected_blocks(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the mean number of 4x4 pixel blocks with a covered pixel centre (P)."""
    return _average_blocks(4.0, ax, ay, bx, by, cx, cy)


@njit
def expected_setups(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the probability that a randomly placed bounding box contains a pixel centre (R)."""
    width = max(ax, bx, cx) - min(ax, bx, cx)
    height = max(ay, by, cy) - min(ay, by, cy)
    return min(width, 1.0) * min(height, 1.0)


@njit
def weigh_triangle(
    weights: np.ndarray, ax: float, ay: float, bx: float, by: float, cx: float, cy: float
) -> float:
    """Return the weighted sum of a triangle's features; weights (k,) in the order of `FEATURES`."""
    # Unrolled: a loop over a tuple of functions and a chain of closures both took two to three
    # times as long in the optimiser, which calls this for every triple of vertices.
    total: float = weights[0]
    if weights[1] != 0.0:
        total += weights[1] * area(ax, ay, bx, by, cx, cy)
    if weights[2] != 0.0:
        total += weights[2] * half_perimeter(ax, ay, bx, by, cx, cy)
    if weights[3] != 0.0:
        total += weights[3] * bbox_area(ax, ay, bx, by, cx, cy)
    if weights[4] != 0.0:
        total += weights[4] * edge_length(ax, ay, bx, by, cx, cy)
    if weights[5] != 0.0:
        total += weights[5] * shape(ax, ay, bx, by, cx, cy)
    if weights[6] != 0.0:
        total += weights[6] * beauty(ax, ay, bx, by, cx, cy)
    if weights[7] != 0.0:
        total += weights[7] * expected_quads(ax, ay, bx, by, cx, cy)
    if weights[8] != 0.0:
        total += weights[8] * expected_blocks(ax, ay, bx, by, cx, cy)
    if weights[9] != 0.0:
        total += weights[9] * expected_setups(ax, ay, bx, by, cx, cy)
    return total


@njit(nogil=True, inline="always")
def _add_feature(
    feature: Any, weight: float, corners: tuple[np.ndarray, ...], count: int, totals: np.ndarray
) -> None:
    ax, ay, bx, by, cx, cy = corners
    if weight != 0.0:
        for k in range(np.uint64(count)):
            totals[k] += weight * feature(ax[k], ay[k], bx[k], by[k], cx[k], cy[k])


@njit(nogil=True, error_model="numpy")
def weigh_triangles(
    weights: np.ndarray, corners: tuple[np.ndarray, ...], count: int, totals: np.ndarray
) -> None:
    """Write the results of `weigh_triangle` for `count` triangles to `totals`, equal in every bit.

    corners: arrays ax, ay, bx, by, cx, cy; all arrays have room for the count, rounded up to a
    multiple of 8. The loops have no branches, so LLVM uses SIMD registers, except for `shape` and
    `beauty`: expected quads take 4 ns per triangle, not 25 (AVX-512).
    """
    lanes = (count + 7) & ~7
    for k in range(lanes):
        totals[k] = weights[0]
    _add_feature(area, weights[1], corners, lanes, totals)
    _add_feature(half_perimeter, weights[2], corners, lanes, totals)
    _add_feature(bbox_area, weights[3], corners, lanes, totals)
    _add_feature(edge_length, weights[4], corners, lanes, totals)
    _add_feature(shape, weights[5], corners, count, totals)
    _add_feature(beauty, weights[6], corners, count, totals)
    _add_feature(expected_quads, weights[7], corners, lanes, totals)
    _add_feature(expected_blocks, weights[8], corners, lanes, totals)
    _add_feature(expected_setups, weights[9], corners, lanes, totals)


@njit
def sum_features(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return the sum (k,) of each feature over triangles (m, 3) of points (n, 2)."""
    sums = np.zeros(FEATURE_COUNT)
    for row in range(len(triangles)):
        a, b, c = triangles[row, 0], triangles[row, 1], triangles[row, 2]
        ax, ay = points[a, 0], points[a, 1]
        bx, by = points[b, 0], points[b, 1]
        cx, cy = points[c, 0], points[c, 1]
        sums[0] += 1.0
        sums[1] += area(ax, ay, bx, by, cx, cy)
        sums[2] += half_perimeter(ax, ay, bx, by, cx, cy)
        sums[3] += bbox_area(ax, ay, bx, by, cx, cy)
        sums[4] += edge_length(ax, ay, bx, by, cx, cy)
        sums[5] += shape(ax, ay, bx, by, cx, cy)
        sums[6] += beauty(ax, ay, bx, by, cx, cy)
        sums[7] += expected_quads(ax, ay, bx, by, cx, cy)
        sums[8] += expected_blocks(ax, ay, bx, by, cx, cy)
        sums[9] += expected_setups(ax, ay, bx, by, cx, cy)
    return sums


@njit
def sum_features_of_many(
    coords: np.ndarray,
    vertex_offsets: np.ndarray,
    triangles: np.ndarray,
    triangle_offsets: np.ndarray,
) -> np.ndarray:
    """Return the sums (p, k) of features of p polygons' triangles, added as by `sum_features`."""
    sums = np.empty((len(vertex_offsets) - 1, FEATURE_COUNT))
    for polygon in range(len(sums)):
        points = coords[vertex_offsets[polygon] : vertex_offsets[polygon + 1]]
        rows = triangles[triangle_offsets[polygon] : triangle_offsets[polygon + 1]]
        sums[polygon] = sum_features(points, rows)
    return sums


_UNIT, _HALF = 256, 128  # a pixel, and half a pixel, in units of 1/256 px


@njit(inline="always")
def _restrict_span(value: int, step: int, low: int, high: int) -> tuple[int, int]:
    """Return the pixels x in low..high with step * x <= value, as a span; empty if high < low."""
    if step > 0:
        return low, min(high, value // step)
    if step < 0:
        return max(low, -(value // -step)), high
    return (low, high) if value >= 0 else (low, low - 1)


@njit(error_model="numpy")
def exact_quads(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return the number of 2x2 pixel quads with a covered pixel, at the triangle's position.

    Coordinates are pixels, y up, rounded to units of 1/256. A pixel is covered if the centre, at
    (128, 128), is inside all edges of the counter-clockwise triangle, or on a left edge (running
    down) or a bottom edge (horizontal, running right): the top-left rule of Direct3D and of Mesa,
    with y up.

    Derivation. The edge function of a-b at the centre of pixel (x, y) is

        (bx - ax) * (256 y + 128 - ay) - (by - ay) * (256 x + 128 - ax) = value(y) - step * x,

    with step = 256 (by - ay). An edge whose points are not covered is shifted by a unit, so inside
    is >= 0 for all edges. In a row, an edge admits all x up to a maximum (step > 0), all x from a
    minimum (step < 0), or all or none: one floor division per edge. The intersection is a span.
    Rows are visited in pairs, from the lowest y. The quads of two rows are the pairs of columns
    that either span touches: the sum of both lengths in pairs, minus the overlap.

    Integers. Coordinates below 2^14 px are below 2^22 units, products below 2^45.
    """
    x0, y0 = int(np.rint(ax * _UNIT)), int(np.rint(ay * _UNIT))
    x1, y1 = int(np.rint(bx * _UNIT)), int(np.rint(by * _UNIT))
    x2, y2 = int(np.rint(cx * _UNIT)), int(np.rint(cy * _UNIT))
    doubled = (x1 - x0) * (y2 - y0) - (y1 - y0) * (x2 - x0)
    if doubled == 0:
        return 0.0
    if doubled < 0:
        x1, y1, x2, y2 = x2, y2, x1, y1
    min_x, max_x = -((_HALF - min(x0, x1, x2)) // _UNIT), (max(x0, x1, x2) - _HALF) // _UNIT
    first, last = -((_HALF - min(y0, y1, y2)) // _UNIT), (max(y0, y1, y2) - _HALF) // _UNIT
    if min_x > max_x:
        return 0.0
    # Each edge function in row 0, minus 1 if points on the edge are not covered.
    u0, v0, u1, v1, u2, v2 = x1 - x0, y1 - y0, x2 - x1, y2 - y1, x0 - x2, y0 - y2
    c0 = u0 * (_HALF - y0) - v0 * (_HALF - x0) - (0 if v0 < 0 or (v0 == 0 and u0 > 0) else 1)
    c1 = u1 * (_HALF - y1) - v1 * (_HALF - x1) - (0 if v1 < 0 or (v1 == 0 and u1 > 0) else 1)
    c2 = u2 * (_HALF - y2) - v2 * (_HALF - x2) - (0 if v2 < 0 or (v2 == 0 and u2 > 0) else 1)
    total, before_low, before_high = 0, 0, -1
    for y in range(first & ~1, last + 1):
        low, high = min_x, max_x if y >= first else min_x - 1
        low, high = _restrict_span(c0 + _UNIT * u0 * y, _UNIT * v0, low, high)
        low, high = _restrict_span(c1 + _UNIT * u1 * y, _UNIT * v1, low, high)
        low, high = _restrict_span(c2 + _UNIT * u2 * y, _UNIT * v2, low, high)
        if low > high:
            low, high = 0, -1
        else:
            low, high = low >> 1, high >> 1
            total += high - low + 1
        if y % 2 == 1:
            total -= max(0, min(high, before_high) - max(low, before_low) + 1)
        before_low, before_high = low, high
    return float(total)
