"""The greedy triangulation: all diagonals, shortest first, each kept if it crosses none kept."""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.errors import Skipped
from triangulators.geometry.half_edges import twins_of
from triangulators.geometry.visibility import visible_sites
from triangulators.polygon import Boundary
from triangulators.starting.diagonals import by_length, shortest_first
from triangulators.starting.starts import cycle_of, starts

LIMIT = 3000  # vertices, as pairs of them are looked at


@njit
def _keep_in_cycle(n: int, pairs: np.ndarray) -> np.ndarray:
    """Mark the pairs (i, j) of a cycle's corners, i < j, that cross no earlier one kept.

    Diagonals of a cycle cross if the ends of one are apart on the cycle between those of the other:
    no coordinates are needed. least, most: the range of corners that each is joined to by what is
    kept. So i-j crosses one of them if a corner strictly between i and j is joined to one outside
    i..j; a pair takes j - i steps.
    """
    least, most = np.arange(n), np.arange(n)
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


def _of_cycle(outline: Boundary) -> np.ndarray:
    ring = cycle_of(outline, "greedy")
    n = len(ring.cycle)
    tails = np.repeat(np.arange(n, dtype=np.int32), np.diff(ring.start))
    pairs = by_length(ring.points, np.column_stack((tails, ring.target)))
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
    start = starts(outline)[0]
    pairs = visible_sites(outline.points, start, twins_of(start))
    return shortest_first(outline, pairs)


def triangulate(outline: Boundary) -> np.ndarray:
    """Return the triangles (m, 3); raises `Skipped` beyond 3000 vertices."""
    if len(outline.edges) > LIMIT:
        raise Skipped(f"greedy: {len(outline.edges)} vertices, more than {LIMIT}")
    return _of_plane(outline) if outline.holes else _of_cycle(outline)
