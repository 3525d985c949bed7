"""Triangulate polygons without adding vertices, minimise a criterion, verify and certify.

    >>> import shapely
    >>> from triangulators import triangulate, vertices
    >>> polygon = shapely.Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)])
    >>> triangles = triangulate(polygon, "optimal:half-perimeter")
    >>> triangles.shape, triangles.dtype
    ((4, 3), dtype('int32'))
    >>> vertices(polygon)[triangles].shape
    (4, 3, 2)

Guarantees: orientations are exact for all doubles, so every result of `optimal`, `worst`,
`exhaustive`, `greedy`, `max-area`, `random`, `fan` and `strip` is a conforming triangulation, and
`verify` decides coverage exactly. Only the comparison of costs is subject to rounding. Triangles of
other libraries (`ear-clipping`, `delaunay`, `sweep`, `manifold`) are only made counter-clockwise;
off a grid (see `predicates.find_grid_unit`), verification and repair treat a vertex within rounding
error of an edge as lying on it.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from triangulators import criteria as criteria
    from triangulators.calling import triangulate as triangulate
    from triangulators.calling import triangulate_with_gap as triangulate_with_gap
    from triangulators.certificate.certify import certify as certify
    from triangulators.checking.evidence import Certificate as Certificate
    from triangulators.errors import ArgumentError as ArgumentError
    from triangulators.errors import InvalidPolygonError as InvalidPolygonError
    from triangulators.errors import SkippedError as SkippedError
    from triangulators.errors import TriangulationError as TriangulationError
    from triangulators.errors import UnavailableError as UnavailableError
    from triangulators.errors import UnknownNameError as UnknownNameError
    from triangulators.many import triangulate_many as triangulate_many
    from triangulators.methods.flips import flip as flip
    from triangulators.polygon import vertices as vertices
    from triangulators.polygon_arrays import PolygonArray as PolygonArray
    from triangulators.polygon_arrays import Triangulations as Triangulations
    from triangulators.registry import find as find
    from triangulators.registry import full_name as full_name
    from triangulators.registry import names as names
    from triangulators.registry import parse as parse

__version__ = "1.0.0"

_NAMES = {
    "calling": ("triangulate", "triangulate_with_gap"),
    "certificate.certify": ("certify",),
    "checking.evidence": ("Certificate",),
    "errors": (
        "ArgumentError",
        "InvalidPolygonError",
        "SkippedError",
        "TriangulationError",
        "UnavailableError",
        "UnknownNameError",
    ),
    "many": ("triangulate_many",),
    "methods.flips": ("flip",),
    "polygon": ("vertices",),
    "polygon_arrays": ("PolygonArray", "Triangulations"),
    "registry": ("find", "full_name", "names", "parse"),
}
# Imported on first access, because compiled code takes a second.
_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}

__all__ = ["criteria", *_MODULE_OF]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "criteria":
        return _import_module("triangulators.criteria")
    value: object = getattr(_import_module(f"triangulators.{_MODULE_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
