"""Sweep-line triangulation into monotone pieces: the GLU tessellator, through PyOpenGL.

Needs the library libGLU, but no GL context.
"""

from __future__ import annotations

import ctypes.util
import importlib.util
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from triangulators.errors import TriangulationError

if TYPE_CHECKING:
    from triangulators.polygon import Boundary


@lru_cache(maxsize=1)
def installed() -> bool:
    """Whether PyOpenGL and libGLU are there."""
    return bool(importlib.util.find_spec("OpenGL") and ctypes.util.find_library("GLU"))


class _Collector:
    """Receives what the tessellator emits: indices of vertices, three a triangle."""

    def __init__(self, outline: Boundary) -> None:
        self.points = outline.points
        self.indices: list[int] = []
        self.errors: list[int] = []

    def vertex(self, index: int) -> None:
        self.indices.append(index)

    def combine(self, coordinates: Any, vertices: Any, _weights: Any) -> int:
        """Name the vertex where edges meet: one of the polygon's, if rings touch there."""
        for index in vertices:
            if index is not None and np.array_equal(self.points[index], coordinates[:2]):
                return int(index)
        self.errors.append(-1)
        return int(vertices[0])


def triangulate(outline: Boundary) -> np.ndarray:
    """Return the triangles (m, 3)."""
    from OpenGL import GLU

    collector = _Collector(outline)
    tessellator = GLU.gluNewTess()
    GLU.gluTessNormal(tessellator, 0.0, 0.0, 1.0)
    GLU.gluTessProperty(tessellator, GLU.GLU_TESS_WINDING_RULE, GLU.GLU_TESS_WINDING_ODD)
    callbacks = {
        GLU.GLU_TESS_VERTEX: collector.vertex,
        GLU.GLU_TESS_COMBINE: collector.combine,
        GLU.GLU_TESS_ERROR: collector.errors.append,
        GLU.GLU_TESS_EDGE_FLAG: lambda _flag: None,  # makes GLU emit plain triangles
        GLU.GLU_TESS_BEGIN: lambda _mode: None,
        GLU.GLU_TESS_END: lambda: None,
    }
    for which, function in callbacks.items():
        GLU.gluTessCallback(tessellator, which, function)
    try:
        GLU.gluTessBeginPolygon(tessellator, None)
        start = 0
        for end in outline.ends.tolist():
            GLU.gluTessBeginContour(tessellator)
            for index in range(start, end):
                x, y = outline.points[index]
                GLU.gluTessVertex(tessellator, (x, y, 0.0), index)
            GLU.gluTessEndContour(tessellator)
            start = end
        GLU.gluTessEndPolygon(tessellator)
    finally:
        GLU.gluDeleteTess(tessellator)
    if -1 in collector.errors:
        raise TriangulationError("sweep: the tessellator would add a vertex where edges meet")
    if collector.errors:
        raise TriangulationError(f"sweep: GLU error {collector.errors[0]}")
    return np.array(collector.indices, dtype=np.int64).reshape(-1, 3)
