"""Flips of diagonals, in the one order that all languages share (see ports/ORDER.md).

Two triangles that share an edge are a quadrilateral. If it is strictly convex it has another
diagonal, and taking that one is a flip. Flips are made until none gains. Each test lessens a sum or
replaces lengths by shorter ones, so no triangulation is met twice and it ends.

A flip is made only where both new triangles turn for certain, so none makes a triangulation
invalid. Whole coordinates up to 2^25 are decided exactly; for others, a filter leaves alone what
rounding could change.

Sources: C. L. Lawson, "Software for C1 surface interpolation", 1977; the order is that of `refine`
in npm's earcut 3.2.4; flips to shorter diagonals after ear clipping are in HelperLaneViz, 2025.
"""

from typing import Any

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.half_edges import link

_WHOLE = 2.0**25  # whole coordinates up to this have exact turns and lengths in doubles
_EXACT = 1.6e8  # a sum of three squared distances up to which whole in-circle tests are exact
_NOTHING = 1e-300  # more than what underflow takes from a product
_PIECE = 27  # bits


@njit(nogil=True, inline="always")
def run(
    points: np.ndarray, corner: np.ndarray, twin: np.ndarray, gains: Any, convex: Any, how: Any
) -> int:
    """Flip in place until no flip gains; return how many were made.

    corner, twin: (3 m,), see `half_edges`; gains(points, a, b, c, d, how): whether the diagonal a-d
    is better than b-c, which lies between the triangles a, b, c and d, c, b; convex(points, a, b,
    c, d): whether their quadrilateral is.

    Order: diagonals wait on a stack, at first each once, by the later of its half-edges. The one on
    top is tried; after a flip the four sides of the quadrilateral wait again, unless they do.
    Invariant: a diagonal that does not wait would not gain. So a flip costs a constant time, and
    the stack has room, as `waiting` lets no half-edge in twice.
    """
    stack = np.empty(len(corner), dtype=np.int32)
    waiting = np.zeros(len(corner), dtype=np.bool_)
    size = 0
    for latter in range(len(corner)):
        former = twin[latter]
        if 0 <= former < latter:
            waiting[former] = True
            stack[size] = former
            size += 1
    flips = 0
    while size > 0:
        size -= 1
        e: Any = np.int64(stack[size])
        waiting[e] = False
        f: Any = np.int64(twin[e])
        if f < 0:
            continue
        e1, e2 = (e + 1 if e % 3 < 2 else e - 2), (e - 1 if e % 3 > 0 else e + 2)
        f1, f2 = (f + 1 if f % 3 < 2 else f - 2), (f - 1 if f % 3 > 0 else f + 2)
        a, b, c, d = corner[e2], corner[e], corner[f], corner[f2]
        if not gains(points, a, b, c, d, how) or not convex(points, a, b, c, d):
            continue
        flips += 1
        corner[e], corner[f] = d, a
        below, above = twin[f2], twin[e2]
        twin[e], twin[f], twin[e2], twin[f2] = below, above, f2, e2
        if below >= 0:
            twin[below] = e
        if above >= 0:
            twin[above] = f
        for side in (e, f, e1, f1):
            if twin[side] >= 0 and not waiting[side]:
                waiting[side] = True
                stack[size] = side
                size += 1
    return flips


