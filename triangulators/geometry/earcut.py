"""Ear clipping by mapbox_earcut, after translating polygons that are far from the origin.

earcut finds the edge to which it joins a hole in absolute coordinates. Far from the origin rounding
may choose the wrong edge, and triangles overlap: by 6.9 % of the area for a triangle with two holes
at (2.5e6, -5e5). The translation is exact (Sterbenz' lemma).
"""

from typing import Any

import mapbox_earcut
import numpy as np

from triangulators.compute.kernels import njit

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
