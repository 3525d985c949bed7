"""Edges of a polygon as `checker` finds them, from its boundary and exact orientations alone.

A pair of sites is an edge if it is a piece of the boundary, or if the segment starts into the
interior at both ends and meets no boundary edge (see `visibility`).
"""

from typing import NamedTuple

import numpy as np

from triangulators.checking.visible_pairs import visible
from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import turn
from triangulators.polygon import Boundary


class Edges(NamedTuple):
    """Edges of a polygon: ends (e, 2), a < b, ascending; keys (e,) the same as numbers.

    points (n, 2). ways (e,): 1 if a-b is boundary, -1 if b-a is, otherwise 0. holes (h, 4): sites
    of each hole, -1 where it has fewer.
    """

    points: np.ndarray
    ends: np.ndarray
    keys: np.ndarray
    ways: np.ndarray
    holes: np.ndarray

    def find(self, pairs: np.ndarray) -> np.ndarray:
        """Return the number of each pair (k, 2) among the edges, -1 where it is none."""
        pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        wanted = pairs.min(axis=1) * len(self.points) + pairs.max(axis=1)
        at = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        return np.where(self.keys[at] == wanted, at, -1)


def edges_of(outline: Boundary) -> Edges:
    """Return the edges of a polygon."""
    points, n = outline.points, len(outline.points)
    diagonals = visible(points, outline.edges, outline.site)
    pairs = np.sort(np.concatenate((outline.edges, diagonals)).astype(np.int64), axis=1)
    ways = np.zeros(len(pairs), dtype=np.int8)
    ways[: len(outline.edges)] = np.where(outline.edges[:, 0] < outline.edges[:, 1], 1, -1)
    keys = pairs[:, 0] * n + pairs[:, 1]
    order = np.argsort(keys)
    rings = np.split(outline.site, outline.ends[:-1])
    holes = np.full((len(rings) - 1, 4), -1, dtype=np.int32)
    for row, ring in zip(holes, rings[1:], strict=True):
        few = np.unique(ring)[:4]
        row[: len(few)] = few
    return Edges(points, pairs[order].astype(np.int32), keys[order], ways[order], holes)


@njit
def around_hole(points: np.ndarray, holes: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether a triangle of edges, counter-clockwise, runs round a hole.

    No edge of the boundary crosses the triangle's sides, so a hole is inside as a whole or not at
    all, but for corners that it may share with the triangle. Of four sites one is no corner: it
    tells.
    """
    for hole in range(len(holes)):
        for v in holes[hole]:
            if v < 0 or v == a or v == b or v == c:  # noqa: SIM109 - for Numba
                continue
            inside = (
                turn(points, a, b, v) > 0.0
                and turn(points, b, c, v) > 0.0
                and turn(points, c, a, v) > 0.0
            )
            if inside:
                return True
            break
    return False
