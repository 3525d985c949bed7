"""The optimum of a criterion over all triangulations of a polygon.

Without holes a dynamic program is exact, up to `limit` vertices. For few holes and vertices all
ways to cut the holes open are tried (`cut_holes`, `bridges`). Otherwise `certificate.proof`
improves the better of the ear-clipping and the Delaunay triangulation, and proves optimality if
possible. Beyond `limit` vertices, pieces of that triangulation are optimised.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from triangulators import criteria
from triangulators.checking.evidence import MAX_EXACT_INTEGER, find_exact_scale
from triangulators.criteria.cost import Cost, compute_total_cost, make_cost, replace_fields
from triangulators.criteria.criterion import CriterionLike
from triangulators.errors import SkippedError
from triangulators.geometry.order import put_in_walk_order
from triangulators.geometry.predicates import find_bounding_box, find_grid_unit
from triangulators.initial import find_any_triangulation, find_best_initial, find_ring_triangulation
from triangulators.optimum.any_cost import INFEASIBLE_COST
from triangulators.optimum.best_way import (
    find_optimum,
    find_optimum_of_small_polygon,
    optimise_along_random_trees,
    sweep_pieces,
)
from triangulators.polygon import Boundary, boundary_area

LIMIT = 2000  # number of vertices up to which a polygon is optimised in one piece
MAX_PLACED_VERTICES = 500  # for criteria that depend on the position on the pixel grid

# For a linear program, if the skeleton does not connect all rings: larger ones can take minutes.
MAX_PROGRAM_VERTICES = 500
MAX_BRIDGED_HOLES = 2  # for `bridges` over all edges, without excluding any first
MAX_TRIPLES = 1_500_000  # mutually visible vertices, for `bridges` over all edges


def triangulate(outline: Boundary, **parameters: Any) -> np.ndarray:
    """Return the triangulation (m, 3) of minimum cost; see `_find_optimum_in_walk_order`."""
    return _find_optimum_in_walk_order(outline, 1.0, **parameters).triangles


def triangulate_worst(outline: Boundary, **parameters: Any) -> np.ndarray:
    """Return the triangulation (m, 3) that maximises `criterion`; see `triangulate`."""
    return _find_optimum_in_walk_order(outline, -1.0, **parameters).triangles


def triangulate_with_gap(outline: Boundary, **parameters: Any) -> tuple[np.ndarray, float]:
    """Return the result of `triangulate` and its gap: 0 if proven optimal, infinite if unknown."""
    result = _find_optimum_in_walk_order(outline, 1.0, **parameters)
    if result.exact_for is None:
        return result.triangles, result.gap
    return result.triangles, _bound_rounding_gap(outline, result.exact_for, result.triangles)


def _bound_rounding_gap(
    outline: Boundary, criterion: criteria.Criterion, triangles: np.ndarray
) -> float:
    """Return a bound of the gap of a dynamic program's result (m, 3) that rounding may cause.

    For costs >= 0, it is 0 if the optimum's partial sums are exact: larger sums are never chosen.
    Otherwise each sum has a relative error of 2^-53 for each number added, and 3 times that in it.
    """
    points, count = outline.points, outline.expected_triangles
    cost = make_cost(criterion, boundary_area(outline), count)
    _, _, width, height = find_bounding_box(points)
    unit, weights = find_grid_unit(points), float(np.abs(cost["weights"]).sum())
    steps = max(width, height) / unit if unit > 0.0 else math.inf
    # Fast path: a simple bound shows that sums are exact.
    if weights * max(2.0, steps) * steps * count < MAX_EXACT_INTEGER:
        return 0.0
    scale, is_integer, max_units = find_exact_scale(points, cost)
    if (scale == 0.0 and not is_integer) or (scale > 0.0 and max_units * count < MAX_EXACT_INTEGER):
        return 0.0
    if cost["box"].min() < 0.0:
        return math.inf
    total = compute_total_cost(
        points, triangles, replace_fields(cost, weights=np.abs(cost["weights"]))
    )
    # A diagonal counts for both its triangles.
    if scale > 0.0 and 2.0 * total * scale < MAX_EXACT_INTEGER:
        return 0.0
    size = abs(compute_total_cost(points, triangles, cost))
    return (16 * count + 32) * 2.0**-53 * total / size if size > 0.0 else math.inf


class _Result(NamedTuple):
    triangles: np.ndarray
    gap: float = math.inf  # relative to the cost; infinite if unknown
    exact_for: criteria.Criterion | None = None  # optimised by a dynamic program in doubles


def _find_optimum_in_walk_order(
    outline: Boundary,
    sign: float,
    *,
    criterion: CriterionLike = "overdraw",
    limit: int = LIMIT,
    seed: int = 0,
    **weights: Any,
) -> _Result:
    """Return the optimum, or an approximation, of a criterion with `weights`.

    sign: 1 to minimise, -1 to maximise; limit: number of vertices up to which a polygon is
    optimised as a whole, not in pieces; seed: of the random choices of the local search.
    """
    resolved = criteria.find(criterion, **weights)
    small = find_optimum_of_small_polygon(outline, resolved, sign, limit)
    if small is not None:
        return _Result(put_in_walk_order(small, len(outline.points)), 0.0, resolved)
    result = _search_optimum(outline, resolved, sign, limit, seed)
    return result._replace(triangles=put_in_walk_order(result.triangles, len(outline.points)))


def _search_optimum(
    outline: Boundary, criterion: criteria.Criterion, sign: float, limit: int, seed: int
) -> _Result:
    points = outline.points
    if criterion.depends_on_position and len(points) > MAX_PLACED_VERTICES:
        raise SkippedError(
            f"{criterion.name}: the polygon has {len(points):,} vertices"
            f" (more than {MAX_PLACED_VERTICES}); use expected-quads"
        )
    cost = make_cost(criterion, boundary_area(outline), outline.expected_triangles, sign)
    if outline.holes == 0 and len(outline.edges) <= limit:
        cycle = outline.edges[:, 0]
        start = find_ring_triangulation(outline, cycle)
        return _Result(cycle[find_optimum(points[cycle], start, cost)], 0.0, criterion)
    if len(outline.edges) > limit:
        start = find_best_initial(outline, cost)
        return _Result(sweep_pieces(points, start, cost, limit, seed))
    optimal = _find_optimum_with_few_holes(outline, cost)
    if optimal is not None:
        return _Result(optimal, 0.0, criterion)
    if sign > 0.0:
        # No time limit, or no linear program (0 s): with a limit, results would depend on speed.
        # To maximise, local minimality excludes almost no edge.
        seconds = math.inf if len(points) <= MAX_PROGRAM_VERTICES else 0.0
        # Imported here, because most polygons have no holes and need no proof.
        from triangulators.certificate.proof import minimise_cost

        result = minimise_cost(outline, cost, seconds)
        if result is not None:
            return _Result(*result)
    start = find_best_initial(outline, cost)
    return _Result(optimise_along_random_trees(points, start, cost, seed))


def _find_optimum_with_few_holes(outline: Boundary, cost: Cost) -> np.ndarray | None:
    # Imported here, because only polygons with holes need these modules.
    from triangulators.certificate.bridges import solve_by_bridges
    from triangulators.certificate.candidates import find_candidates, weigh_candidates

    if cost["is_box"] or outline.holes > MAX_BRIDGED_HOLES or not outline.has_plain_rings:
        return None
    triangles = find_any_triangulation(outline)
    candidates = find_candidates(outline, triangles, MAX_TRIPLES)
    if candidates is None:
        return None
    weights = weigh_candidates(candidates.points, candidates.triangles, cost)
    alive = np.ones(len(weights), dtype=np.bool_)
    selection = solve_by_bridges(candidates, outline.ring_offsets, alive, weights, INFEASIBLE_COST)
    return candidates.triangles[selection] if len(selection) else None
