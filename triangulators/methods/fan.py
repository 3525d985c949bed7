"""Fan: all diagonals from one vertex, if some vertex sees the whole polygon."""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.errors import Skipped
from triangulators.geometry.predicates import turn
from triangulators.polygon import Boundary


@njit
def fan_centre(points: np.ndarray, ring: np.ndarray) -> int:
    """Return the first position in a counter-clockwise ring whose fan is valid, or -1.

    A fan is valid if all its triangles turn left: their edges then add up to the boundary.
    """
    n = len(ring)
    for centre in range(n):
        valid = True
        for step in range(1, n - 1):
            b, c = ring[(centre + step) % n], ring[(centre + step + 1) % n]
            if turn(points, ring[centre], b, c) <= 0.0:
                valid = False
                break
        if valid:
            return centre
    return -1


def triangulate(outline: Boundary) -> np.ndarray:
    """Return a fan; raises `Skipped` for holes and where no vertex sees the whole polygon."""
    if outline.holes:
        raise Skipped("fan: the polygon has holes")
    triangles = _fan(outline.points, outline.edges)
    if len(triangles) == 0:
        raise Skipped("fan: no vertex sees the whole polygon")
    return triangles


@njit
def _fan(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    n = len(edges)
    centre = fan_centre(points, edges[:, 0])
    triangles = np.empty((n - 2 if centre >= 0 else 0, 3), dtype=np.int32)
    for row in range(len(triangles)):
        triangles[row, 0] = edges[centre, 0]
        triangles[row, 1] = edges[(centre + row + 1) % n, 0]
        triangles[row, 2] = edges[(centre + row + 2) % n, 0]
    return triangles
