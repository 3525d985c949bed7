"""The greedy triangulation: repeatedly the shortest diagonal that crosses no earlier diagonal."""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import do_segments_cross, orientation


def triangulate_greedily(points: np.ndarray, edges: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return the greedy triangulation (m, 3); pairs (p, 2): all points that see each other."""
    size = len(points)
    of_boundary = edges.astype(np.int64)
    keys = of_boundary.min(axis=1) * size + of_boundary.max(axis=1)
    low, high = pairs.min(axis=1).astype(np.int64), pairs.max(axis=1).astype(np.int64)
    diagonals = sort_by_length(points, pairs[~np.isin(low * size + high, keys)])
    selected = diagonals[_select_uncrossed_pairs(points, diagonals)]
    sides = np.concatenate((edges, selected, selected[:, ::-1]))
    directed = np.concatenate((sides, edges[:, ::-1]))
    directed = directed[np.argsort(directed[:, 0], kind="stable")]
    begin = np.searchsorted(directed[:, 0], np.arange(size + 1))
    return _list_triangles(points, sides, begin, directed[:, 1].copy())


def sort_by_length(points: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Sort pairs (p, 2) of points (n, 2) by length, stably."""
    lengths = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
    return pairs[np.argsort(lengths, kind="stable")]


@njit
def _select_uncrossed_pairs(points: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return flags (p,) of the pairs (p, 2) of points that cross no earlier selected pair."""
    marked = np.zeros(len(pairs), dtype=np.bool_)
    selected = np.empty((len(pairs), 2), dtype=np.int64)  # the first `size` rows are selected pairs
    size = 0
    # The last selected pair that crossed a pair at each vertex, tried first: a tenth of the time.
    blocking = np.full(len(points), -1)
    for index in range(len(pairs)):
        a, b = pairs[index]
        crossed = False
        for other in (blocking[a], blocking[b]):
            if other >= 0 and do_segments_cross(
                points, a, b, selected[other, 0], selected[other, 1]
            ):
                crossed = True
                break
        if crossed:
            continue
        for other in range(size):
            if do_segments_cross(points, a, b, selected[other, 0], selected[other, 1]):
                crossed = True
                blocking[a] = blocking[b] = other
                break
        if not crossed:
            marked[index] = True
            selected[size, 0], selected[size, 1] = a, b
            size += 1
    return marked


@njit
def _list_triangles(
    points: np.ndarray, sides: np.ndarray, begin: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Return the triangles left of the sides; v is joined to `near[begin[v]:begin[v + 1]]`."""
    triangles = np.empty((len(sides), 3), dtype=np.int32)
    count = 0
    for side in range(len(sides)):
        a, b = sides[side]
        apex = -1
        for index in range(begin[a], begin[a + 1]):
            c = near[index]
            if orientation(points, a, b, c) > 0.0 and (
                apex < 0 or orientation(points, a, c, apex) > 0.0
            ):
                apex = c
        if apex > a and b > a:  # list a triangle only at the side from its lowest vertex
            triangles[count, 0], triangles[count, 1], triangles[count, 2] = a, b, apex
            count += 1
    return triangles[:count].copy()
