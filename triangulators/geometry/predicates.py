"""The orientation predicate, exact in sign for doubles up to 1e150 (no overflow).

Where products would fall below what a double holds, all is scaled up first. That reaches down to
1e-290 of the largest coordinate: what two smaller ones have as their product counts as nothing.

A float64 filter decides almost all calls; the rest are evaluated without rounding as an expansion.
Source: J. R. Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric
Predicates", 1997. On coordinates snapped to 1/256 below 2^14 the filter itself is already exact.
"""

import math

import numpy as np

from triangulators.compute.kernels import njit

# (3 + 16 eps) eps with eps = 2^-53: Shewchuk's bound on the error of the plain determinant.
FILTER = 3.3306690738754716e-16
_NEARLY_NOTHING = 1e-250  # a product above it has an error that float64 holds
_NO_UNDERFLOW = 1e-125  # its square does not fall below that
_ACCURATE = 1e-4  # share of its products that a determinant keeps, which so has eleven digits
_SPLITTER = 134217729.0  # 2^27 + 1


@njit(nogil=True)
def _product(a: float, b: float) -> tuple[float, float]:
    """Return a * b as (rounded, error), exactly (Dekker)."""
    rounded = a * b
    c = _SPLITTER * a
    a_high = c - (c - a)
    a_low = a - a_high
    c = _SPLITTER * b
    b_high = c - (c - b)
    b_low = b - b_high
    error = ((a_high * b_high - rounded) + a_high * b_low + a_low * b_high) + a_low * b_low
    return rounded, error


@njit(nogil=True)
def _grow(expansion: np.ndarray, length: int, value: float) -> int:
    """Add `value` to a non-overlapping expansion in place; return its new length."""
    carry = value
    kept = 0
    for index in range(length):
        term = expansion[index]
        total = carry + term
        virtual = total - carry
        error = (carry - (total - virtual)) + (term - virtual)
        carry = total
        if error != 0.0:
            expansion[kept] = error
            kept += 1
    if carry != 0.0 or kept == 0:
        expansion[kept] = carry
        kept += 1
    return kept


