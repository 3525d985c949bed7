"""Constrained Delaunay triangulation by GEOS, through shapely."""

import numpy as np
import shapely

from triangulators.errors import TriangulationError
from triangulators.polygon import Boundary, as_polygon


def triangulate(outline: Boundary) -> np.ndarray:
    """Return the triangles (m, 3). GEOS answers in coordinates; they are looked up here."""
    try:
        pieces = shapely.constrained_delaunay_triangles(as_polygon(outline))
    except shapely.GEOSException as error:
        raise TriangulationError(f"delaunay: {error}") from error
    corners = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    return find_vertices(outline.points, corners).reshape(-1, 3)


def find_vertices(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return for each of (k, 2) coordinates the index of the first equal row of `points`."""
    order = np.lexsort((points[:, 1], points[:, 0]))
    keys = np.ascontiguousarray(points[order] + 0.0).view(np.complex128).ravel()
    wanted = np.ascontiguousarray(corners + 0.0).view(np.complex128).ravel()
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    if not np.array_equal(keys[place], wanted):
        raise TriangulationError("delaunay: GEOS returned a point that is not a vertex")
    return order[place]
