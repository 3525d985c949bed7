"""Pairs of sites that see each other, from the boundary alone, for want of a triangulation to walk.

Every pair is tried against every edge of the boundary, n^2 b / 2 steps at worst: it is asked for up
to a thousand vertices, where no library has found a triangulation. The checker's way is another one
(`checking.visible_pairs`), so that neither inherits what may be wrong with the other.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import cross, turn
from triangulators.polygon import Boundary


def inner_segments(outline: Boundary) -> np.ndarray:
    """Return the diagonals (k, 2) between sites, a < b."""
    edges = outline.edges.astype(np.int32)
    ends = np.concatenate((edges, edges[:, ::-1]))
    leaving = np.arange(len(ends)) < len(edges)
    order = np.argsort(ends[:, 0], kind="stable")
    begin = np.searchsorted(ends[order, 0], np.arange(len(outline.points) + 1))
    near, leaves = ends[order, 1].copy(), leaving[order]
    return _inner(outline.points, np.unique(edges), edges, begin, near, leaves)


@njit
def _inner(
    points: np.ndarray,
    sites: np.ndarray,
    edges: np.ndarray,
    begin: np.ndarray,
    near: np.ndarray,
    leaves: np.ndarray,
) -> np.ndarray:
    found = np.empty((len(sites) * (len(sites) - 1) // 2, 2), dtype=np.int32)
    count = 0
    for i in range(len(sites)):
        for j in range(i + 1, len(sites)):
            a, b = sites[i], sites[j]
            if _goes_in(points, begin, near, leaves, a, b) and _is_clear(points, edges, a, b):
                found[count, 0], found[count, 1] = a, b
                count += 1
    return found[:count].copy()


@njit
def _is_clear(points: np.ndarray, edges: np.ndarray, a: int, b: int) -> bool:
    """Whether no edge crosses the segment a-b, and none ends inside it."""
    ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
    for e in range(len(edges)):
        c, d = edges[e, 0], edges[e, 1]
        if cross(points, a, b, c, d):
            return False
        # Every site is the first end of an edge.
        x, y = points[c, 0], points[c, 1]
        boxed = min(ax, bx) <= x <= max(ax, bx) and min(ay, by) <= y <= max(ay, by)
        if boxed and c != a and c != b and turn(points, a, b, c) == 0.0:
            return False
    return True


@njit
def _goes_in(
    points: np.ndarray, begin: np.ndarray, near: np.ndarray, leaves: np.ndarray, a: int, b: int
) -> bool:
    """Whether the segment from a to b starts into the interior.

    It does if the first edge of the boundary that one meets when it is turned clockwise round a
    leaves a, as that has the interior on its left; also where several rings meet at a.
    """
    first, first_half = -1, 3
    for place in range(begin[a], begin[a + 1]):
        c = near[place]
        side = turn(points, a, b, c)
        if side == 0.0 and not _opposite(points, a, b, c):
            return False  # it runs along the boundary
        half = 0 if side < 0.0 else (1 if side == 0.0 else 2)  # of a full turn: < 1/2, 1/2, more
        nearer = half < first_half
        if half == first_half and half != 1:
            nearer = turn(points, a, near[first], c) > 0.0
        if nearer:
            first, first_half = place, half
    return leaves[first]


@njit
def _opposite(points: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether b and c, in line with a, are on different sides of it."""
    for axis in range(2):
        x = points[a, axis]
        if points[b, axis] != x:
            return (points[b, axis] > x) != (points[c, axis] > x)
    return False
