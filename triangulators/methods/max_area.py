"""Largest triangle first: take the largest, then the same in what is left on each side.

Source: E. Persson, "Triangulation", 2009, for convex polygons; here only corners that see each
other are joined, so any simple polygon will do.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.errors import Skipped
from triangulators.polygon import Boundary
from triangulators.starting.starts import cycle_of

LIMIT = 1500  # corners; the search takes a time that grows with their cube


@njit
def _largest_first(points: np.ndarray, sees: np.ndarray) -> np.ndarray:
    """Return the triangles (n - 2, 3) of a counter-clockwise cycle (n, 2); sees (n, n), i < j.

    A stack of sub-polygons, each the corners of it in the cycle's order, so that every triangle
    i < k < j of corners that see each other turns left, and its doubled area needs no sign. The
    largest one cuts three sub-polygons off, of the corners p to q, q to r, and r round to p; those
    that are a side only are not kept. Of equal areas it is the first, by i, k and j.
    """
    n = len(points)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    found = 0
    waiting = [np.arange(n)]
    while len(waiting) > 0:
        corners = waiting.pop()
        size = len(corners)
        best, p, q, r = -1.0, 0, 0, 0
        for i in range(size):
            xi, yi = points[corners[i]]
            for k in range(i + 1, size):
                if not sees[corners[i], corners[k]]:
                    continue
                dx, dy = points[corners[k], 0] - xi, points[corners[k], 1] - yi
                for j in range(k + 1, size):
                    area = dx * (points[corners[j], 1] - yi) - dy * (points[corners[j], 0] - xi)
                    if (
                        area > best
                        and sees[corners[i], corners[j]]
                        and sees[corners[k], corners[j]]
                    ):
                        best, p, q, r = area, i, k, j
        triangles[found, 0] = corners[p]
        triangles[found, 1] = corners[q]
        triangles[found, 2] = corners[r]
        found += 1
        if q - p > 1:
            waiting.append(corners[p : q + 1].copy())
        if r - q > 1:
            waiting.append(corners[q : r + 1].copy())
        if size - (r - p) > 1:
            waiting.append(np.concatenate((corners[: p + 1], corners[r:])))
    return triangles


def triangulate(outline: Boundary) -> np.ndarray:
    """Return the triangles (n - 2, 3); raises `Skipped` for holes and beyond 1500 vertices."""
    if len(outline.edges) > LIMIT:
        raise Skipped(f"max-area: {len(outline.edges)} vertices, more than {LIMIT}")
    ring = cycle_of(outline, "max-area")
    n = len(ring.cycle)
    sees = np.zeros((n, n), dtype=np.bool_)
    sees[np.repeat(np.arange(n), np.diff(ring.start)), ring.target] = True
    return ring.cycle[_largest_first(ring.points, sees)]
