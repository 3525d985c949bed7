"""The greedy triangulation: all diagonals, shortest first, each kept if it crosses none kept."""

import numpy as np
import shapely
from numba import njit

from triangulators.delaunay import find_vertices
from triangulators.errors import Skipped
from triangulators.polygon import Boundary
from triangulators.predicates import turn
from triangulators.starts import cycle_of, left_turning, starts
from triangulators.unfold import neighbours
from triangulators.visibility import visible_sites

LIMIT = 3000  # vertices, as pairs of them are looked at


@njit(cache=True)
def _keep_in_cycle(n: int, pairs: np.ndarray) -> np.ndarray:
    """Mark the pairs (i, j) of a cycle's corners, i < j, that cross no earlier one kept."""
    least, most = np.arange(n), np.arange(n)  # range of what each corner is joined to
    kept = np.zeros(len(pairs), dtype=np.bool_)
    for index in range(len(pairs)):
        i, j = pairs[index]
        crossed = False
        for v in range(i + 1, j):
            crossed |= least[v] < i or most[v] > j
        if not crossed:
            kept[index] = True
            most[i], least[j] = max(most[i], j), min(least[j], i)
    return kept


@njit(cache=True)
def _keep_in_plane(points: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Mark the pairs of points that properly cross no earlier one kept."""
    kept = np.zeros(len(pairs), dtype=np.bool_)
    chosen = np.empty(len(pairs), dtype=np.int64)
    size = 0
    for index in range(len(pairs)):
        a, b = pairs[index]
        crossed = False
        for other in range(size):
            c, d = pairs[chosen[other]]
            if a in (c, d) or b in (c, d):
                continue
            if turn(points, a, b, c) * turn(points, a, b, d) < 0.0 and (
                turn(points, c, d, a) * turn(points, c, d, b) < 0.0
            ):
                crossed = True
                break
        if not crossed:
            kept[index] = True
            chosen[size] = index
            size += 1
    return kept


def _of_cycle(outline: Boundary) -> np.ndarray:
    ring = cycle_of(outline, "greedy")
    n = len(ring.cycle)
    tails = np.repeat(np.arange(n, dtype=np.int32), np.diff(ring.start))
    pairs = _by_length(ring.points, np.column_stack((tails, ring.target)))
    kept = np.concatenate((pairs[_keep_in_cycle(n, pairs)], _sides(n)))
    kept = kept[np.lexsort((kept[:, 1], kept[:, 0]))]
    kept = kept[np.r_[True, np.any(kept[1:] != kept[:-1], axis=1)]]
    # The corners above i that i is joined to, in order, are the far sides of its triangles.
    same = np.flatnonzero(kept[1:, 0] == kept[:-1, 0])
    return ring.cycle[np.column_stack((kept[same], kept[same + 1, 1]))]


def _sides(n: int) -> np.ndarray:
    sides = np.column_stack((np.arange(n), (np.arange(n) + 1) % n))
    return np.sort(sides, axis=1)


def _of_plane(outline: Boundary) -> np.ndarray:
    points, edges = outline.points, outline.edges
    start = starts(outline)[0]
    pairs = visible_sites(points, start, neighbours(start, len(points)))
    pairs = _by_length(points, pairs)
    sides = {(min(a, b), max(a, b)) for a, b in edges.tolist()}
    diagonal = np.array([tuple(pair) not in sides for pair in pairs.tolist()])
    pairs = pairs[diagonal]
    drawn = np.concatenate((edges, pairs[_keep_in_plane(points, pairs)]))
    pieces = shapely.get_parts(shapely.polygonize(shapely.linestrings(points[drawn])))
    pieces = pieces[shapely.get_num_coordinates(pieces) == 4]
    corners = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    triangles = left_turning(points, outline.site[find_vertices(points, corners)].reshape(-1, 3))
    # Triangular holes are faces too: those that have a boundary edge the wrong way round.
    size = len(points)
    outside = edges[:, 1].astype(np.int64) * size + edges[:, 0]
    keys = triangles.astype(np.int64) * size + np.roll(triangles, -1, axis=1)
    return triangles[~np.isin(keys, outside).any(axis=1)]


def _by_length(points: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    lengths = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
    return pairs[np.argsort(lengths, kind="stable")]


def triangulate(outline: Boundary) -> np.ndarray:
    """Return the triangles (m, 3); raises `Skipped` beyond 3000 vertices."""
    if len(outline.edges) > LIMIT:
        raise Skipped(f"greedy: {len(outline.edges)} vertices, more than {LIMIT}")
    return _of_plane(outline) if outline.holes else _of_cycle(outline)
