"""Ear clipping by mapbox_earcut, and a kernel that returns its triangles of one small ring.

The kernel needs neither the GIL nor the 2 us of a call of mapbox_earcut.

mapbox_earcut finds the edge to which it joins a hole in absolute coordinates. Far from the origin
rounding may choose the wrong edge, and triangles overlap: by 6.9 % of the area for a triangle with
two holes at (2.5e6, -5e5). So polygons far from the origin are translated first. The translation is
exact (Sterbenz' lemma).
"""

from typing import Any

import mapbox_earcut
import numpy as np

from triangulators.compute.kernels import njit

# For larger rings earcut is faster, which sorts vertices along a space-filling curve.
MAX_VERTICES = 128

_BY_TYPE: dict[Any, Any] = {
    np.dtype(np.float64): mapbox_earcut.triangulate_float64,
    np.dtype(np.int32): mapbox_earcut.triangulate_int32,
    np.dtype(np.int64): mapbox_earcut.triangulate_int64,
}
_SINGLE_START = np.zeros(1, np.int64)  # argument `starts` of `find_far_offsets`: one polygon


def run_earcut(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return mapbox_earcut's triangles (3 m,) uint32; ends (r,) uint32: ends of the rings."""
    if isinstance(points, np.ndarray) and points.ndim == 2 and len(points):
        offsets = find_far_offsets(points, _SINGLE_START)
        if offsets[0, 0] or offsets[0, 1]:
            points = points - offsets
    triangulate = _BY_TYPE.get(getattr(points, "dtype", None), mapbox_earcut.triangulate_float64)
    indices: np.ndarray = triangulate(points, ends)
    return indices


@njit(nogil=True)
def find_far_offsets(points: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the offset (k, 2) to subtract from each polygon so that it is near the origin.

    starts (k,): first vertex of each nonempty polygon. The offset along an axis is 0 unless the
    polygon's distance from 0 exceeds its extent.

        >>> points = np.array([(2e6, -5e5), (2e6 + 9, -5e5 - 7), (2e6, -1.0)])
        >>> find_far_offsets(points, np.array([0])).tolist()
        [[2000000.0, 0.0]]
    """
    offsets = np.zeros((len(starts), 2), points.dtype)
    for k in range(len(starts)):
        stop = starts[k + 1] if k + 1 < len(starts) else len(points)
        for axis in range(2):
            low = high = points[starts[k], axis]
            for row in range(starts[k] + 1, stop):
                low, high = min(low, points[row, axis]), max(high, points[row, axis])
            extent = np.float64(high) - np.float64(low)
            if low > extent:
                offsets[k, axis] = low
            elif -np.float64(high) > extent:
                offsets[k, axis] = high
    return offsets


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
