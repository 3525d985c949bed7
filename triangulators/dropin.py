"""Drop-in replacement of mapbox_earcut: the same interface, triangles that are cheaper to draw.

    from triangulators.dropin import triangulate_float64   # was: from mapbox_earcut import ...

`method` is a triangulator:

- "flips:l1" (the default, also "flips"): earcut's triangles, with diagonals flipped to shorter
  ones in the L1 metric (see `triangulators.flip`), which reduces the 2x2 pixel quads that a GPU
  shades. Takes little longer than earcut.
- "refined:half-perimeter" (also "refined"): diagonals are flipped twice, starting from earcut's and
  from Delaunay triangles; the better result is returned.
- "optimal:half-perimeter": the minimum sum of the half-perimeters of bounding boxes.

For an invalid polygon the last two return earcut's result, as a program that works with earcut
expects. `triangulate_many(..., "flips:l1")` triangulates many polygons in one call.
"""

import numpy as np

from triangulators.errors import TriangulationError, UnknownNameError, suggest
from triangulators.geometry.ear_clipping import run_earcut
from triangulators.geometry.flips import shorten_diagonals
from triangulators.geometry.order import is_walk

__all__ = ["triangulate_float32", "triangulate_float64", "triangulate_int32", "triangulate_int64"]

METHODS = ("flips:l1", "refined:half-perimeter", "optimal:half-perimeter")
SHORT_NAMES = {"flips": METHODS[0], "refined": METHODS[1]}

MAX_EXACT_INTEGER = 2**53  # doubles represent all integers up to this


def triangulate_float64(
    vertices: np.ndarray,
    ring_end_indices: np.ndarray,
    method: str = "flips:l1",
    order: str = "walk",
) -> np.ndarray:
    """Triangulate the rings of a polygon.

    Parameters
    ----------
    vertices
        (n, 2) float64, the vertices of all rings, the exterior first.
    ring_end_indices
        (r,) uint32, the end of each ring in `vertices`; the last is n.
    method
        "flips:l1", "refined:half-perimeter" or "optimal:half-perimeter"; see the module.
    order
        For "flips:l1": "walk" is an order from neighbour to neighbour, in which a GPU transforms
        few vertices twice; "native" leaves flipped triangles at earcut's positions. The results of
        the other methods are always in walk order.

    Returns
    -------
    ndarray
        (3 m,) uint32 indices, three per triangle, counter-clockwise.

    Raises
    ------
    UnknownNameError
        If there is no such method or order.
    ValueError
        If the arrays are inconsistent, as in `mapbox_earcut`.

    Examples
    --------
    >>> square = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
    >>> triangulate_float64(square, np.array([4], dtype=np.uint32)).shape
    (6,)
    """
    raw = run_earcut(vertices, ring_end_indices)
    return _improve_triangles(raw, vertices, ring_end_indices, method, order)


def triangulate_float32(
    vertices: np.ndarray,
    ring_end_indices: np.ndarray,
    method: str = "flips:l1",
    order: str = "walk",
) -> np.ndarray:
    """Triangulate the rings of a polygon with float32 vertices.

    Parameters
    ----------
    vertices
        (n, 2) float32, which are converted to float64 without rounding.
    ring_end_indices, method, order
        As for `triangulate_float64`.

    Returns
    -------
    ndarray
        (3 m,) uint32, as `triangulate_float64` returns.
    """
    return triangulate_float64(
        np.asarray(vertices, dtype=np.float64), ring_end_indices, method, order
    )


def triangulate_int32(
    vertices: np.ndarray,
    ring_end_indices: np.ndarray,
    method: str = "flips:l1",
    order: str = "walk",
) -> np.ndarray:
    """Triangulate the rings of a polygon with int32 vertices.

    Parameters
    ----------
    vertices
        (n, 2) int32, converted to float64 without rounding. Other types are cast to int32.
    ring_end_indices, method, order
        As for `triangulate_float64`.

    Returns
    -------
    ndarray
        (3 m,) uint32, as `triangulate_float64` returns.
    """
    return triangulate_float64(
        np.asarray(vertices).astype(np.int32, copy=False), ring_end_indices, method, order
    )


def triangulate_int64(
    vertices: np.ndarray,
    ring_end_indices: np.ndarray,
    method: str = "flips:l1",
    order: str = "walk",
) -> np.ndarray:
    """Triangulate the rings of a polygon with int64 vertices.

    Parameters
    ----------
    vertices
        (n, 2) int64; other types are cast. If the width or height exceeds 2^53, above which doubles
        skip integers, earcut's triangles are returned without flips or optimisation.
    ring_end_indices, method, order
        As for `triangulate_float64`.

    Returns
    -------
    ndarray
        (3 m,) uint32, as `triangulate_float64` returns.
    """
    vertices = np.asarray(vertices).astype(np.int64, copy=False)
    raw = run_earcut(vertices, ring_end_indices)
    if not len(raw):
        return raw
    low, high = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    if any(above - below > MAX_EXACT_INTEGER for below, above in zip(low, high, strict=True)):
        return raw
    return _improve_triangles(raw, vertices - np.array(low), ring_end_indices, method, order)


def _improve_triangles(
    raw: np.ndarray, vertices: np.ndarray, ring_end_indices: np.ndarray, method: str, order: str
) -> np.ndarray:
    """Return the triangles (3 m,) of `method`, or earcut's triangles `raw` if rings are invalid."""
    method = SHORT_NAMES.get(method, method)
    if method not in METHODS:
        raise UnknownNameError(f"unknown method {method!r}; {suggest(method, METHODS)}")
    in_walk = is_walk(order)
    points = np.ascontiguousarray(vertices, dtype=np.float64)
    if method == "flips:l1":
        if len(raw) > 3:
            shorten_diagonals(points, raw, in_walk)
        return raw
    if not len(raw) or not np.isfinite(points).all():
        return raw
    improved = _triangulate_by_method(
        points, np.append(0, ring_end_indices).astype(np.int64), method
    )
    return raw if improved is None else improved.astype(np.uint32).ravel()


def _triangulate_by_method(
    points: np.ndarray, ring_offsets: np.ndarray, method: str
) -> np.ndarray | None:
    """Return triangles (m, 3) of "refined" or "optimal", or None if the rings are invalid."""
    # Imported here, because "flips:l1" needs none of these modules; importing takes a second.
    from triangulators.methods import flips, optimal
    from triangulators.optimum.full_table import solve_by_full_table
    from triangulators.polygon import UNSURE, checked_boundary, find_ring_orientation
    from triangulators.polygon_arrays import polygon_of_rings

    is_optimal = method == "optimal:half-perimeter"
    if (
        is_optimal
        and len(ring_offsets) == 2
        and find_ring_orientation(points[np.arange(-1, len(points))]) != UNSURE
    ):
        triangles = solve_by_full_table(points, np.array([1.0, 0.0, 0.0]))
        if triangles is not None:
            return triangles
    triangulate = optimal.triangulate if is_optimal else flips.triangulate_refined
    try:
        outline = checked_boundary(polygon_of_rings(points, ring_offsets))
        return triangulate(outline, criterion="half-perimeter")
    except (TriangulationError, ValueError):  # for example a ring of two vertices
        return None
