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
counter-clockwise; where coordinates are not on a grid (see `predicates.grid_unit`), a vertex within
rounding error of an edge counts as on it when they are verified or repaired.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from triangulators import criteria as criteria
    from triangulators.batch import Triangulations as Triangulations
    from triangulators.calling import triangulate as triangulate
    from triangulators.calling import triangulate_with_gap as triangulate_with_gap
    from triangulators.certificate.certify import certify as certify
    from triangulators.checking.evidence import Certificate as Certificate
    from triangulators.errors import InvalidPolygon as InvalidPolygon
    from triangulators.errors import Skipped as Skipped
    from triangulators.errors import TriangulationError as TriangulationError
    from triangulators.errors import Unavailable as Unavailable
    from triangulators.errors import UnknownName as UnknownName
    from triangulators.many import triangulate_many as triangulate_many
    from triangulators.methods.flips import flip as flip
    from triangulators.polygon import vertices as vertices
    from triangulators.polygon_arrays import PolygonArray as PolygonArray
    from triangulators.registry import find as find
    from triangulators.registry import full_name as full_name
    from triangulators.registry import names as names
    from triangulators.registry import parse as parse

_NAMES = {
    "batch": ("Triangulations",),
    "calling": ("triangulate", "triangulate_with_gap"),
    "certificate.certify": ("certify",),
    "checking.evidence": ("Certificate",),
    "errors": ("InvalidPolygon", "Skipped", "TriangulationError", "Unavailable", "UnknownName"),
    "many": ("triangulate_many",),
    "methods.flips": ("flip",),
    "polygon": ("vertices",),
    "polygon_arrays": ("PolygonArray",),
    "registry": ("find", "full_name", "names", "parse"),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}
"""Where each name is: it is imported when it is asked for, because compiled code takes a second."""

__all__ = ["criteria", *_HOME]


def __getattr__(name: str) -> Any:
    """Import what is asked for: a name of `__all__`."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "criteria":
        return import_module("triangulators.criteria")
    value = getattr(import_module(f"triangulators.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
