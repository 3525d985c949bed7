"""Whether coordinates are those of one simple ring, without GEOS: most polygons are.

A ring whose edges meet nowhere but at the vertex that neighbours share is a valid polygon. That is
looked at edge by edge in one compiled pass, which for a building costs a tenth of what a general
test of validity does. It says yes only where a float64 filter is sure; every other polygon, valid
or not, is left to GEOS, whose words the error messages are.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import FILTER, orient

MOST = 96  # vertices up to which all pairs of edges are looked at

UNSURE, LEFT, RIGHT = 0, 1, -1


@njit(nogil=True)
def _sure_side(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Return the side of a-b that c is on, 1 or -1; 0 on it or where rounding may decide."""
    left, right = (ax - cx) * (by - cy), (ay - cy) * (bx - cx)
    determinant = left - right
    if abs(determinant) <= FILTER * (abs(left) + abs(right)):
        return 0
    return 1 if determinant > 0.0 else -1


@njit(nogil=True)
def _meets_none_beyond(coordinates: np.ndarray, a: int, n: int) -> bool:
    """Whether edge a surely has no point in common with those from a + 2 on."""
    ax, ay = coordinates[a, 0], coordinates[a, 1]
    bx, by = coordinates[a + 1, 0], coordinates[a + 1, 1]
    low_x, high_x = min(ax, bx), max(ax, bx)
    low_y, high_y = min(ay, by), max(ay, by)
    for c in range(a + 2, n if a > 0 else n - 1):
        cx, cy = coordinates[c, 0], coordinates[c, 1]
        dx, dy = coordinates[c + 1, 0], coordinates[c + 1, 1]
        if max(cx, dx) < low_x or min(cx, dx) > high_x:
            continue
        if max(cy, dy) < low_y or min(cy, dy) > high_y:
            continue
        if _sure_side(ax, ay, bx, by, cx, cy) * _sure_side(ax, ay, bx, by, dx, dy) == 1:
            continue
        if _sure_side(cx, cy, dx, dy, ax, ay) * _sure_side(cx, cy, dx, dy, bx, by) == 1:
            continue
        return False
    return True


@njit(nogil=True)
def winding(coordinates: np.ndarray) -> int:
    """Return LEFT or RIGHT, the way a simple ring winds, or UNSURE.

    coordinates: (n + 1, 2), as shapely gives them: the first vertex is repeated at the end. Those
    of a polygon with holes have it in the middle too, so they are not taken for one ring.
    """
    n = len(coordinates) - 1
    if n < 3 or n > MOST:
        return UNSURE
    x, y = coordinates[0, 0], coordinates[0, 1]
    if coordinates[n, 0] != x or coordinates[n, 1] != y:
        return UNSURE
    area, span = 0.0, 0.0
    for a in range(n):
        ax, ay = coordinates[a, 0], coordinates[a, 1]
        bx, by = coordinates[a + 1, 0], coordinates[a + 1, 1]
        if a > 0 and ax == x and ay == y:
            return UNSURE
        if not (abs(ax) < 1e150 and abs(ay) < 1e150):  # not a number, or products would overflow
            return UNSURE
        span = max(span, abs(ax - x), abs(ay - y))
        area += (ax - x) * (by - y) - (ay - y) * (bx - x)
        # The edge that follows may not go back along this one.
        c = a + 2 if a + 2 <= n else 1
        cx, cy = coordinates[c, 0], coordinates[c, 1]
        ahead = (bx - ax) * (cx - bx) + (by - ay) * (cy - by)
        if not ahead > 0.0 and orient(ax, ay, bx, by, cx, cy) == 0.0:
            return UNSURE
    for a in range(n):
        if not _meets_none_beyond(coordinates, a, n):
            return UNSURE
    if not abs(area) > 1e-12 * span * span * n:
        return UNSURE
    return LEFT if area > 0.0 else RIGHT
