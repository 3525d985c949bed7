"""A drop-in for mapbox_earcut: the same arguments and result, triangles cheaper to draw.

    from triangulators.dropin import triangulate_float64   # was: from mapbox_earcut import ...

`method` says how the triangles are found:

- "flips", the usual one: earcut's own, their diagonals flipped to ones that are shorter in the L1
  metric, which is what a GPU's quads follow (`flip`). It takes little longer than earcut.
- "refined": the better of flips from earcut's triangles and from Delaunay's, in the order of
  a walk from neighbour to neighbour (`refined`).
- "optimal": the least sum of the half-perimeters of bounding boxes (`optimal:half-perimeter`).

Where "refined" or "optimal" gets what is not a valid polygon, earcut's own result is returned, as a
program that works with earcut expects. `triangulate_many(..., "flips:l1")` does many polygons.
"""

import numpy as np

from triangulators.geometry.earcut import clip_ears
from triangulators.geometry.flips import shorten

EXACT = 2**53
"""Whole numbers up to this are doubles."""


def triangulate_float64(
    vertices: np.ndarray, ring_end_indices: np.ndarray, method: str = "flips"
) -> np.ndarray:
    """Triangulate rings; return flat uint32 indices, three a triangle, counter-clockwise.

    vertices: (n, 2) float64, all rings' vertices, the exterior first; ring_end_indices: (r,)
    uint32, where each ring ends, the last one n; method: see above. Raises what `mapbox_earcut`
    raises, and `ValueError` for an unknown method.

        >>> square = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
        >>> triangulate_float64(square, np.array([4], dtype=np.uint32)).shape
        (6,)
    """
    raw = clip_ears(vertices, ring_end_indices)
    return _improved(raw, vertices, ring_end_indices, method)


def triangulate_float32(
    vertices: np.ndarray, ring_end_indices: np.ndarray, method: str = "flips"
) -> np.ndarray:
    """`triangulate_float64` for (n, 2) float32 vertices, which it decides exactly."""
    return triangulate_float64(np.asarray(vertices, dtype=np.float64), ring_end_indices, method)


def triangulate_int32(
    vertices: np.ndarray, ring_end_indices: np.ndarray, method: str = "flips"
) -> np.ndarray:
    """`triangulate_float64` for (n, 2) int32 vertices, which it decides exactly."""
    vertices = np.asarray(vertices).astype(np.int32, copy=False)
    raw = clip_ears(vertices, ring_end_indices)
    return _improved(raw, vertices, ring_end_indices, method)


def triangulate_int64(
    vertices: np.ndarray, ring_end_indices: np.ndarray, method: str = "flips"
) -> np.ndarray:
    """`triangulate_float64` for (n, 2) int64 vertices.

    Decided exactly up to an extent of 2^53; a polygon that is larger, which doubles cannot hold,
    gets earcut's own result.
    """
    vertices = np.asarray(vertices).astype(np.int64, copy=False)
    raw = clip_ears(vertices, ring_end_indices)
    if not len(raw):
        return raw
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    if any(above - below > EXACT for below, above in zip(low, high, strict=True)):
        return raw
    return _improved(raw, vertices - np.array(low), ring_end_indices, method)


def _improved(
    raw: np.ndarray, vertices: np.ndarray, ring_end_indices: np.ndarray, method: str
) -> np.ndarray:
    """Return triangles cheaper to draw than earcut's `raw`, or `raw` where there are none."""
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    if method == "flips":
        if len(raw) > 3:
            shorten(points, raw)
        return raw
    if method not in ("refined", "optimal"):
        raise ValueError(f"method {method!r} is not one of flips, refined, optimal")
    if not len(raw) or not np.isfinite(points).all():
        return raw
    best = _best(points, np.append(0, ring_end_indices).astype(np.int64), method)
    return raw if best is None else best.astype(np.uint32).ravel()


def _best(points: np.ndarray, ring_offsets: np.ndarray, method: str) -> np.ndarray | None:
    """Return the triangles (m, 3) of a slower method, or None if the rings are no valid polygon."""
    # What these need takes a second to import, which those who flip need not wait for.
    from triangulators.errors import TriangulationError
    from triangulators.methods import flips, optimal
    from triangulators.optimum.full_table import by_full_table
    from triangulators.polygon import UNSURE, checked_boundary, winding
    from triangulators.polygon_arrays import polygon_of_rings

    n = len(points)
    if (
        method == "optimal"
        and len(ring_offsets) == 2
        and winding(points[np.arange(-1, n)]) != UNSURE
    ):
        triangles = np.empty((n - 2, 3), dtype=np.int32)
        if by_full_table(points, np.array([1.0, 0.0, 0.0]), triangles) < np.inf:
            return triangles
    find = optimal.triangulate if method == "optimal" else flips.triangulate_refined
    try:
        outline = checked_boundary(polygon_of_rings(points, ring_offsets))
        return find(outline, criterion="half-perimeter")
    except (TriangulationError, ValueError):  # too few vertices in a ring, for one
        return None