@njit(nogil=True)
def _exact(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    largest, least = 0.0, np.inf
    for x in (ax, ay, bx, by, cx, cy):
        largest = max(largest, abs(x))
        least = abs(x) if 0.0 < abs(x) < least else least
    if least >= _NO_UNDERFLOW:
        return _expanded(ax, ay, bx, by, cx, cy)
    # Powers of two change no digit: make the largest 2^500, so that its products have room below.
    up = 2.0 ** (500 - np.ceil(np.log2(largest))) if largest > 2.0**-500 else 2.0**1000
    found = _expanded(ax * up, ay * up, bx * up, by * up, cx * up, cy * up)
    down = found / up / up
    return down if down != 0.0 or found == 0.0 else np.copysign(5e-324, found)


@njit(nogil=True)
def _expanded(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    expansion = np.empty(13)
    length = 0
    for left, right in ((ax, by), (-ax, cy), (-cx, by), (-ay, bx), (ay, cx), (cy, bx)):
        rounded, error = _product(left, right)
        length = _grow(expansion, length, error)
        length = _grow(expansion, length, rounded)
    # Components do not overlap: the last has the sign, the others up to half of the value.
    total = 0.0
    for index in range(length):
        total += expansion[index]
    return total


@njit(nogil=True)
def _exact_difference(a: float, b: float, c: float, d: float) -> bool:
    """Whether a - b and c - d are free of rounding errors."""
    x = a - b
    virtual = a - x
    if (a - (x + virtual)) + (virtual - b) != 0.0:
        return False
    x = c - d
    virtual = c - x
    return (c - (x + virtual)) + (virtual - d) == 0.0


@njit(nogil=True)
def _in_doubt(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, left: float, right: float
) -> float:
    """Return `orient` where left - right, its determinant's products, may have the wrong sign.

    Apart from it, so that it is short enough for LLVM to make it part of a loop.
    """
    if (
        _exact_difference(ax, cx, by, cy)
        and _exact_difference(ay, cy, bx, cx)
        and (abs(left) > _NEARLY_NOTHING or ax == cx or by == cy)
        and (abs(right) > _NEARLY_NOTHING or ay == cy or bx == cx)
    ):
        left, left_error = _product(ax - cx, by - cy)
        right, right_error = _product(ay - cy, bx - cx)
        determinant = (left - right) + (left_error - right_error)
        if determinant != 0.0 or left == right:
            return determinant
    return _exact(ax, ay, bx, by, cx, cy)


@njit(nogil=True)
def orient(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return twice the signed area of a, b, c: positive if they turn left; exact in sign."""
    left = (ax - cx) * (by - cy)
    right = (ay - cy) * (bx - cx)
    determinant = left - right
    if abs(determinant) > FILTER * (abs(left) + abs(right)) + _NEARLY_NOTHING:
        return determinant
    return _in_doubt(ax, ay, bx, by, cx, cy, left, right)


@njit(nogil=True)
def twice_area(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return twice the area of a, b, c, to eleven digits, also of slivers.

    Rounding leaves few digits of a sliver's determinant, others for each corner it begins with.
    """
    left = (bx - ax) * (cy - ay)
    right = (by - ay) * (cx - ax)
    if abs(left - right) > _ACCURATE * (abs(left) + abs(right)) + _NEARLY_NOTHING:
        return abs(left - right)
    return abs(_exact(ax, ay, bx, by, cx, cy))


@njit(nogil=True)
def turn(points: np.ndarray, a: int, b: int, c: int) -> float:
    """`orient` of three rows of `points`."""
    return orient(
        points[a, 0], points[a, 1], points[b, 0], points[b, 1], points[c, 0], points[c, 1]
    )


@njit(nogil=True)
def turns(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """`turn` of every triangle, shape (m,)."""
    result = np.empty(len(triangles))
    for index in range(len(triangles)):
        result[index] = turn(points, triangles[index, 0], triangles[index, 1], triangles[index, 2])
    return result


ALL_LEFT, NOT_ALL_LEFT, OUTSIDE = range(3)


@njit(nogil=True)
def all_left(points: np.ndarray, triangles: np.ndarray) -> int:
    """Return ALL_LEFT, NOT_ALL_LEFT, or OUTSIDE where an index is not one of a point."""
    count = len(points)
    result = ALL_LEFT
    for row in range(len(triangles)):
        a, b, c = triangles[row, 0], triangles[row, 1], triangles[row, 2]
        if min(a, b, c) < 0 or max(a, b, c) >= count:
            return OUTSIDE
        if turn(points, a, b, c) <= 0.0:
            result = NOT_ALL_LEFT
    return result


@njit(nogil=True)
def on_segment(points: np.ndarray, v: int, a: int, b: int, tolerance: float) -> bool:
    """Whether vertex `v` lies on the open segment a-b, to within `tolerance` times its length."""
    dx = points[b, 0] - points[a, 0]
    dy = points[b, 1] - points[a, 1]
    along = (points[v, 0] - points[a, 0]) * dx + (points[v, 1] - points[a, 1]) * dy
    length2 = dx * dx + dy * dy
    if along <= 0.0 or along >= length2:
        return False
    return bool(abs(turn(points, a, b, v)) <= tolerance * np.sqrt(length2))


@njit(nogil=True)
def touching(
    points: np.ndarray, edges: np.ndarray, vertices: np.ndarray, allowed: float
) -> list[tuple[int, int]]:
    """Return (edge, vertex) for each of the vertices (k,) that lies inside an edge (b, 2).

    vertices: in ascending order of x, so that few are looked at for a short edge.
    """
    found = [(0, 0) for _ in range(0)]
    x_of = points[vertices, 0]
    for edge in range(len(edges)):
        a, b = edges[edge]
        low_x = min(points[a, 0], points[b, 0]) - allowed
        high_x = max(points[a, 0], points[b, 0]) + allowed
        low_y = min(points[a, 1], points[b, 1]) - allowed
        high_y = max(points[a, 1], points[b, 1]) + allowed
        for place in range(np.searchsorted(x_of, low_x), len(vertices)):
            v = vertices[place]
            if x_of[place] > high_x:
                break
            near = low_y <= points[v, 1] <= high_y and v not in (a, b)
            if near and on_segment(points, v, a, b, allowed):
                found.append((edge, v))
    return found


@njit(nogil=True)
def box_of(points: np.ndarray) -> tuple[float, float, float, float]:
    """Return the least x and y of points, their width and their height."""
    low_x = high_x = points[0, 0]
    low_y = high_y = points[0, 1]
    for k in range(1, len(points)):
        low_x, high_x = min(low_x, points[k, 0]), max(high_x, points[k, 0])
        low_y, high_y = min(low_y, points[k, 1]), max(high_y, points[k, 1])
    return low_x, low_y, high_x - low_x, high_y - low_y


@njit(nogil=True)
def grid_unit(points: np.ndarray) -> float:
    """Return the largest power of two that all coordinates (n, 2) are multiples of.

    0.0 if there is none of which they span at most 2^24. Where there is one, plain float64
    determinants are exact: differences fit 25 bits and products 50. Frames snapped to 1/256 px
    always have one.
    """
    _, _, w, h = box_of(points)
    span = max(w, h)
    if not 1e-290 < span < 1e300:
        return 0.0
    mantissa, exponent = math.frexp(span)
    if mantissa == 0.5:
        exponent -= 1
    scale = math.ldexp(1.0, 24 - exponent)
    bits = np.int64(0)
    for k in range(len(points)):
        x, y = points[k, 0] * scale, points[k, 1] * scale
        if x != np.rint(x) or y != np.rint(y) or max(abs(x), abs(y)) >= 4503599627370496.0:
            return 0.0
        bits |= np.int64(x) | np.int64(y)
    return float(bits & -bits) / scale


def tolerance(points: np.ndarray) -> float:
    """How far off an edge, in its units, a vertex may lie and still count as on it.

    Zero where float64 determinants are exact; otherwise the rounding error of a coordinate.
    """
    return 0.0 if grid_unit(points) > 0.0 else float(np.abs(points).max()) * 4.0 * 2.0**-52


@njit(nogil=True)
def cross(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the open segments a-b and c-d cross in a point inside both."""
    ax, bx, cx, dx = points[a, 0], points[b, 0], points[c, 0], points[d, 0]
    if max(cx, dx) < min(ax, bx) or min(cx, dx) > max(ax, bx):
        return False
    ay, by, cy, dy = points[a, 1], points[b, 1], points[c, 1], points[d, 1]
    if max(cy, dy) < min(ay, by) or min(cy, dy) > max(ay, by):
        return False
    if a in (c, d) or b in (c, d):
        return False
    # By signs, not by their product, which may underflow.
    of_c, of_d = turn(points, a, b, c), turn(points, a, b, d)
    if not (min(of_c, of_d) < 0.0 < max(of_c, of_d)):
        return False
    of_a, of_b = turn(points, c, d, a), turn(points, c, d, b)
    return min(of_a, of_b) < 0.0 < max(of_a, of_b)
