"""The optimum of a criterion over all triangulations of a polygon.

Without holes it is exact, up to a number of vertices that the caller may set; with one hole and few
vertices too. Otherwise it is the better of ear clipping and Delaunay, improved by `local_search`.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from triangulators import criteria
from triangulators.bridges import ONE_HOLE, one_hole_optimum
from triangulators.cost import cost_of
from triangulators.exact import TABLE_ONLY, optimum, small_optimum
from triangulators.local_search import PIECE, search_cuts, sweep_windows
from triangulators.order import walk
from triangulators.polygon import Boundary, boundary_area
from triangulators.predicates import on_grid
from triangulators.starts import best_start, ring_triangulation

LIMIT = 2000  # vertices up to which the whole polygon is optimised at once


def triangulate(
    outline: Boundary,
    *,
    criterion: criteria.Criterion | str | Callable[..., float] = "overdraw",
    limit: int = LIMIT,
    seed: int = 0,
    **parameters: Any,
) -> np.ndarray:
    """Return the triangulation (m, 3) that minimises `criterion`.

    limit: vertices up to which a polygon is optimised as a whole, at a time that grows with their
    cube at worst; beyond it windows of a triangulation are. seed: choices of the local search.
    parameters: the criterion's (see `criteria.find`).
    """
    return _optimise(outline, criteria.find(criterion, **parameters), 1.0, limit, seed)


def triangulate_worst(
    outline: Boundary,
    *,
    criterion: criteria.Criterion | str | Callable[..., float] = "overdraw",
    limit: int = LIMIT,
    seed: int = 0,
    **parameters: Any,
) -> np.ndarray:
    """Return the triangulation (m, 3) that maximises `criterion`; see `triangulate`."""
    return _optimise(outline, criteria.find(criterion, **parameters), -1.0, limit, seed)


def _optimise(
    outline: Boundary, criterion: criteria.Criterion, sign: float, limit: int, seed: int
) -> np.ndarray:
    small = small_optimum(outline, criterion, sign, limit)
    if small is not None:
        return small
    found = _search(outline, criterion, sign, limit, seed)
    return walk(found, len(outline.points))


def _search(
    outline: Boundary, criterion: criteria.Criterion, sign: float, limit: int, seed: int
) -> np.ndarray:
    cost = cost_of(criterion, boundary_area(outline), outline.expected_triangles, sign)
    points = outline.points
    if outline.holes == 0 and len(outline.edges) <= limit:
        cycle = outline.edges[:, 0]
        table = cost.is_box and len(cycle) <= TABLE_ONLY and on_grid(points)
        start = None if table else ring_triangulation(outline, cycle)
        return cycle[optimum(points[cycle], start, cost)]
    start = best_start(outline, cost)
    if len(outline.edges) > limit:
        return sweep_windows(points, start, cost, min(PIECE, limit), seed)
    if outline.holes == 1 and len(points) <= ONE_HOLE:
        exact = one_hole_optimum(outline, cost)
        if exact is not None:
            return exact
    return search_cuts(points, start, cost, seed)
