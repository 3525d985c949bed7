"""A drop-in for mapbox_earcut: the same arguments and result, triangles cheaper to draw.

    from triangulators.dropin import triangulate_float64   # was: from mapbox_earcut import ...

The triangles minimise the sum of their bounding boxes' half-perimeters, which is what a GPU's quads
follow: exactly without holes, by local search from earcut's result with them. Where earcut's
input is not a valid polygon, its own result is returned, as a program that works with earcut
expects.
"""

import mapbox_earcut
import numpy as np

from triangulators.batch_kernels import SMALL, do_rings, improve_many
from triangulators.cost import cost_of
from triangulators.criteria import CRITERIA
from triangulators.local_search import search_cuts, sweep_windows
from triangulators.optimal import LIMIT
from triangulators.polygon import boundary_of_rings
from triangulators.repair import insert_dropped_vertices
from triangulators.starts import left_turning
from triangulators.verify import verify_boundary

EXACT = 2**53
"""Whole numbers up to this are doubles."""

_COST = cost_of(CRITERIA["half-perimeter"], 1.0, 1)


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
    raw = mapbox_earcut.triangulate_int32(vertices, ring_end_indices)
    return _improved(raw, vertices, ring_end_indices)


def triangulate_int64(vertices: np.ndarray, ring_end_indices: np.ndarray) -> np.ndarray:
    """`triangulate_float64` for (n, 2) int64 vertices.

    Decided exactly up to an extent of 2^53; a polygon that reaches further, which doubles
    cannot hold, gets earcut's own result.
    """
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
    if len(raw) // 3 + 2 > SMALL:
        triangles = _large(points, ends, raw.astype(np.int32).reshape(-1, 3))
        return triangles.astype(np.uint32).ravel()
    done = np.zeros(1, dtype=np.bool_)
    if len(ends) == 1:
        triangles = np.empty((len(points) - 2, 3), dtype=np.int32)
        begins, bounds = np.array([0, len(points)]), np.array([0, len(triangles)])
        wanted = np.ones(1, dtype=np.bool_)
        do_rings(0, 1, points, begins, wanted, _COST.box, bounds, triangles, done)
    if not done[0]:
        triangles = raw.astype(np.int32).reshape(-1, 3)
        owners, which, bounds = (
            np.array([0, len(ends)]),
            np.array([0]),
            np.array([0, len(raw) // 3]),
        )
        improve_many(0, 1, points, ends, owners, which, _COST.box, triangles, bounds, done)
    return triangles.astype(np.uint32).ravel() if done[0] else raw


def _large(points: np.ndarray, ends: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Improve earcut's triangles if they are a triangulation; otherwise return them."""
    outline = boundary_of_rings(points, ends)
    triangles = insert_dropped_vertices(outline, left_turning(points, triangles))
    if not verify_boundary(outline, triangles).conforming:
        return triangles
    improve = search_cuts if len(points) <= LIMIT else sweep_windows
    return improve(points, outline.site[triangles], _COST)
