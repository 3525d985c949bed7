"""The optimum of a small polygon with holes: the best of all ways to cut it into one ring.

Take a hole's vertex that lies further to the left than any other vertex of a hole. The polygon's
angle there opens to the left by more than 180 degrees and a triangle's is less, so every
triangulation has a diagonal from it to a vertex further left, which is none of a hole. Cut along
that diagonal the hole becomes a part of the ring around it, which takes two corners more. After as
many cuts as there are holes one ring is left, and its optimum is a table's (`small_ring`). So the
least over all choices of cuts is the optimum, and nothing else is.

To the right, up and down the same holds, so at each step the direction with the fewest diagonals
is taken. They are few for one or two holes; beyond `_MOST_CUTS` rings it is left to others.
"""

import numpy as np
from numba import njit

from triangulators.order import walk_of
from triangulators.predicates import cross
from triangulators.small_ring import SMALL, ring_optimum, weight

MOST_HOLES = 3
_MOST_CUTS = 250  # rings to triangulate at most
_NEAR = 1e-9  # of the span: rings nearer than that are left to those who know what touching means


@njit(cache=True, nogil=True)
def holes_optimum(
    points: np.ndarray, ends: np.ndarray, box: np.ndarray, triangles: np.ndarray
) -> bool:
    """Triangulate a polygon with holes at least cost; False if that is not for here.

    points (n, 2): rings that end at `ends` (h + 1,), the exterior first, of either winding; box:
    coefficients of half-perimeter, bounding-box area and edge length; triangles (n + 2h - 2, 3),
    which are left in the order of `order.walk`. False if rings touch, if there are too many cuts,
    or if none was found.
    """
    n, holes = len(points), len(ends) - 1
    most = n + 2 * holes
    if most > SMALL or holes > MOST_HOLES or _rings_touch(points, ends):
        return False
    ring = _wound(points, ends)
    cycle = np.empty((holes + 1, most), dtype=np.int32)
    cycle[0, : ends[0]] = ring[: ends[0]]
    merged = np.zeros((holes + 1, holes + 1), dtype=np.bool_)  # at each depth, which holes
    bridges = np.empty((holes, most), dtype=np.int32)
    count = np.zeros(holes, dtype=np.int64)
    taken = np.zeros(holes, dtype=np.int64)
    tip = np.empty(holes, dtype=np.int64)
    size = np.empty(holes + 1, dtype=np.int64)
    size[0] = ends[0]
    corners = np.empty((most, 2))
    found = np.empty((most - 2, 3), dtype=np.int32)
    least, cuts, depth = np.inf, 0, 0
    count[0] = _bridges(points, ends, ring, cycle[0, : size[0]], merged[0], bridges[0], tip[:1])
    while depth >= 0:
        if taken[depth] == count[depth]:
            depth -= 1
            continue
        place = bridges[depth, taken[depth]]
        taken[depth] += 1
        hole = _merge(ends, ring, cycle[depth, : size[depth]], place, tip[depth], cycle[depth + 1])
        size[depth + 1] = size[depth] + ends[hole] - ends[hole - 1] + 2
        if depth + 1 < holes:
            depth += 1
            merged[depth] = merged[depth - 1]
            merged[depth, hole] = True
            taken[depth] = 0
            count[depth] = _bridges(
                points,
                ends,
                ring,
                cycle[depth, : size[depth]],
                merged[depth],
                bridges[depth],
                tip[depth : depth + 1],
            )
            continue
        cuts += 1
        if cuts > _MOST_CUTS:
            return False
        for k in range(most):
            corners[k, 0], corners[k, 1] = points[cycle[holes, k], 0], points[cycle[holes, k], 1]
        cost = ring_optimum(corners, box, found)
        for level in range(holes):  # a cut is a side of the ring, but a diagonal of the polygon
            a, b = cycle[level + 1, 0], ring[tip[level]]
            cost += weight(points[a, 0] - points[b, 0], points[a, 1] - points[b, 1], box)
        if cost < least:
            least = cost
            for row in range(most - 2):
                for e in range(3):
                    triangles[row, e] = cycle[holes, found[row, e]]
    if least < np.inf:
        triangles[:] = walk_of(triangles, n)
    return least < np.inf


