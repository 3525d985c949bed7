"""Triangulation of one polygon by a triangulator's name, with a check of the result."""

from typing import Any

import numpy as np
import shapely

from triangulators import criteria
from triangulators.criteria.cost import require_finite_total
from triangulators.criteria.criterion import CriterionLike
from triangulators.errors import TriangulationError
from triangulators.geometry.order import put_in_walk_order
from triangulators.polygon import Boundary, checked_boundary
from triangulators.registry import Choice, check_criterion, load, parse
from triangulators.verify import check_triangle_indices, insert_dropped_vertices, orient_triangles


def triangulate(
    polygon: shapely.Polygon,
    name: str,
    *,
    criterion: CriterionLike | None = None,
    repair: bool = False,
    order: str | None = None,
    **parameters: Any,
) -> np.ndarray:
    """Triangulate a polygon; no vertex is added.

    Parameters
    ----------
    polygon
        A valid polygon; holes are allowed.
    name
        A triangulator (see `names`), optionally with a criterion: "optimal:half-perimeter".
        "optimal" alone means "optimal:overdraw", the criterion of the paper.
    criterion
        The criterion, if the name contains none: a name, a `Criterion`, or a Numba function of
        three points (six numbers).
    repair
        Insert collinear vertices that a library dropped, which removes T-junctions.
    order
        "walk" puts the triangles in an order from neighbour to neighbour, in which a GPU transforms
        few vertices twice; "native" leaves the triangulator's order. The default is a walk for
        "flips" and "earcut-refine", otherwise native; the native order of "optimal", "worst" and
        "refined" is a walk as well.
    **parameters
        Passed to the triangulator, for example `seed` of "random", or the weights `alpha`, `beta`
        and `gamma` of the criterion "mixed".

    Returns
    -------
    ndarray
        (m, 3) int32 indices into `vertices(polygon)`; counter-clockwise with y up.

    Raises
    ------
    InvalidPolygonError
        If the polygon is invalid or empty.
    SkippedError
        If the triangulator does not support this polygon, by design.
    UnavailableError
        If an optional package is missing.
    UnknownNameError
        If there is no such triangulator, criterion or order.
    ArgumentError
        If the criterion or the weights are given twice or are invalid.
    TriangulationError
        If the triangulator failed; the base of the errors above.

    Notes
    -----
    Neither a signal nor another thread interrupts a call while C++ runs, and some steps take time
    quadratic in the size of the polygon. On one core, "ear-clipping" takes about 20 s for 10,000
    holes or 100,000 vertices, and 100 times as long for ten times as many; "delaunay" about 13 s
    for 10,000 holes; the test of validity up to 40 s for 100,000 vertices. To enforce
    a time limit, call `triangulate` in a separate process.

    Examples
    --------
    >>> triangulate(shapely.Polygon([(0, 0), (2, 0), (0, 1)]), "fan").tolist()
    [[0, 1, 2]]
    """
    outline, choice, raw = _run_triangulator(polygon, name, criterion, parameters)
    triangles = _check_triangles(outline, raw, choice, criterion)
    if repair:
        triangles = insert_dropped_vertices(outline, triangles)
    return _order_triangles(outline, triangles, choice, order)


def triangulate_with_gap(
    polygon: shapely.Polygon,
    name: str,
    *,
    criterion: CriterionLike | None = None,
    **parameters: Any,
) -> tuple[np.ndarray, float | None]:
    """Triangulate a polygon; return the triangles and an upper bound of their gap to the optimum.

    Parameters
    ----------
    polygon, name, criterion, **parameters
        As for `triangulate`.

    Returns
    -------
    triangles : ndarray
        (m, 3) int32, as `triangulate` returns.
    gap : float or None
        Upper bound of (cost - optimum) / cost, by the criterion: 0 if the result is proven optimal,
        infinite if no lower bound of the optimum is known. None for triangulators that do not
        search for the optimum.

    Raises
    ------
    TriangulationError
        As `triangulate`.

    Examples
    --------
    >>> triangulate_with_gap(shapely.box(0, 0, 2, 1), "optimal:half-perimeter")[1]
    0.0
    """
    outline, choice, raw = _run_triangulator(polygon, name, criterion, parameters, with_gap=True)
    raw, gap = raw if choice.entry.with_gap else (raw, None)
    triangles = _check_triangles(outline, raw, choice, criterion)
    return _order_triangles(outline, triangles, choice, None), gap


def _order_triangles(
    outline: Boundary, triangles: np.ndarray, choice: Choice, order: str | None
) -> np.ndarray:
    if not choice.entry.uses_walk(order):
        return triangles
    return np.asarray(put_in_walk_order(np.ascontiguousarray(triangles), len(outline.points)))


def _run_triangulator(
    polygon: shapely.Polygon,
    name: str,
    criterion: CriterionLike | None,
    parameters: dict[str, Any],
    *,
    with_gap: bool = False,
) -> tuple[Boundary, Choice, Any]:
    """Return boundary, parsed name and unchecked triangles, or (triangles, gap) if supported."""
    choice = parse(name)
    entry = choice.entry
    check_criterion(name, criterion)
    outline = checked_boundary(polygon)
    if entry.builtin and entry.criteria and criterion is None:
        criterion = choice.criterion
    if criterion is not None:
        parameters["criterion"] = criterion
    function = load(entry.with_gap) if with_gap and entry.with_gap else entry.load()
    return outline, choice, function(outline if entry.builtin else polygon, **parameters)


def _check_triangles(outline: Boundary, raw: Any, choice: Choice, criterion: Any) -> np.ndarray:
    try:
        triangles = orient_triangles(outline.points, check_triangle_indices(raw, outline.points))
    except ValueError as error:
        raise TriangulationError(f"{choice.full_name}: {error}") from error
    if criterion is not None and not isinstance(criterion, str):
        require_finite_total(criteria.find(criterion), outline.points, triangles)
    return triangles
