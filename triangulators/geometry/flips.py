"""Flips of diagonals, in the order that all language ports share (see ports/ORDER.md).

A flip replaces the diagonal of a strictly convex quadrilateral, of two triangles that share an
edge, by the other diagonal. It decreases a sum or a length, so no triangulation occurs twice, and
flips terminate. Both new triangles must certainly have the orientation of the old triangles. For
integer coordinates up to 2^25 orientations are exact; for others, a filter rejects flips that
depend on rounding.

Sources: C. L. Lawson, "Software for C1 surface interpolation", 1977; the order of `refine` in npm's
earcut 3.2.4. HelperLaneViz, 2025, flips to shorter diagonals after ear clipping.
"""

from typing import Any

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.half_edges import link_half_edges, next_edge, previous_edge
from triangulators.geometry.order import put_in_walk_order_by_twins

_MAX_INTEGER = 2.0**25  # orientations and lengths of integer coordinates up to this are exact
_UNDERFLOW = 1e-300  # exceeds the error that underflow causes in a product


@njit(nogil=True)
def push_diagonals(twin: np.ndarray, stack: np.ndarray, waiting: np.ndarray) -> int:
    """Push the lower half-edge of each diagonal, by ascending higher half-edge; return the size."""
    size = 0
    for latter in range(len(twin)):
        former = twin[latter]
        if 0 <= former < latter:
            waiting[former] = True
            stack[size] = former
            size += 1
    return size


@njit(nogil=True)
def flip_edge(
    corner: np.ndarray, twin: np.ndarray, e: int, stack: np.ndarray, waiting: np.ndarray, size: int
) -> int:
    """Flip the diagonal of half-edge e, push the quadrilateral's sides; return the stack's size."""
    f: Any = np.int64(twin[e])
    e2, f2 = previous_edge(e), previous_edge(f)
    corner[e], corner[f] = corner[f2], corner[e2]
    below, above = twin[f2], twin[e2]
    twin[e], twin[f], twin[e2], twin[f2] = below, above, f2, e2
    if below >= 0:
        twin[below] = e
    if above >= 0:
        twin[above] = f
    for side in (e, f, next_edge(e), next_edge(f)):
        if twin[side] >= 0 and not waiting[side]:
            waiting[side] = True
            stack[size] = side
            size += 1
    return size


@njit(nogil=True, inline="always")
def flip_while_gaining(
    points: np.ndarray,
    corner: np.ndarray,
    twin: np.ndarray,
    gains: Any,
    is_convex: Any,
    context: Any,
) -> int:
    """Flip in place until no flip gains; return the number of flips.

    gains(points, a, b, c, d, context): whether the diagonal a-d is better than b-c, the common edge
    of the triangles a, b, c and d, c, b. All diagonals are pushed on a stack; the top one is tried.
    A flip takes constant time and pushes the sides of the quadrilateral, except those on the stack
    (`waiting`), so it cannot overflow. Invariant: diagonals that are not on the stack do not gain.
    """
    stack = np.empty(len(corner), dtype=np.int32)
    waiting = np.zeros(len(corner), dtype=np.bool_)
    size = push_diagonals(twin, stack, waiting)
    flips = 0
    while size > 0:
        size -= 1
        e: Any = np.int64(stack[size])
        waiting[e] = False
        f: Any = np.int64(twin[e])
        if f < 0:
            continue
        a, b, c, d = corner[previous_edge(e)], corner[e], corner[f], corner[previous_edge(f)]
        if gains(points, a, b, c, d, context) and is_convex(points, a, b, c, d):
            flips += 1
            size = flip_edge(corner, twin, e, stack, waiting, size)
    return flips


