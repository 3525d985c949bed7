"""The optimum of a criterion over all triangulations of a polygon.

Without holes it is exact, up to a number of vertices that the caller may set, by a table over all
sub-polygons. With few holes and corners all ways to cut them open are tried (`cut_holes`); else
`proof` begins with the better of ear clipping and Delaunay, improves it and says whether it could
be proven. Beyond the number of vertices, windows of that beginning are optimised.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from triangulators import criteria
from triangulators.checking.units import EXACT, whole_scale
from triangulators.criteria.cost import cost_of, total_cost, with_fields
from triangulators.errors import SkippedError
from triangulators.geometry.order import walk
from triangulators.geometry.predicates import box_of, grid_unit
from triangulators.initial import best_initial, ring_triangulation
from triangulators.optimum.best_way import (
    PIECE,
    optimum,
    quick_optimum,
    search_cuts,
    sweep_windows,
)
from triangulators.polygon import Boundary, boundary_area

LIMIT = 2000  # vertices up to which the whole polygon is optimised at once
MOST_PLACED = 500
"""Vertices up to which a criterion that is counted pixel by pixel is optimised."""

PROVEN = 500
"""Vertices up to which the linear program is asked where a polygon's rings stay apart.

With more it can take minutes: `certify` asks it for those who want a proof. What is
worst is never proven: local minimality excludes next to nothing there.
"""


class SearchOptions(NamedTuple):
    """Parameters of `optimal` and `worst` other than the criterion and its parameters.

    limit : vertices up to which a polygon is optimised in one piece, at a time that grows with
        their cube at worst; of larger ones windows of a triangulation are
    seed : choices of the local search
    """

    limit: int = LIMIT
    seed: int = 0

    @classmethod
    def split(cls, parameters: Mapping[str, Any]) -> tuple["SearchOptions", dict[str, Any]]:
        """Return the search options among parameters, and the parameters of the criterion."""
        own = {name: parameters[name] for name in cls._fields if name in parameters}
        return cls(**own), {name: parameters[name] for name in parameters if name not in own}


def triangulate(outline: Boundary, **parameters: Any) -> np.ndarray:
    """Return the triangulation (m, 3) that minimises `criterion`.

    parameters: `criterion` as `criteria.find` takes it, "overdraw" by default; `SearchOptions`; all
    others are the criterion's.
    """
    return _optimise(outline, 1.0, **parameters).triangles


def triangulate_worst(outline: Boundary, **parameters: Any) -> np.ndarray:
    """Return the triangulation (m, 3) that maximises `criterion`; see `triangulate`."""
    return _optimise(outline, -1.0, **parameters).triangles


def triangulate_with_gap(outline: Boundary, **parameters: Any) -> tuple[np.ndarray, float]:
    """Return what `triangulate` does, and how far it may be from the optimum, relative to its cost.

    0 where it is the optimum: by a table, or by a proof as `certify` makes one, which `checker` has
    not looked at; of costs that are real numbers, up to rounding. Next to nothing where whole costs
    add up to more than doubles hold, and infinite where there is no bound: what windows or the
    local search gave.
    """
    found = _optimise(outline, 1.0, **parameters)
    if found.by_table is None:
        return found.triangles, found.gap
    return found.triangles, _rounding(outline, found.by_table, found.triangles)


def _rounding(outline: Boundary, criterion: criteria.Criterion, triangles: np.ndarray) -> float:
    """Return how far from the optimum rounding may have led a table, relative to the cost.

    triangles (m, 3): what it gave. Of costs that are not negative no sum matters that is above the
    optimum's, so it is enough that this one is exact. Otherwise all of them are off by a part of
    2^-53 for each number that was added, and the three that it was made of.
    """
    points, count = outline.points, outline.expected_triangles
    cost = cost_of(criterion, boundary_area(outline), count)
    _, _, width, height = box_of(points)
    unit, weights = grid_unit(points), float(np.abs(cost["weights"]).sum())
    steps = max(width, height) / unit if unit > 0.0 else math.inf
    if weights * max(2.0, steps) * steps * count < EXACT:  # quickly said
        return 0.0
    scale, whole, most = whole_scale(points, cost)
    if (scale == 0.0 and not whole) or (scale > 0.0 and most * count < EXACT):
        return 0.0
    if cost["box"].min() < 0.0:
        return math.inf
    total = total_cost(points, triangles, with_fields(cost, weights=np.abs(cost["weights"])))
    if scale > 0.0 and 2.0 * total * scale < EXACT:  # a diagonal counts for both its triangles
        return 0.0
    least = abs(total_cost(points, triangles, cost))
    return (16 * count + 32) * 2.0**-53 * total / least if least > 0.0 else math.inf


class _Found(NamedTuple):
    """A triangulation (m, 3) and how far it may be from the optimum, infinite where unknown.

    by_table: the criterion, where a table of it says so by sums of doubles.
    """

    triangles: np.ndarray
    gap: float
    by_table: criteria.Criterion | None = None


def _optimise(
    outline: Boundary,
    sign: float,
    *,
    criterion: criteria.Criterion | str | Callable[..., float] = "overdraw",
    **parameters: Any,
) -> _Found:
    """Do `triangulate`; sign: 1 to minimise, -1 to maximise."""
    options, weights = SearchOptions.split(parameters)
    wanted = criteria.find(criterion, **weights)
    small = quick_optimum(outline, wanted, sign, options.limit)
    if small is not None:
        return _Found(walk(small, len(outline.points)), 0.0, wanted)
    found = _search(outline, wanted, sign, options)
    return found._replace(triangles=walk(found.triangles, len(outline.points)))


def _search(
    outline: Boundary, criterion: criteria.Criterion, sign: float, options: SearchOptions
) -> _Found:
    points, (limit, seed) = outline.points, options
    if criterion.placed and len(points) > MOST_PLACED:
        raise SkippedError(
            f"{criterion.name} of {len(points):,} vertices: up to {MOST_PLACED} are done, because"
            " every triangle's rows of pixels are looked at"
        )
    cost = cost_of(criterion, boundary_area(outline), outline.expected_triangles, sign)
    if outline.holes == 0 and len(outline.edges) <= limit:
        cycle = outline.edges[:, 0]
        start = ring_triangulation(outline, cycle)
        return _Found(cycle[optimum(points[cycle], start, cost)], 0.0, criterion)
    if len(outline.edges) > limit:
        start = best_initial(outline, cost)
        return _Found(sweep_windows(points, start, cost, min(PIECE, limit), seed), math.inf)
    proof = None
    if sign > 0.0:
        # Never a time between the two: the result is the same on any machine.
        seconds = math.inf if len(points) <= PROVEN else 0.0
        from triangulators.certificate.proof import prove  # most polygons have no holes

        proof = prove(outline, best_initial(outline, cost), cost, seconds)
    if proof is None:
        return _Found(search_cuts(points, best_initial(outline, cost), cost, seed), math.inf)
    return _Found(proof.triangles, proof.gap)
