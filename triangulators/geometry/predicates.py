"""The orientation predicate, with an exact sign for doubles up to 1e150 (no overflow).

A float64 filter decides almost all calls (all, for multiples of 1/256 below 2^14); an expansion, a
sum of doubles that do not overlap, decides the others exactly. If products would underflow, all
coordinates are scaled up first. Products of two coordinates that are both below 1e-290 of the
largest coordinate may still underflow, and count as 0. Source: J. R. Shewchuk, "Adaptive Precision
Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997.
"""

import math

import numpy as np

from triangulators.compute.kernels import njit

# (3 + 16 eps) eps with eps = 2^-53: Shewchuk's bound on the error of the plain determinant.
ORIENTATION_FILTER = 3.3306690738754716e-16
_MIN_PRODUCT = 1e-250  # the rounding error of a larger product is representable
_NO_UNDERFLOW = 1e-125  # products of two larger numbers exceed _MIN_PRODUCT
_MIN_ACCURATE_SHARE = 1e-4  # above this share of its products a determinant has eleven digits
_SPLITTER = 134217729.0  # 2^27 + 1: splits a double into two halves of 26 bits (Dekker)


@njit(nogil=True)
def _multiply_exactly(a: float, b: float) -> tuple[float, float]:
    """Return (rounded product, error), whose sum is exactly a * b (Dekker's algorithm)."""
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
def _add_to_expansion(expansion: np.ndarray, length: int, value: float) -> int:
    """Add `value` in place to an expansion; return its new length (Shewchuk's GROW-EXPANSION)."""
    carry = value
    size = 0
    for index in range(length):
        term = expansion[index]
        total = carry + term
        virtual = total - carry
        error = (carry - (total - virtual)) + (term - virtual)
        carry = total
        if error != 0.0:
            expansion[size] = error
            size += 1
    if carry != 0.0 or size == 0:
        expansion[size] = carry
        size += 1
    return size