@njit(nogil=True)
def _are_all_integers(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    for point in (a, b, c, d):
        for value in (points[point, 0], points[point, 1]):
            if not (abs(value) <= _MAX_INTEGER and value == np.floor(value)):
                return False
    return True


@njit(nogil=True)
def is_convex(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the triangles a, b, d and a, d, c certainly have the same nonzero orientation."""
    ax, ay = points[a, 0], points[a, 1]
    x, y = points[d, 0] - ax, points[d, 1] - ay
    p, q = (points[b, 0] - ax) * y, (points[b, 1] - ay) * x
    r, s = x * (points[c, 1] - ay), y * (points[c, 0] - ax)
    first, second = p - q, r - s
    if not ((first > 0.0 and second > 0.0) or (first < 0.0 and second < 0.0)):
        return False
    return (
        abs(first) > 4e-16 * (abs(p) + abs(q)) + _UNDERFLOW
        and abs(second) > 4e-16 * (abs(r) + abs(s)) + _UNDERFLOW
    ) or _are_all_integers(points, a, b, c, d)


@njit(nogil=True)
def _is_shorter_l1(points: np.ndarray, a: int, b: int, c: int, d: int, _: Any) -> bool:
    new = abs(points[d, 0] - points[a, 0]) + abs(points[d, 1] - points[a, 1])
    return bool(new < abs(points[c, 0] - points[b, 0]) + abs(points[c, 1] - points[b, 1]))


@njit(nogil=True)
def _is_shorter(points: np.ndarray, a: int, b: int, c: int, d: int, _: Any) -> bool:
    x, y = points[d, 0] - points[a, 0], points[d, 1] - points[a, 1]
    u, v = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1]
    return bool(x * x + y * y < u * u + v * v)


@njit(nogil=True)
def _is_in_circle(points: np.ndarray, a: int, b: int, c: int, d: int, winding: float) -> bool:
    """Whether d is certainly inside the circle through a, b, c (counter-clockwise if winding > 0).

    With s the sum of the squared distances of a, b and c from d, the rounding error of the
    determinant is below 4e-16 s^2. For integers s is at most 3 * 2^53; if the sign is in doubt, the
    exact determinant is below 1.4e-15 s^2 < 2^60: 64-bit sums, exact modulo 2^64, give its value.
    """
    px, py = points[a, 0] - points[d, 0], points[a, 1] - points[d, 1]
    qx, qy = points[b, 0] - points[d, 0], points[b, 1] - points[d, 1]
    rx, ry = points[c, 0] - points[d, 0], points[c, 1] - points[d, 1]
    p, q, r = px * px + py * py, qx * qx + qy * qy, rx * rx + ry * ry
    i, j, k = qx * ry - qy * rx, rx * py - ry * px, px * qy - py * qx
    inside, size = (p * i + q * j + r * k) * winding, p + q + r
    if abs(inside) > 1e-15 * size * size + _UNDERFLOW:
        return bool(inside > 0.0)
    if not _are_all_integers(points, a, b, c, d):
        return False
    exact = np.int64(p) * np.int64(i) + np.int64(q) * np.int64(j) + np.int64(r) * np.int64(k)
    return bool(exact * winding > 0.0)


@njit(nogil=True)
def _is_in_circle_as_earcut(points: np.ndarray, a: int, b: int, c: int, d: int, _: Any) -> bool:
    """Whether d is in the circle a, b, c, with the operations and tolerance of earcut 3.2.4."""
    px, py = points[a, 0] - points[d, 0], points[a, 1] - points[d, 1]
    qx, qy = points[b, 0] - points[d, 0], points[b, 1] - points[d, 1]
    rx, ry = points[c, 0] - points[d, 0], points[c, 1] - points[d, 1]
    p, q, r = px * px + py * py, qx * qx + qy * qy, rx * rx + ry * ry
    size = p + q + r
    inside = px * (qy * r - q * ry) - py * (qx * r - q * rx) + p * (qx * ry - qy * rx)
    return not inside <= 1e-13 * size * size


@njit(nogil=True)
def _is_convex_as_earcut(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    """Whether a, b, d and a, d, c turn left, with the operations of npm's earcut 3.2.4 in order."""
    ax, ay = points[a, 0], points[a, 1]
    x, y = points[d, 0] - ax, points[d, 1] - ay
    if (points[b, 0] - ax) * y - (points[b, 1] - ay) * x <= 0.0:
        return False
    return bool(x * (points[c, 1] - ay) - y * (points[c, 0] - ax) > 0.0)


@njit(nogil=True)
def _find_first_orientation(points: np.ndarray, corner: np.ndarray) -> float:
    for e in range(0, len(corner), 3):
        a, b, c = corner[e], corner[e + 1], corner[e + 2]
        ax, ay = points[a, 0], points[a, 1]
        product = (points[b, 0] - ax) * (points[c, 1] - ay)
        turn = product - (points[b, 1] - ay) * (points[c, 0] - ax)
        if turn > 0.0 or turn < 0.0:
            return 1.0 if turn > 0.0 else -1.0
    return 0.0


# One compiled function per test: a branch at each edge would take longer than the test.


@njit(nogil=True)
def flip_by_l1(points: np.ndarray, corner: np.ndarray, twin: np.ndarray) -> int:
    """Flip to diagonals that are shorter in the L1 metric; see `flip_while_gaining`."""
    return flip_while_gaining(points, corner, twin, _is_shorter_l1, is_convex, None)


@njit(nogil=True)
def flip_by_length(points: np.ndarray, corner: np.ndarray, twin: np.ndarray) -> int:
    """Flip to diagonals that are shorter in the Euclidean metric; see `flip_while_gaining`."""
    return flip_while_gaining(points, corner, twin, _is_shorter, is_convex, None)


@njit(nogil=True)
def flip_by_delaunay(points: np.ndarray, corner: np.ndarray, twin: np.ndarray) -> int:
    """Flip until no vertex is certainly inside an adjacent triangle's circumcircle."""
    return flip_while_gaining(
        points, corner, twin, _is_in_circle, is_convex, _find_first_orientation(points, corner)
    )


@njit(nogil=True)
def flip_as_earcut(points: np.ndarray, corner: np.ndarray, twin: np.ndarray) -> int:
    """Flip as `refine` of npm's earcut 3.2.4 does: the same triangles in the same order."""
    return flip_while_gaining(
        points, corner, twin, _is_in_circle_as_earcut, _is_convex_as_earcut, None
    )


@njit(nogil=True)
def shorten_diagonals(points: np.ndarray, indices: np.ndarray, in_walk: bool) -> None:
    """Apply `flip_by_l1` in place to the triangles `indices` (3 m,), of any integer type."""
    corner = indices.astype(np.int32)
    twin = link_half_edges(corner)
    flip_by_l1(points, corner, twin)
    if in_walk:
        corner = put_in_walk_order_by_twins(corner.reshape(-1, 3), twin, len(points)).reshape(-1)
    indices[:] = corner