@njit(cache=True, nogil=True)
def _wound(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return the vertices ring after ring, the exterior counter-clockwise and holes clockwise."""
    ring = np.empty(len(points), dtype=np.int32)
    start = 0
    for number in range(len(ends)):
        end = ends[number]
        area = 0.0
        for k in range(start, end):
            after = k + 1 if k + 1 < end else start
            dx, dy = points[k, 0] - points[start, 0], points[k, 1] - points[start, 1]
            area += dx * (points[after, 1] - points[start, 1])
            area -= dy * (points[after, 0] - points[start, 0])
        for k in range(start, end):
            ring[k] = k if (area > 0.0) == (number == 0) else end - 1 - (k - start)
        start = end
    return ring


@njit(cache=True, nogil=True)
def _merge(
    ends: np.ndarray, ring: np.ndarray, cycle: np.ndarray, place: int, tip: int, merged: np.ndarray
) -> int:
    """Write a cycle with a hole cut into it at a place; return the hole's number."""
    hole = 1
    while tip >= ends[hole]:
        hole += 1
    start, length = ends[hole - 1], ends[hole] - ends[hole - 1]
    size = len(cycle)
    for k in range(size + 1):
        merged[k] = cycle[(place + k) % size]
    for k in range(length + 1):
        merged[size + 1 + k] = ring[start + (tip - start + k) % length]
    return hole


@njit(cache=True, nogil=True)
def _bridges(
    points: np.ndarray,
    ends: np.ndarray,
    ring: np.ndarray,
    cycle: np.ndarray,
    merged: np.ndarray,
    bridges: np.ndarray,
    tip: np.ndarray,
) -> int:
    """Write the places of the cycle where a cut may end; return how many.

    The cut starts at the vertex ring[tip[0]] of a hole that is not merged, the furthest in the
    direction that leaves the fewest.
    """
    fewest = len(cycle) + 1
    places = np.empty(len(cycle), dtype=np.int32)
    for direction in range(4):
        axis, sign = direction // 2, 1.0 if direction % 2 == 0 else -1.0
        best = -1
        for hole in range(1, len(ends)):
            if merged[hole]:
                continue
            for k in range(ends[hole - 1], ends[hole]):
                here = sign * points[ring[k], axis]
                if best < 0 or here < sign * points[ring[best], axis]:
                    best = k
        limit = sign * points[ring[best], axis]
        count = 0
        for place in range(len(cycle)):
            beyond = sign * points[cycle[place], axis] < limit
            if beyond and not _blocked(points, ends, ring, cycle, cycle[place], ring[best]):
                places[count] = place
                count += 1
        if 0 < count < fewest:
            fewest = count
            tip[0] = best
            bridges[:count] = places[:count]
    return fewest if fewest <= len(cycle) else 0


@njit(cache=True, nogil=True)
def _blocked(
    points: np.ndarray, ends: np.ndarray, ring: np.ndarray, cycle: np.ndarray, a: int, b: int
) -> bool:
    """Whether the open segment a-b properly crosses an edge of the cycle or of a hole.

    What merely touches is not looked for: then no triangulation of the ring will be found.
    """
    size = len(cycle)
    for k in range(size):
        if cross(points, a, b, cycle[k], cycle[k + 1 if k + 1 < size else 0]):
            return True
    for hole in range(1, len(ends)):
        start, end = ends[hole - 1], ends[hole]
        for k in range(start, end):
            if cross(points, a, b, ring[k], ring[k + 1 if k + 1 < end else start]):
                return True
    return False


@njit(cache=True, nogil=True)
def _rings_touch(points: np.ndarray, ends: np.ndarray) -> bool:
    """Whether a vertex of one ring lies on an edge of another, or too near to tell."""
    n = len(points)
    span = 0.0
    for k in range(n):
        span = max(span, abs(points[k, 0] - points[0, 0]), abs(points[k, 1] - points[0, 1]))
    near = _NEAR * span
    start = 0
    for number in range(len(ends)):
        end = ends[number]
        for c in range(start, end):
            d = c + 1 if c + 1 < end else start
            dx, dy = points[d, 0] - points[c, 0], points[d, 1] - points[c, 1]
            low_x, high_x = min(points[c, 0], points[d, 0]), max(points[c, 0], points[d, 0])
            low_y, high_y = min(points[c, 1], points[d, 1]), max(points[c, 1], points[d, 1])
            length = abs(dx) + abs(dy)
            for v in range(n):
                x, y = points[v, 0], points[v, 1]
                beside = max(low_x - x, x - high_x, low_y - y, y - high_y)
                if beside <= near and not start <= v < end:
                    off = (x - points[c, 0]) * dy - (y - points[c, 1]) * dx
                    if abs(off) <= near * length:
                        return True
        start = end
    return False
