"""Triangulators: polygon -> triangles over the polygon's own vertices; none is ever added.

    >>> import shapely
    >>> from triangulators import triangulate, vertices
    >>> polygon = shapely.Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)])
    >>> triangles = triangulate(polygon, "optimal:half-perimeter")
    >>> triangles.shape, triangles.dtype
    ((4, 3), dtype('int32'))
    >>> vertices(polygon)[triangles].shape
    (4, 3, 2)

What is guaranteed: orientations are decided exactly for all doubles (no overflow or underflow), so
every result of `optimal`, `worst`, `exhaustive`, `greedy`, `max-area`, `random`, `fan` and `strip`
is a conforming triangulation of the polygon as given, and `verify` is exact in what it says about
coverage. Only which of two triangulations is cheaper is a matter of rounding. Libraries' results
(`ear-clipping`, `delaunay`, `sweep`, `manifold`) are passed on as they are, wound
counter-clockwise; where coordinates are not on a grid (see `predicates.on_grid`), a vertex within
rounding error of an edge counts as on it when they are verified or repaired.
"""

from triangulators import criteria
from triangulators.batch.device_times import measure_device
from triangulators.batch.many import Ragged, Triangulations, triangulate_many
from triangulators.certificate.certify import certify
from triangulators.checking.evidence import Certificate
from triangulators.compiled import warm_up
from triangulators.errors import (
    InvalidPolygon,
    Skipped,
    TriangulationError,
    Unavailable,
    UnknownName,
)
from triangulators.polygon import vertices
from triangulators.registry import (
    find,
    full_name,
    names,
    parse,
    triangulate,
    triangulate_with_gap,
)

__all__ = [
    "Certificate",
    "InvalidPolygon",
    "Ragged",
    "Skipped",
    "TriangulationError",
    "Triangulations",
    "Unavailable",
    "UnknownName",
    "certify",
    "criteria",
    "find",
    "full_name",
    "measure_device",
    "names",
    "parse",
    "triangulate",
    "triangulate_many",
    "triangulate_with_gap",
    "vertices",
    "warm_up",
]