@njit(nogil=True)
def _all_whole(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    for point in (a, b, c, d):
        for value in (points[point, 0], points[point, 1]):
            if not (abs(value) <= _WHOLE and value == np.floor(value)):
                return False
    return True


@njit(nogil=True)
def convex(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the triangles a, b, d and a, d, c turn, for certain, and the same way.

    The filter is Shewchuk's bound on the error of a determinant (see `predicates`).
    """
    ax, ay = points[a, 0], points[a, 1]
    x, y = points[d, 0] - ax, points[d, 1] - ay
    p, q = (points[b, 0] - ax) * y, (points[b, 1] - ay) * x
    r, s = x * (points[c, 1] - ay), y * (points[c, 0] - ax)
    turn, other = p - q, r - s
    if not ((turn > 0.0 and other > 0.0) or (turn < 0.0 and other < 0.0)):
        return False
    return (
        abs(turn) > 4e-16 * (abs(p) + abs(q)) + _NOTHING
        and abs(other) > 4e-16 * (abs(r) + abs(s)) + _NOTHING
    ) or _all_whole(points, a, b, c, d)


@njit(nogil=True)
def _shorter_l1(points: np.ndarray, a: int, b: int, c: int, d: int, _: Any) -> bool:
    new = abs(points[d, 0] - points[a, 0]) + abs(points[d, 1] - points[a, 1])
    return bool(new < abs(points[c, 0] - points[b, 0]) + abs(points[c, 1] - points[b, 1]))


@njit(nogil=True)
def _shorter(points: np.ndarray, a: int, b: int, c: int, d: int, _: Any) -> bool:
    x, y = points[d, 0] - points[a, 0], points[d, 1] - points[a, 1]
    u, v = points[c, 0] - points[b, 0], points[c, 1] - points[b, 1]
    return bool(x * x + y * y < u * u + v * v)


@njit(nogil=True)
def _in_circle(points: np.ndarray, a: int, b: int, c: int, d: int, winding: float) -> bool:
    """Whether d is, for certain, inside the circle through a, b, c, which turn left if winding > 0.

    No flip that this allows is a matter of rounding, so they end. With s the sum of three squared
    distances, rounding is below 4e-16 s^2; whole numbers are exact while s^2 / 3 < 2^53.
    """
    px, py = points[a, 0] - points[d, 0], points[a, 1] - points[d, 1]
    qx, qy = points[b, 0] - points[d, 0], points[b, 1] - points[d, 1]
    rx, ry = points[c, 0] - points[d, 0], points[c, 1] - points[d, 1]
    p, q, r = px * px + py * py, qx * qx + qy * qy, rx * rx + ry * ry
    i, j, k = qx * ry - qy * rx, rx * py - ry * px, px * qy - py * qx
    inside, size = (p * i + q * j + r * k) * winding, p + q + r
    if abs(inside) > 1e-15 * size * size + _NOTHING:
        return bool(inside > 0.0)
    if (size <= _EXACT and inside == 0.0) or not _all_whole(points, a, b, c, d):
        return False
    return inside > 0.0 if size <= _EXACT else _sign(p, i, q, j, r, k) * winding > 0.0


@njit(nogil=True)
def _sign(p: float, i: float, q: float, j: float, r: float, k: float) -> float:
    """Return the sign of p i + q j + r k, of whole numbers up to 2^53 in size, exactly."""
    high, middle, low = 0, 0, 0
    below = (1 << _PIECE) - 1
    for left, right in ((p, i), (q, j), (r, k)):
        one, other = int(left), int(right)
        high += (one >> _PIECE) * (other >> _PIECE)
        middle += (one >> _PIECE) * (other & below) + (one & below) * (other >> _PIECE)
        low += (one & below) * (other & below)
    middle += low >> _PIECE
    high += middle >> _PIECE
    rest = ((middle & below) << _PIECE) + (low & below)  # from 0 on, below one of `high`
    return float(np.sign(high)) if high != 0 else float(np.sign(rest))


@njit(nogil=True)
def _in_circle_as_earcut(points: np.ndarray, a: int, b: int, c: int, d: int, _: Any) -> bool:
    """The test of npm's earcut 3.2.4, operation by operation, with its margin for ties."""
    px, py = points[a, 0] - points[d, 0], points[a, 1] - points[d, 1]
    qx, qy = points[b, 0] - points[d, 0], points[b, 1] - points[d, 1]
    rx, ry = points[c, 0] - points[d, 0], points[c, 1] - points[d, 1]
    p, q, r = px * px + py * py, qx * qx + qy * qy, rx * rx + ry * ry
    size = p + q + r
    inside = px * (qy * r - q * ry) - py * (qx * r - q * rx) + p * (qx * ry - qy * rx)
    return not inside <= 1e-13 * size * size


@njit(nogil=True)
def _left_as_earcut(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    ax, ay = points[a, 0], points[a, 1]
    x, y = points[d, 0] - ax, points[d, 1] - ay
    if (points[b, 0] - ax) * y - (points[b, 1] - ay) * x <= 0.0:
        return False
    return bool(x * (points[c, 1] - ay) - y * (points[c, 0] - ax) > 0.0)


@njit(nogil=True)
def _winding(points: np.ndarray, corner: np.ndarray) -> float:
    """Return 1 or -1, the winding of the first triangle that turns at all."""
    for e in range(0, len(corner), 3):
        a, b, c = corner[e], corner[e + 1], corner[e + 2]
        ax, ay = points[a, 0], points[a, 1]
        left = (points[b, 0] - ax) * (points[c, 1] - ay)
        turn = left - (points[b, 1] - ay) * (points[c, 0] - ax)
        if turn > 0.0 or turn < 0.0:
            return 1.0 if turn > 0.0 else -1.0
    return 0.0


# One compiled form for each test: to ask for it at each edge takes longer than what it chooses.


@njit(nogil=True)
def by_l1(points: np.ndarray, corner: np.ndarray, twin: np.ndarray) -> int:
    """Flip to diagonals that are shorter in the L1 metric, see `run`."""
    return run(points, corner, twin, _shorter_l1, convex, None)


@njit(nogil=True)
def by_euclidean(points: np.ndarray, corner: np.ndarray, twin: np.ndarray) -> int:
    """Flip to shorter diagonals, see `run`."""
    return run(points, corner, twin, _shorter, convex, None)


@njit(nogil=True)
def by_delaunay(points: np.ndarray, corner: np.ndarray, twin: np.ndarray) -> int:
    """Flip where a corner lies in the other triangle's circle, see `run`."""
    return run(points, corner, twin, _in_circle, convex, _winding(points, corner))


@njit(nogil=True)
def as_earcut(points: np.ndarray, corner: np.ndarray, twin: np.ndarray) -> int:
    """Flip as `refine` of npm's earcut 3.2.4 does: the same triangles in the same order."""
    return run(points, corner, twin, _in_circle_as_earcut, _left_as_earcut, None)


@njit(nogil=True)
def shorten(points: np.ndarray, indices: np.ndarray) -> int:
    """Do `by_l1` in place for indices (3 m,) of any whole type; return how many flips."""
    corner = indices.astype(np.int32)
    flips = by_l1(points, corner, link(corner))
    if flips > 0:
        indices[:] = corner
    return flips
