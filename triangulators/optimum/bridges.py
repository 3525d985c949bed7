"""The true optimum of a polygon with one hole, by trying every bridge from one of its vertices.

At the hole's leftmost vertex the polygon's angle opens to the left by more than 180 degrees, so
every triangulation has a diagonal there to a vertex further left, which lies on the exterior.
Cutting along each such bridge in turn leaves simple polygons, one of which holds the optimum.
"""

import numpy as np

from triangulators.criteria.cost import Cost, evaluate
from triangulators.errors import TriangulationError
from triangulators.geometry.predicates import crossed
from triangulators.optimum.simple_polygon import optimum
from triangulators.polygon import Boundary

ONE_HOLE = 64  # vertices up to which every bridge is tried


def one_hole_optimum(outline: Boundary, cost: Cost) -> np.ndarray | None:
    """Return the optimal triangulation (m, 3) of a polygon with one hole, or None if none fits.

    Rings that touch are left to the local search: None.
    """
    exterior = outline.edges[outline.edges[:, 0] < outline.ends[0], 0]
    hole = outline.edges[outline.edges[:, 0] >= outline.ends[0], 0]
    if len(exterior) + len(hole) != len(np.unique(outline.edges)) or len(hole) < 3:
        return None
    points = outline.points
    leftmost = int(np.lexsort((points[hole, 1], points[hole, 0]))[0])
    around = np.roll(hole, -leftmost)
    best, least = None, np.inf
    for place in np.flatnonzero(points[exterior, 0] < points[around[0], 0]).tolist():
        if crossed(points, outline.edges, int(exterior[place]), int(around[0])).any():
            continue
        outer = np.roll(exterior, -place)
        cycle = np.concatenate((outer, outer[:1], around, around[:1]))
        try:
            triangles = cycle[optimum(points[cycle], None, cost)]
        except TriangulationError:
            continue
        total = evaluate(points, triangles, cost)
        if total < least:
            best, least = triangles, total
    return best
