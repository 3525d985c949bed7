"""Triangulators: polygon -> triangles over the polygon's own vertices; none is ever added.

from triangulators import triangulate, vertices
triangles = triangulate(polygon, "optimal:half-perimeter")   # (m, 3) int32
corners = vertices(polygon)[triangles]                       # (m, 3, 2) float64
"""

from triangulators import criteria
from triangulators.batch import Ragged, Triangulations, triangulate_many
from triangulators.errors import (
    InvalidPolygon,
    Skipped,
    TriangulationError,
    Unavailable,
    UnknownName,
)
from triangulators.polygon import vertices
from triangulators.registry import find, full_name, names, parse, triangulate

__all__ = [
    "InvalidPolygon",
    "Ragged",
    "Skipped",
    "TriangulationError",
    "Triangulations",
    "Unavailable",
    "UnknownName",
    "criteria",
    "find",
    "full_name",
    "names",
    "parse",
    "triangulate",
    "triangulate_many",
    "vertices",
]
