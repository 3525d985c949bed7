"""The optimum of a criterion over all triangulations of a polygon.

Without holes it is exact, up to a number of vertices that the caller may set; with one hole and few
vertices too. Otherwise it is the better of ear clipping and Delaunay, improved by `local_search`.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from triangulators import criteria, delaunay, ear_clipping
from triangulators.bridges import ONE_HOLE, one_hole_optimum
from triangulators.cost import Cost, cost_of, evaluate
from triangulators.errors import TriangulationError
from triangulators.exact import TABLE_ONLY, optimum
from triangulators.local_search import PIECE, search_cuts, sweep_windows
from triangulators.polygon import Boundary, boundary_area
from triangulators.predicates import on_grid, turns
from triangulators.repair import insert_dropped_vertices
from triangulators.verify import verify_boundary

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
    cost = cost_of(criterion, boundary_area(outline), outline.expected_triangles, sign)
    points = outline.points
    if outline.simple and len(points) <= min(limit, TABLE_ONLY) and on_grid(points):
        cycle = outline.edges[:, 0]
        return cycle[optimum(points[cycle], None, cost)]
    if outline.simple and len(points) <= limit:
        return _whole_ring(outline, cost)
    start = best_start(outline, cost)
    if len(points) > limit:
        return sweep_windows(points, start, cost, min(PIECE, limit), seed)
    if outline.holes == 1 and len(points) <= ONE_HOLE:
        exact = one_hole_optimum(outline, cost)
        if exact is not None:
            return exact
    return search_cuts(points, start, cost, seed)


def _whole_ring(outline: Boundary, cost: Cost) -> np.ndarray:
    """Exact optimum of one ring; any triangulation serves to find what is visible."""
    cycle = outline.edges[:, 0]
    position = np.empty(len(outline.points), dtype=np.int32)
    position[cycle] = np.arange(len(cycle), dtype=np.int32)
    points = outline.points[cycle]
    local = position[ear_clipping.triangulate(outline)]
    if len(local) != len(cycle) - 2 or not _covers(points, local):
        local = position[first_start(outline)]
    return cycle[optimum(points, local, cost)]


def _covers(points: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether n - 2 triangles of a cycle of n points all turn left and match along their edges."""
    n = len(points)
    tails = triangles.astype(np.int64).ravel()
    heads = triangles[:, [1, 2, 0]].astype(np.int64).ravel()
    inner = heads != (tails + 1) % n
    forward = np.sort((tails * n + heads)[inner])
    backward = np.sort((heads * n + tails)[inner])
    sides = len(tails) - len(forward)
    matched = sides == n and np.array_equal(forward, backward)
    return matched and bool((turns(points, triangles) > 0.0).all())


def starts(outline: Boundary) -> list[np.ndarray]:
    """Return the conforming ones of ear clipping (collinear vertices put back) and Delaunay."""
    found = []
    for method in (ear_clipping, delaunay):
        try:
            raw = np.ascontiguousarray(method.triangulate(outline), dtype=np.int32)
        except TriangulationError:
            continue
        triangles = insert_dropped_vertices(outline, left_turning(outline.points, raw))
        if verify_boundary(outline, triangles).conforming:
            found.append(outline.site[triangles])
    return found


def left_turning(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return int32 triangles wound counter-clockwise, those without area left out."""
    orientation = turns(points, triangles)
    if (orientation > 0.0).all():
        return triangles
    triangles = np.where((orientation < 0.0)[:, None], triangles[:, [0, 2, 1]], triangles)
    return np.ascontiguousarray(triangles[orientation != 0.0])


def first_start(outline: Boundary) -> np.ndarray:
    """Return one conforming triangulation; raises `TriangulationError` if none was found."""
    found = starts(outline)
    if not found:
        raise TriangulationError(
            "optimal: neither ear clipping nor Delaunay gave a valid triangulation to start from"
        )
    return found[0]


def best_start(outline: Boundary, cost: Cost) -> np.ndarray:
    """Return the better of ear clipping and Delaunay; raises `TriangulationError` if neither."""
    found = starts(outline)
    if not found:
        return first_start(outline)
    return min(found, key=lambda triangles: evaluate(outline.points, triangles, cost))
