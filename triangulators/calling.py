"""Triangulates one polygon by a triangulator's name, and checks what comes back."""

from collections.abc import Callable
from typing import Any

import numpy as np
import shapely

from triangulators import criteria
from triangulators.criteria.cost import require_number
from triangulators.errors import TriangulationError
from triangulators.polygon import Boundary, checked_boundary
from triangulators.registry import Choice, load, parse
from triangulators.repair import insert_dropped_vertices, left_turning
from triangulators.verify import rows_of


def triangulate(
    polygon: shapely.Polygon,
    name: str,
    *,
    criterion: criteria.Criterion | str | Callable[..., float] | None = None,
    repair: bool = False,
    **parameters: Any,
) -> np.ndarray:
    """Triangulate a polygon; return (m, 3) int32 indices into `vertices(polygon)`.

    Triangles are counter-clockwise (y up). `name` is a triangulator, optionally with a criterion
    (`optimal:half-perimeter`); `criterion` may also be given apart, as a name, a `Criterion` or a
    Numba function of three points. `repair=True` puts back collinear vertices that a library has
    dropped, where it left T-junctions. Other parameters go to the triangulator.

    Raises `InvalidPolygon` for input that is not a valid polygon, `Skipped` where the triangulator
    does not do this polygon by design, `Unavailable` if a package is missing,
    `TriangulationError` if it failed, and `UnknownName`.

        >>> triangulate(shapely.Polygon([(0, 0), (2, 0), (0, 1)]), "fan").tolist()
        [[0, 1, 2]]
    """
    outline, choice, raw = _called(polygon, name, criterion, parameters)
    triangles = _checked(outline, raw, choice, criterion)
    return insert_dropped_vertices(outline, triangles) if repair else triangles


def triangulate_with_gap(
    polygon: shapely.Polygon,
    name: str,
    *,
    criterion: criteria.Criterion | str | Callable[..., float] | None = None,
    **parameters: Any,
) -> tuple[np.ndarray, float | None]:
    """Return what `triangulate` does, and how far it may be from the optimum of its criterion.

    The gap is relative to the cost, 0 where the result is optimal and infinite where nothing is
    known; None for a triangulator that does not look for the optimum. Raises as `triangulate`.

        >>> triangulate_with_gap(shapely.box(0, 0, 2, 1), "optimal")[1]
        0.0
    """
    outline, choice, raw = _called(polygon, name, criterion, parameters, with_gap=True)
    raw, gap = raw if choice.entry.with_gap else (raw, None)
    return _checked(outline, raw, choice, criterion), gap


def _called(
    polygon: shapely.Polygon,
    name: str,
    criterion: criteria.Criterion | str | Callable[..., float] | None,
    parameters: dict[str, Any],
    *,
    with_gap: bool = False,
) -> tuple[Boundary, Choice, Any]:
    """Return what a triangulator gives for a polygon, with its gap where it knows one."""
    choice = parse(name)
    entry = choice.entry
    outline = checked_boundary(polygon)
    function = load(entry.with_gap) if with_gap and entry.with_gap else entry.load()
    if not entry.builtin:
        return outline, choice, function(polygon, **parameters)
    if entry.criteria:
        parameters["criterion"] = choice.criterion if criterion is None else criterion
    elif criterion is not None:
        raise TypeError(f"triangulator {entry.name!r} takes no criterion")
    return outline, choice, function(outline, **parameters)


def _checked(outline: Boundary, raw: Any, choice: Choice, criterion: Any) -> np.ndarray:
    """Return triangles as int32 (m, 3), wound counter-clockwise, those without area left out.

    Raises `TriangulationError` for anything else, and if a user's criterion is no number for a
    triangle.
    """
    try:
        triangles = left_turning(outline.points, rows_of(raw, outline.points))
    except ValueError as error:
        raise TriangulationError(f"{choice.full_name}: {error}") from error
    if criterion is not None and not isinstance(criterion, str):
        require_number(criteria.find(criterion), outline.points, triangles)
    return triangles
