"""Triangulates one polygon by a triangulator's name, and checks what comes back."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import shapely

from triangulators import criteria
from triangulators.criteria.cost import require_number
from triangulators.errors import Skipped, TriangulationError, Unavailable
from triangulators.geometry.predicates import ALL_LEFT, OUTSIDE, all_left
from triangulators.polygon import Boundary, checked_boundary
from triangulators.registry import Choice, load, parse
from triangulators.starting import insert_dropped_vertices, left_turning
from triangulators.verify import verify


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
    choice = parse(name)
    outline = checked_boundary(polygon)
    function = choice.entry.load()
    if not choice.entry.builtin:
        raw = function(polygon, **parameters)
    elif choice.entry.criteria:
        wanted = choice.criterion if criterion is None else criterion
        raw = function(outline, criterion=wanted, **parameters)
    elif criterion is not None:
        raise TypeError(f"triangulator {choice.entry.name!r} takes no criterion")
    else:
        raw = function(outline, **parameters)
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
    choice = parse(name)
    if choice.entry.with_gap is None:
        return triangulate(polygon, name, criterion=criterion, **parameters), None
    outline = checked_boundary(polygon)
    wanted = choice.criterion if criterion is None else criterion
    raw, gap = load(choice.entry.with_gap)(outline, criterion=wanted, **parameters)
    return _checked(outline, raw, choice, criterion), gap


def _checked(outline: Boundary, raw: Any, choice: Choice, criterion: Any) -> np.ndarray:
    """Return triangles as int32 (m, 3), wound counter-clockwise, those without area left out.

    Raises `TriangulationError` for anything else, and if a user's criterion is no number for a
    triangle.
    """
    triangles = np.asarray(raw)
    if triangles.ndim != 2 or triangles.shape[1] != 3:
        raise TriangulationError(
            f"{choice.full_name} returned shape {triangles.shape}, expected (m, 3)"
        )
    if triangles.size and triangles.dtype.kind not in "iu":
        raise TriangulationError(
            f"{choice.full_name} returned {triangles.dtype}, expected integer indices"
        )
    if triangles.dtype != np.int32 or not triangles.flags.c_contiguous:
        wide = triangles
        triangles = np.ascontiguousarray(triangles, dtype=np.int32)
        if wide.dtype.itemsize > 4 and not np.array_equal(wide, triangles):
            raise _outside(outline, choice)
    state = all_left(outline.points, triangles)
    if state == OUTSIDE:
        raise _outside(outline, choice)
    if state != ALL_LEFT:
        triangles = left_turning(outline.points, triangles)
    if criterion is not None and not isinstance(criterion, str):
        require_number(criteria.find(criterion), outline.points, triangles)
    return triangles


def _outside(outline: Boundary, choice: Choice) -> TriangulationError:
    return TriangulationError(
        f"{choice.full_name} returned indices outside 0..{len(outline.points) - 1}"
    )


def warm_up(names: Sequence[str]) -> float:
    """Call each of some triangulators once on small polygons; return the seconds it took.

    The first time on a machine that is the time to compile them, later next to nothing.

        >>> warm_up(["fan"]) > 0.0
        True
    """
    holes = [[(2, 2), (2, 4), (4, 4)], [(6, 6), (6, 8), (8, 8)]]
    square = [(0, 0), (9, 0), (9, 9), (0, 9)]
    # On no grid, so that it takes the way that doubles take.
    bent = shapely.Polygon([(0.1, 0), (5, 1.3), (9, 0), (8, 9), (4.7, 7), (0, 9)])
    polygons = [shapely.Polygon(square), shapely.Polygon(square, holes), bent]
    start = time.perf_counter()
    for name in names:
        for polygon in polygons:
            try:
                verify(polygon, triangulate(polygon, name))
            except (Skipped, Unavailable):
                continue
    return time.perf_counter() - start
