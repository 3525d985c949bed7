"""Ear clipping of one ring: the triangles of mapbox_earcut, without the GIL and 2 us per call."""

import numpy as np

from triangulators.compute.kernels import njit

# For larger rings earcut is faster, which sorts vertices along a space-filling curve.
MAX_VERTICES = 128


@njit(nogil=True)
def _compute_doubled_area(points: np.ndarray, a: int, b: int, c: int) -> float:
    """Return twice the area of a triangle, rounded as in earcut; negative at a convex vertex b."""
    left = (points[b, 1] - points[a, 1]) * (points[c, 0] - points[b, 0])
    return float(left - (points[b, 0] - points[a, 0]) * (points[c, 1] - points[b, 1]))


@njit(nogil=True)
def _is_ear(
    points: np.ndarray, previous: np.ndarray, following: np.ndarray, a: int, b: int, c: int
) -> bool:
    ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
    cx, cy = points[c, 0], points[c, 1]
    low_x, high_x = min(ax, bx, cx), max(ax, bx, cx)
    low_y, high_y = min(ay, by, cy), max(ay, by, cy)
    p = following[c]
    while p != a:
        x, y = points[p, 0], points[p, 1]
        if (
            low_x <= x <= high_x
            and low_y <= y <= high_y
            and not (x == ax and y == ay)
            and (cx - x) * (ay - y) >= (ax - x) * (cy - y)
            and (ax - x) * (by - y) >= (bx - x) * (ay - y)
            and (bx - x) * (cy - y) >= (cx - x) * (by - y)
            and _compute_doubled_area(points, previous[p], p, following[p]) >= 0.0
        ):
            return False
        p = following[p]
    return True


@njit(nogil=True)
def clip_ears_of_ring(points: np.ndarray) -> np.ndarray:
    """Return the triangles (n - 2, 3) of a ring, or (0, 3) if earcut would repair the ring."""
    n = len(points)
    triangles = np.empty((max(n - 2, 0), 3), dtype=np.int32)
    doubled_area, last = 0.0, n - 1
    for i in range(n):
        height = (points[i, 1] - points[0, 1]) + (points[last, 1] - points[0, 1])
        doubled_area += (points[last, 0] - points[i, 0]) * height
        last = i
    following = np.arange(1, n + 1).astype(np.int32)
    previous = np.arange(-1, n - 1).astype(np.int32)
    following[n - 1], previous[0] = 0, n - 1
    ear = n - 1
    if not doubled_area > 0.0:  # as in earcut, clockwise rings start at the first vertex
        following, previous, ear = previous, following, 0
    count, stop = 0, ear
    if points[0, 0] == points[n - 1, 0] and points[0, 1] == points[n - 1, 1]:
        return triangles[:0]
    while previous[ear] != following[ear]:
        a, c = previous[ear], following[ear]
        if _compute_doubled_area(points, a, ear, c) < 0.0 and _is_ear(
            points, previous, following, a, ear, c
        ):
            triangles[count, 0], triangles[count, 1], triangles[count, 2] = a, ear, c
            count += 1
            following[a], previous[c] = c, a
            stop = c
        elif c == stop:
            return triangles[:0]
        ear = c
    return triangles
