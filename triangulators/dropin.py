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

_COST = cost_of(CRITERIA["half-perimeter"], 1.0, 1)


_ONE = np.array([0], dtype=np.int64)


def triangulate_float64(vertices: np.ndarray, ring_end_indices: np.ndarray) -> np.ndarray:
    """Triangulate rings; return flat uint32 indices, three a triangle, counter-clockwise.

    vertices: (n, 2) float64, all rings' vertices, the exterior first; ring_end_indices: (r,)
    uint32, where each ring ends, the last one n. Raises what `mapbox_earcut` raises.
    """
    raw = mapbox_earcut.triangulate_float64(vertices, ring_end_indices)
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    ends = np.asarray(ring_end_indices, dtype=np.int64)
    count = len(raw) // 3
    done = np.zeros(1, dtype=np.bool_)
    if len(ends) == 1 and 3 <= len(points) <= SMALL and np.isfinite(points).all():
        triangles = np.empty((len(points) - 2, 3), dtype=np.int32)
        bounds = np.array([0, len(triangles)])
        wanted = np.ones(1, dtype=np.bool_)
        do_rings(0, 1, points, np.r_[0, ends], wanted, _COST.box, bounds, triangles, done)
    if count and not done[0]:
        triangles = raw.astype(np.int32).reshape(-1, 3)
        kernel = (_ONE, _COST.weights, _COST.function, _COST.box, triangles, np.array([0, count]))
        improve_many(0, 1, points, ends, np.array([0, len(ends)]), *kernel, done)
    return triangles.astype(np.uint32).ravel() if done[0] else raw


def triangulate_float32(vertices: np.ndarray, ring_end_indices: np.ndarray) -> np.ndarray:
    """`triangulate_float64` for (n, 2) float32 vertices, which it decides exactly."""
    return triangulate_float64(np.asarray(vertices, dtype=np.float64), ring_end_indices)