@njit(nogil=True)
def _orient_exactly(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return `orient` by an expansion, after scaling coordinates whose products would underflow."""
    largest, smallest = 0.0, np.inf
    for x in (ax, ay, bx, by, cx, cy):
        largest = max(largest, abs(x))
        smallest = abs(x) if 0.0 < abs(x) < smallest else smallest
    if smallest >= _NO_UNDERFLOW:
        return _orient_by_expansion(ax, ay, bx, by, cx, cy)
    # Scale by a power of two, which is exact: the largest becomes 2^500, far above underflow.
    up = 2.0 ** (500 - np.ceil(np.log2(largest))) if largest > 2.0**-500 else 2.0**1000
    scaled = _orient_by_expansion(ax * up, ay * up, bx * up, by * up, cx * up, cy * up)
    down = scaled / up / up
    return down if down != 0.0 or scaled == 0.0 else np.copysign(5e-324, scaled)


@njit(nogil=True)
def _orient_by_expansion(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    expansion = np.empty(13)
    length = 0
    for first, second in ((ax, by), (-ax, cy), (-cx, by), (-ay, bx), (ay, cx), (cy, bx)):
        rounded, error = _multiply_exactly(first, second)
        length = _add_to_expansion(expansion, length, error)
        length = _add_to_expansion(expansion, length, rounded)
    # The terms do not overlap, so the last term has the sign, and at least half of the value.
    total = 0.0
    for index in range(length):
        total += expansion[index]
    return total


@njit(nogil=True)
def _have_exact_differences(a: float, b: float, c: float, d: float) -> bool:
    x = a - b
    virtual = a - x
    if (a - (x + virtual)) + (virtual - b) != 0.0:
        return False
    x = c - d
    virtual = c - x
    return (c - (x + virtual)) + (virtual - d) == 0.0


@njit(nogil=True)
def _orient_in_doubt(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, plus: float, minus: float
) -> float:
    """Evaluate `orient` in doubt; separate, so that `orient` is short enough for LLVM to inline."""
    if (
        _have_exact_differences(ax, cx, by, cy)
        and _have_exact_differences(ay, cy, bx, cx)
        and (abs(plus) > _MIN_PRODUCT or ax == cx or by == cy)
        and (abs(minus) > _MIN_PRODUCT or ay == cy or bx == cx)
    ):
        plus, plus_error = _multiply_exactly(ax - cx, by - cy)
        minus, minus_error = _multiply_exactly(ay - cy, bx - cx)
        determinant = (plus - minus) + (plus_error - minus_error)
        if determinant != 0.0 or plus == minus:
            return determinant
    return _orient_exactly(ax, ay, bx, by, cx, cy)


@njit(nogil=True)
def orient(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return twice the signed area of a, b, c, positive for a left turn; the sign is exact."""
    plus = (ax - cx) * (by - cy)
    minus = (ay - cy) * (bx - cx)
    determinant = plus - minus
    if abs(determinant) > ORIENTATION_FILTER * (abs(plus) + abs(minus)) + _MIN_PRODUCT:
        return determinant
    return _orient_in_doubt(ax, ay, bx, by, cx, cy, plus, minus)


@njit(nogil=True)
def twice_area(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    """Return twice the area of a, b, c, with eleven correct digits, also for slivers."""
    plus = (bx - ax) * (cy - ay)
    minus = (by - ay) * (cx - ax)
    if abs(plus - minus) > _MIN_ACCURATE_SHARE * (abs(plus) + abs(minus)) + _MIN_PRODUCT:
        return abs(plus - minus)
    return abs(_orient_exactly(ax, ay, bx, by, cx, cy))


@njit(nogil=True)
def orientation(points: np.ndarray, a: int, b: int, c: int) -> float:
    """Return `orient` of three rows of points (n, 2)."""
    return orient(
        points[a, 0], points[a, 1], points[b, 0], points[b, 1], points[c, 0], points[c, 1]
    )


@njit(nogil=True)
def compute_orientations(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return `orientation` (m,) of each triangle (m, 3)."""
    result = np.empty(len(triangles))
    for index in range(len(triangles)):
        result[index] = orientation(
            points, triangles[index, 0], triangles[index, 1], triangles[index, 2]
        )
    return result


@njit(nogil=True)
def is_on_segment(points: np.ndarray, v: int, a: int, b: int, tolerance: float) -> bool:
    """Whether vertex `v` lies on the open segment a-b, to within `tolerance` times |b - a|."""
    dx = points[b, 0] - points[a, 0]
    dy = points[b, 1] - points[a, 1]
    along = (points[v, 0] - points[a, 0]) * dx + (points[v, 1] - points[a, 1]) * dy
    length2 = dx * dx + dy * dy
    if along <= 0.0 or along >= length2:
        return False
    return bool(abs(orientation(points, a, b, v)) <= tolerance * np.sqrt(length2))


@njit(nogil=True)
def find_touching_vertices(
    points: np.ndarray, edges: np.ndarray, vertices: np.ndarray, allowed: float
) -> list[tuple[int, int]]:
    """Return (row of `edges`, vertex) of vertices inside an edge; vertices (k,): by ascending x."""
    incidences = [(0, 0) for _ in range(0)]
    x_of = points[vertices, 0]
    for edge in range(len(edges)):
        a, b = edges[edge]
        low_x = min(points[a, 0], points[b, 0]) - allowed
        high_x = max(points[a, 0], points[b, 0]) + allowed
        low_y = min(points[a, 1], points[b, 1]) - allowed
        high_y = max(points[a, 1], points[b, 1]) + allowed
        for index in range(np.searchsorted(x_of, low_x), len(vertices)):
            v = vertices[index]
            if x_of[index] > high_x:
                break
            near = low_y <= points[v, 1] <= high_y and v not in (a, b)
            if near and is_on_segment(points, v, a, b, allowed):
                incidences.append((edge, v))
    return incidences


@njit(nogil=True)
def find_bounding_box(points: np.ndarray) -> tuple[float, float, float, float]:
    """Return min x, min y, width and height of points (n, 2)."""
    low_x = high_x = points[0, 0]
    low_y = high_y = points[0, 1]
    for k in range(1, len(points)):
        low_x, high_x = min(low_x, points[k, 0]), max(high_x, points[k, 0])
        low_y, high_y = min(low_y, points[k, 1]), max(high_y, points[k, 1])
    return low_x, low_y, high_x - low_x, high_y - low_y


@njit(nogil=True)
def find_grid_unit(points: np.ndarray) -> float:
    """Return the largest power of two that all coordinates (n, 2) are multiples of, or 0.0.

    0.0 means that the points are not on a grid: their span exceeds 2^24 units. On a grid, float64
    determinants are exact: differences fit 25 bits and products 50.
    """
    _, _, w, h = find_bounding_box(points)
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


def find_edge_tolerance(points: np.ndarray) -> float:
    """Return the distance from an edge up to which a vertex counts as on the edge; 0 on a grid."""
    return 0.0 if find_grid_unit(points) > 0.0 else float(np.abs(points).max()) * 4.0 * 2.0**-52


@njit(nogil=True)
def do_segments_cross(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the segments a-b and c-d cross at an inner point of both."""
    ax, bx, cx, dx = points[a, 0], points[b, 0], points[c, 0], points[d, 0]
    if max(cx, dx) < min(ax, bx) or min(cx, dx) > max(ax, bx):
        return False
    ay, by, cy, dy = points[a, 1], points[b, 1], points[c, 1], points[d, 1]
    if max(cy, dy) < min(ay, by) or min(cy, dy) > max(ay, by):
        return False
    if a in (c, d) or b in (c, d):
        return False
    # Signs are compared, not multiplied: a product of determinants may underflow.
    side_c, side_d = orientation(points, a, b, c), orientation(points, a, b, d)
    if not (min(side_c, side_d) < 0.0 < max(side_c, side_d)):
        return False
    side_a, side_b = orientation(points, c, d, a), orientation(points, c, d, b)
    return min(side_a, side_b) < 0.0 < max(side_a, side_b)
