"""The greedy triangulation: diagonals, shortest first, each chosen if it crosses none before it.

Crossings are decided by exact orientations, so the triangulation is valid even where vertices lie
beside an edge by less than a rounding error.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import cross, turn


def shortest_first(points: np.ndarray, edges: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return the greedy triangulation (m, 3) of a polygon's boundary edges (b, 2).

    pairs (p, 2): points that see each other; edges of the boundary may be among them.
    """
    size = len(points)
    of_boundary = edges.astype(np.int64)
    keys = of_boundary.min(axis=1) * size + of_boundary.max(axis=1)
    low, high = pairs.min(axis=1).astype(np.int64), pairs.max(axis=1).astype(np.int64)
    diagonals = by_length(points, pairs[~np.isin(low * size + high, keys)])
    chosen = diagonals[_select_uncrossed(points, diagonals)]
    sides = np.concatenate((edges, chosen, chosen[:, ::-1]))
    both_ways = np.concatenate((sides, edges[:, ::-1]))
    both_ways = both_ways[np.argsort(both_ways[:, 0], kind="stable")]
    begin = np.searchsorted(both_ways[:, 0], np.arange(size + 1))
    return _triangles(points, sides, begin, both_ways[:, 1].copy())


def by_length(points: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return pairs (p, 2) of points (n, 2), the shortest first; those of equal length as given."""
    lengths = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
    return pairs[np.argsort(lengths, kind="stable")]


@njit
def _select_uncrossed(points: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Mark the pairs of points that cross no pair marked before.

    Most pairs cross one, and pairs that share an end often cross the same. So `blocking[v]`, the
    last one that crossed a pair from v, is tried first: a tenth of the time at 3,000 vertices.
    """
    marked = np.zeros(len(pairs), dtype=np.bool_)
    chosen = np.empty((len(pairs), 2), dtype=np.int64)  # the pairs marked, in order: size of them
    size = 0
    blocking = np.full(len(points), -1)
    for index in range(len(pairs)):
        a, b = pairs[index]
        crossed = False
        for other in (blocking[a], blocking[b]):
            if other >= 0 and cross(points, a, b, chosen[other, 0], chosen[other, 1]):
                crossed = True
                break
        if crossed:
            continue
        for other in range(size):
            if cross(points, a, b, chosen[other, 0], chosen[other, 1]):
                crossed = True
                blocking[a] = blocking[b] = other
                break
        if not crossed:
            marked[index] = True
            chosen[size, 0], chosen[size, 1] = a, b
            size += 1
    return marked


@njit
def _triangles(
    points: np.ndarray, sides: np.ndarray, begin: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Return the triangle left of each side (s, 2), once.

    Sides run with the interior on their left, diagonals both ways; v is joined to
    `near[begin[v]:begin[v + 1]]`. The triangle left of a-b is closed by what follows b around a,
    counter-clockwise, for its angle there is less than a half-turn.
    """
    found = np.empty((len(sides), 3), dtype=np.int32)
    count = 0
    for side in range(len(sides)):
        a, b = sides[side]
        apex = -1
        for place in range(begin[a], begin[a + 1]):
            c = near[place]
            if turn(points, a, b, c) > 0.0 and (apex < 0 or turn(points, a, c, apex) > 0.0):
                apex = c
        if apex > a and b > a:  # once: it is found from each of its sides
            found[count, 0], found[count, 1], found[count, 2] = a, b, apex
            count += 1
    return found[:count].copy()
