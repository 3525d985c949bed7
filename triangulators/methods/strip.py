"""Strip: a zigzag of diagonals, as a triangle strip would be drawn, where some start allows it."""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.errors import Skipped
from triangulators.geometry.predicates import turn
from triangulators.polygon import Boundary


@njit
def zigzag(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Return the first valid zigzag of a counter-clockwise ring, (n - 2, 3), or no rows.

    A zigzag starts at a side and takes its next vertex from either end in turn. It is valid if all
    its triangles turn left: their edges then add up to the boundary.
    """
    n = len(ring)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    for start in range(2 * n):
        low = start // 2
        forward = start % 2 == 0
        high = low + n - 1
        valid = True
        for row in range(n - 2):
            apex = low + 1 if forward else high - 1
            a, b, c = ring[low % n], ring[apex % n], ring[high % n]
            if turn(points, a, b, c) <= 0.0:
                valid = False
                break
            triangles[row, 0], triangles[row, 1], triangles[row, 2] = a, b, c
            if forward:
                low += 1
            else:
                high -= 1
            forward = not forward
        if valid:
            return triangles
    return triangles[:0]


def triangulate(outline: Boundary) -> np.ndarray:
    """Return a zigzag; raises `Skipped` for holes and where no start gives a valid one."""
    if outline.holes:
        raise Skipped("strip: the polygon has holes")
    triangles = zigzag(outline.points, outline.edges[:, 0].copy())
    if len(triangles) == 0:
        raise Skipped("strip: no zigzag stays inside the polygon")
    return triangles
