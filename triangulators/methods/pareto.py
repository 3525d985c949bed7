"""The Pareto front of two criteria: `optimum.visible_lists` with sets of non-dominated costs."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import shapely

from triangulators import criteria
from triangulators.criteria.cost import Cost, cost_at, make_cost
from triangulators.criteria.criterion import CriterionLike
from triangulators.errors import SkippedError, TriangulationError
from triangulators.initial import Cycle, make_cycle, require_few_vertices
from triangulators.polygon import Boundary, boundary_area, checked_boundary
from triangulators.polygon_arrays import polygon_of_rings

MAX_FRONT_SIZE = 100_000  # points of a sub-polygon's front; few in practice, but without a bound
MAX_VERTICES = 100  # maximum for the triangulator "pareto", which then takes up to a minute
# Costs that differ by less than this fraction of the largest cost are treated as equal.
_RELATIVE_TOLERANCE = 1e-9


class Front(NamedTuple):
    """A Pareto front: ascending costs (f, 2) by both criteria, and triangulations (f, m, 3)."""

    costs: np.ndarray
    triangles: np.ndarray


class _Partial(NamedTuple):
    """The Pareto front of a sub-polygon i..j: costs (f, 2), and their origin (f, 3)."""

    costs: np.ndarray
    origin: np.ndarray  # apex k, index of a point in the front of i..k, and in the front of k..j


def pareto_front(
    polygon: shapely.Polygon, first: CriterionLike = "overdraw", second: CriterionLike = "shape"
) -> Front:
    """Return the Pareto front of a polygon's triangulations for two criteria to minimise."""
    outline = checked_boundary(polygon)
    ring = make_cycle(outline, "pareto")
    area, count = boundary_area(outline), outline.expected_triangles
    pair = [make_cost(criteria.find(criterion), area, count) for criterion in (first, second)]
    fronts = _compute_fronts(ring, pair[0], pair[1])
    front = fronts[0, len(ring.cycle) - 1]
    triangles = np.array(
        [_list_triangles(fronts, len(ring.cycle), entry) for entry in range(len(front[0]))]
    )
    return Front(front.costs, ring.cycle[triangles])


def triangulate(outline: Boundary, *, k: int = 0) -> np.ndarray:
    """Return triangulation k (n - 2, 3) of the front of overdraw and shape, by overdraw; cached."""
    require_few_vertices(outline, "pareto", MAX_VERTICES)
    triangles = _find_front_of_overdraw_and_shape(
        polygon_of_rings(outline.points, outline.ring_offsets).wkb
    ).triangles
    if not 0 <= k < len(triangles):
        raise SkippedError(f"pareto: k={k} is out of range; give k from 0 to {len(triangles) - 1}")
    return np.array(triangles[k])


@lru_cache(maxsize=32)
def _find_front_of_overdraw_and_shape(wkb: bytes) -> Front:
    return pareto_front(shapely.from_wkb(wkb))


def _compute_fronts(ring: Cycle, first: Cost, second: Cost) -> dict[tuple[int, int], _Partial]:
    n = len(ring.cycle)
    fronts: dict[tuple[int, int], _Partial] = {}
    # below[j]: vertices i < j that j sees, descending
    below: list[list[int]] = [[] for _ in range(n)]
    for i in range(n - 1, -1, -1):
        for j in ring.target[ring.start[i] : ring.start[i + 1]].tolist():
            if j == i + 1:
                fronts[i, j] = _Partial(np.zeros((1, 2)), np.zeros((1, 3), dtype=np.int32))
            else:
                apexes = [k for k in below[j] if (i, k) in fronts]
                fronts[i, j] = _find_sub_polygon_front(
                    ring.points, fronts, i, j, apexes, (first, second)
                )
            below[j].append(i)
    return fronts


def _find_sub_polygon_front(
    points: np.ndarray,
    fronts: dict[tuple[int, int], _Partial],
    i: int,
    j: int,
    apexes: list[int],
    pair: tuple[Cost, Cost],
) -> _Partial:
    costs: list[np.ndarray] = []
    origins: list[np.ndarray] = []
    for k in apexes:
        first, second = fronts[i, k].costs, fronts[k, j].costs
        triangle_costs = np.array([cost_at(points, i, k, j, cost) for cost in pair])
        sums = (first[:, None] + second[None, :]).reshape(-1, 2) + triangle_costs
        rows = _find_non_dominated(sums)
        costs.append(sums[rows])
        origins.append(
            np.column_stack((np.full(len(rows), k), rows // len(second), rows % len(second)))
        )
    if not costs:
        return _Partial(np.empty((0, 2)), np.empty((0, 3), dtype=np.int32))
    sums, origin = np.concatenate(costs), np.concatenate(origins).astype(np.int32)
    rows = _find_non_dominated(sums)
    if len(rows) > MAX_FRONT_SIZE:
        raise TriangulationError(
            f"pareto: the Pareto front of a sub-polygon exceeds {MAX_FRONT_SIZE:,} points; "
            "use a polygon with fewer vertices, or minimise one criterion with 'optimal'"
        )
    return _Partial(sums[rows], origin[rows])


def _find_non_dominated(costs: np.ndarray) -> np.ndarray:
    """Return the indices of the non-dominated rows of costs (c, 2); one of several equal rows."""
    order = np.lexsort((costs[:, 1], costs[:, 0]))
    second = costs[order, 1]
    minima = np.minimum.accumulate(second)
    slack = _RELATIVE_TOLERANCE * max(float(np.abs(second).max(initial=0.0)), 1e-300)
    better = np.r_[True, second[1:] < minima[:-1] - slack]
    return order[better]


def _list_triangles(fronts: dict[tuple[int, int], _Partial], n: int, entry: int) -> list[Any]:
    triangles: list[tuple[int, int, int]] = []
    waiting = [(0, n - 1, entry)]
    while waiting:
        i, j, which = waiting.pop()
        if j - i < 2:
            continue
        k, first, second = fronts[i, j].origin[which].tolist()
        triangles.append((i, k, j))
        waiting += [(i, k, first), (k, j, second)]
    return triangles
