"""Triangulations by third-party libraries: ear clipping, Delaunay, manifold, sweep."""

import ctypes.util
import importlib.util
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from triangulators.errors import TriangulationError
from triangulators.geometry.ear_clipping import run_earcut
from triangulators.polygon import Boundary, find_sites, orient_rings
from triangulators.polygon_arrays import polygon_of_rings


def ear_clipping(outline: Boundary) -> np.ndarray:
    """Return mapbox_earcut's triangles (m, 3); some dropped vertices become T-junctions."""
    ring_ends = outline.ring_offsets[1:].astype(np.uint32)
    return run_earcut(outline.points, ring_ends).reshape(-1, 3)


def delaunay(outline: Boundary) -> np.ndarray:
    """Return the constrained Delaunay triangulation (m, 3) of GEOS, through shapely."""
    try:
        pieces = shapely.constrained_delaunay_triangles(
            polygon_of_rings(outline.points, outline.ring_offsets)
        )
    except shapely.GEOSException as error:
        raise TriangulationError(f"delaunay: {error}") from error
    corners = shapely.get_coordinates(pieces).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
    count = len(outline.points)
    # + 0.0 turns -0.0 into 0.0, so that equal coordinates also have equal bits.
    indices = find_sites(np.concatenate((outline.points, corners)) + 0.0)[count:]
    if (indices >= count).any():
        raise TriangulationError("delaunay: GEOS returned a point that is not a vertex")
    return indices.reshape(-1, 3)


def manifold(outline: Boundary) -> np.ndarray:
    """Return the triangles (m, 3) of manifold3d: ear clipping that tolerates imprecise input."""
    import manifold3d

    corners = orient_rings(outline.points, outline.ring_offsets)
    rings = np.split(outline.points[corners], outline.ring_offsets[1:-1])
    try:
        triangles = manifold3d.triangulate(rings)
    except RuntimeError as error:
        raise TriangulationError(f"manifold: {error}") from error
    return corners[np.asarray(triangles, dtype=np.int64)].reshape(-1, 3)


@lru_cache(maxsize=1)
def is_sweep_installed() -> bool:
    """Whether PyOpenGL and libGLU, which `sweep` needs, are installed."""
    return bool(importlib.util.find_spec("OpenGL") and ctypes.util.find_library("GLU"))


def sweep(outline: Boundary) -> np.ndarray:
    """Return the triangles (m, 3) of the GLU tessellator, by a sweep-line decomposition."""
    from OpenGL import GLU

    indices: list[int] = []
    errors: list[int] = []

    def combine(coordinates: Any, vertices: Any, _weights: Any) -> int:
        """Return the polygon's vertex where edges meet; append -1 to `errors` if there is none."""
        for index in vertices:
            if index is not None and np.array_equal(outline.points[index], coordinates[:2]):
                return int(index)
        errors.append(-1)
        return int(vertices[0])

    tessellator = GLU.gluNewTess()
    GLU.gluTessNormal(tessellator, 0.0, 0.0, 1.0)
    GLU.gluTessProperty(tessellator, GLU.GLU_TESS_WINDING_RULE, GLU.GLU_TESS_WINDING_ODD)
    callbacks = {
        GLU.GLU_TESS_VERTEX: indices.append,
        GLU.GLU_TESS_COMBINE: combine,
        GLU.GLU_TESS_ERROR: errors.append,
        # With this callback GLU emits separate triangles, no strips or fans.
        GLU.GLU_TESS_EDGE_FLAG: lambda _flag: None,
        GLU.GLU_TESS_BEGIN: lambda _mode: None,
        GLU.GLU_TESS_END: lambda: None,
    }
    for name, function in callbacks.items():
        GLU.gluTessCallback(tessellator, name, function)
    try:
        GLU.gluTessBeginPolygon(tessellator, None)
        for start, end in pairwise(outline.ring_offsets.tolist()):
            GLU.gluTessBeginContour(tessellator)
            for index in range(start, end):
                x, y = outline.points[index]
                GLU.gluTessVertex(tessellator, (x, y, 0.0), index)
            GLU.gluTessEndContour(tessellator)
        GLU.gluTessEndPolygon(tessellator)
    finally:
        GLU.gluDeleteTess(tessellator)
    if -1 in errors:
        raise TriangulationError("sweep: the tessellator would add a vertex where edges meet")
    if errors:
        problem = GLU.gluErrorString(errors[0]).decode()
        raise TriangulationError(
            f"sweep: the OpenGL tessellator failed ({problem}); choose another triangulator"
        )
    return np.array(indices, dtype=np.int64).reshape(-1, 3)
