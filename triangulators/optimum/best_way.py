"""The optimum of one polygon, by whichever table is the fastest there.

full_table     boxes and edges, without visibility: small rings, and those where most corners see
               each other
visible_lists  any cost, over the pairs of corners that see each other
cut_holes      small polygons with few holes, all ways to cut them into one ring
"""

import numpy as np

from triangulators.criteria import Criterion
from triangulators.criteria.cost import Cost, plain_cost
from triangulators.errors import TriangulationError
from triangulators.geometry.half_edges import twins_of
from triangulators.geometry.predicates import on_grid
from triangulators.geometry.visibility import visible_pairs
from triangulators.optimum.cut_holes import by_cuts
from triangulators.optimum.full_table import SMALL, by_full_table
from triangulators.optimum.visible_lists import by_lists
from triangulators.polygon import Boundary

TABLE_ONLY = 128  # corners; up to here looking for visible pairs costs more than it saves
_SPARSE_TO_DENSE = 2.0  # measured: time of one apex tried, by visible pairs against by ring
_ANY = np.array([1.0, 0.0, 0.0])  # what is quickest to optimise, where any triangulation will do


def optimum(points: np.ndarray, triangles: np.ndarray | None, cost: Cost) -> np.ndarray:
    """Return the triangulation (n - 2, 3) of least cost of a simple polygon.

    points: (n, 2), a counter-clockwise cycle, in which a point may be met several times;
    triangles: (n - 2, 3), some triangulation of it, positions in the cycle; if None, one is found
    first. Raises `TriangulationError` if there is none.

    Exact for all doubles: orientations and visibility are decided by exact predicates.
    """
    n = len(points)
    if cost["is_box"] and n <= TABLE_ONLY:
        found = _by_ring(points, cost["box"])
        if found is not None:
            return found
    if triangles is None:
        triangles = _by_ring(points, _ANY)
        if triangles is None:
            raise TriangulationError(f"no triangulation of {n} corners found")
    start, target = visible_pairs(points, triangles, twins_of(triangles), n * n)
    if cost["is_box"]:
        seen_from_above = np.bincount(target, minlength=n)
        tried = float(np.dot(seen_from_above, seen_from_above)) / 2.0
        everything = len(target) == n * (n - 1) // 2
        if tried * _SPARSE_TO_DENSE > n**3 / 6.0 and (everything or on_grid(points)):
            found = _by_ring(points, cost["box"])
            if found is not None:
                return found
    found = by_lists(points, start, target, cost)
    if len(found) != n - 2:
        raise TriangulationError(f"no triangulation of {n} corners found")
    return found


def quick_optimum(
    outline: Boundary, criterion: Criterion, sign: float, limit: int
) -> np.ndarray | None:
    """Return the optimum (m, 3) of a small polygon, in `order.walk`'s order, or None.

    None where it is not small, has more vertices than `limit` or rings that touch, or where the
    criterion is not made of boxes and edges alone: then `optimum` and what is around it do it.
    """
    points = outline.points
    if len(points) > min(limit, SMALL) or not (outline.simple or outline.holes):
        return None
    cost = plain_cost(criterion, sign)
    if cost is None or not cost["is_box"]:
        return None
    triangles = np.empty((len(points) + 2 * outline.holes - 2, 3), dtype=np.int32)
    if outline.holes:
        found = by_cuts(points, outline.ends.astype(np.int64), cost["box"], triangles)
    else:
        found = by_full_table(points, cost["box"], triangles) < np.inf
    return triangles if found else None


def _by_ring(points: np.ndarray, box: np.ndarray) -> np.ndarray | None:
    triangles = np.empty((len(points) - 2, 3), dtype=np.int32)
    return triangles if by_full_table(points, box, triangles) < np.inf else None
