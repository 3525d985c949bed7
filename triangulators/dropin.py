"""A drop-in for mapbox_earcut: the same arguments and result, triangles cheaper to draw.

    from triangulators.dropin import triangulate_float64   # was: from mapbox_earcut import ...

The triangles minimise the sum of their bounding boxes' half-perimeters, which is what a GPU's quads
follow: they are those of `optimal:half-perimeter`. Where earcut's input is not a valid polygon, its
own result is returned, as a program that works with earcut expects.
"""

import mapbox_earcut
import numpy as np
import shapely

from triangulators.errors import TriangulationError
from triangulators.geometry.simple_ring import UNSURE, winding
from triangulators.methods import optimal
from triangulators.optimum.small_ring import SMALL, ring_optimum
from triangulators.polygon import as_polygon, boundary_of_rings

_BOX = np.array([1.0, 0.0, 0.0])
EXACT = 2**53
"""Whole numbers up to this are doubles."""


def triangulate_float64(vertices: np.ndarray, ring_end_indices: np.ndarray) -> np.ndarray:
    """Triangulate rings; return flat uint32 indices, three a triangle, counter-clockwise.

    vertices: (n, 2) float64, all rings' vertices, the exterior first; ring_end_indices: (r,)
    uint32, where each ring ends, the last one n. Raises what `mapbox_earcut` raises.

        >>> square = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
        >>> triangulate_float64(square, np.array([4], dtype=np.uint32)).shape
        (6,)
    """
    raw = mapbox_earcut.triangulate_float64(vertices, ring_end_indices)
    return _improved(raw, vertices, ring_end_indices)


def triangulate_float32(vertices: np.ndarray, ring_end_indices: np.ndarray) -> np.ndarray:
    """`triangulate_float64` for (n, 2) float32 vertices, which it decides exactly."""
    return triangulate_float64(np.asarray(vertices, dtype=np.float64), ring_end_indices)


def triangulate_int32(vertices: np.ndarray, ring_end_indices: np.ndarray) -> np.ndarray:
    """`triangulate_float64` for (n, 2) int32 vertices, which it decides exactly."""
    vertices = np.asarray(vertices).astype(np.int32, copy=False)
    raw = mapbox_earcut.triangulate_int32(vertices, ring_end_indices)
    return _improved(raw, vertices, ring_end_indices)


def triangulate_int64(vertices: np.ndarray, ring_end_indices: np.ndarray) -> np.ndarray:
    """`triangulate_float64` for (n, 2) int64 vertices.

    Decided exactly up to an extent of 2^53; a polygon that is larger, which doubles cannot hold,
    gets earcut's own result.
    """
    vertices = np.asarray(vertices).astype(np.int64, copy=False)
    raw = mapbox_earcut.triangulate_int64(vertices, ring_end_indices)
    if not len(raw):
        return raw
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    if any(above - below > EXACT for below, above in zip(low, high, strict=True)):
        return raw
    return _improved(raw, vertices - np.array(low), ring_end_indices)


def _improved(raw: np.ndarray, vertices: np.ndarray, ring_end_indices: np.ndarray) -> np.ndarray:
    """Return triangles cheaper to draw than earcut's `raw`, or `raw` where there are none."""
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    ends = np.asarray(ring_end_indices, dtype=np.int64)
    if not len(raw) or not np.isfinite(points).all():
        return raw
    best = _optimum(points, ends)
    return raw if best is None else best.astype(np.uint32).ravel()


def _optimum(points: np.ndarray, ends: np.ndarray) -> np.ndarray | None:
    """Return the optimum (m, 3), or None if the rings are no valid polygon."""
    n = len(points)
    if len(ends) == 1 and n <= SMALL and winding(points[np.arange(-1, n)]) != UNSURE:
        triangles = np.empty((n - 2, 3), dtype=np.int32)
        if ring_optimum(points, _BOX, triangles) < np.inf:
            return triangles
    outline = boundary_of_rings(points, ends)
    try:
        if not shapely.is_valid(as_polygon(outline)):
            return None
        return optimal.triangulate(outline, criterion="half-perimeter")
    except (TriangulationError, ValueError):  # too few vertices in a ring, for one
        return None
