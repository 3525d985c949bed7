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

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from triangulators import criteria
    from triangulators.batch.triangulate_many import Ragged, Triangulations, triangulate_many
    from triangulators.calling import triangulate, triangulate_with_gap
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
    from triangulators.methods.flips import flip
    from triangulators.polygon import vertices
    from triangulators.registry import find, full_name, names, parse

_HOME = {
    "triangulators.batch.triangulate_many": (
        "Ragged",
        "Triangulations",
        "triangulate_many",
    ),
    "triangulators.calling": (
        "triangulate",
        "triangulate_with_gap",
    ),
    "triangulators.certificate.certify": ("certify",),
    "triangulators.checking.evidence": ("Certificate",),
    "triangulators.compiled": ("warm_up",),
    "triangulators.errors": (
        "InvalidPolygon",
        "Skipped",
        "TriangulationError",
        "Unavailable",
        "UnknownName",
    ),
    "triangulators.methods.flips": ("flip",),
    "triangulators.polygon": ("vertices",),
    "triangulators.registry": (
        "find",
        "full_name",
        "names",
        "parse",
    ),
}
"""Where each name is: it is imported when it is asked for, because compiled code takes a second."""

_MODULES = {name: module for module, names in _HOME.items() for name in names}

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
    "flip",
    "full_name",
    "names",
    "parse",
    "triangulate",
    "triangulate_many",
    "triangulate_with_gap",
    "vertices",
    "warm_up",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for: a name of `__all__`, or a module of this package."""
    if name in _MODULES:
        value = getattr(import_module(_MODULES[name]), name)
    elif name == "criteria":
        value = import_module("triangulators.criteria")
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
