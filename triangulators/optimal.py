"""The optimum of a criterion over all triangulations of a polygon.

Exact where the polygon can be unfolded into one simple polygon without cutting, that is without
holes; see `dense` for the dynamic programme.
"""

from typing import Any

import numpy as np

from triangulators import criteria
from triangulators.delaunay import triangulate as delaunay
from triangulators.dense import box_optimum
from triangulators.errors import TriangulationError
from triangulators.polygon import Boundary, boundary_area
from triangulators.predicates import on_grid, turns
from triangulators.unfold import neighbours, spanning_tree, unfold

# Determinants of doubles that are not on a grid are off by less than this times extent squared.
_ROUNDING = 8.0 * 2.0**-53


def triangulate(outline: Boundary, *, criterion: Any = "overdraw", **parameters: Any) -> np.ndarray:
    """Return the triangulation (m, 3) that minimises `criterion`."""
    return _optimise(outline, criteria.find(criterion, **parameters), 1.0)


def triangulate_worst(
    outline: Boundary, *, criterion: Any = "overdraw", **parameters: Any
) -> np.ndarray:
    """Return the triangulation (m, 3) that maximises `criterion`."""
    return _optimise(outline, criteria.find(criterion, **parameters), -1.0)


def _optimise(outline: Boundary, criterion: criteria.Criterion, sign: float) -> np.ndarray:
    weights = sign * criterion.weights_for(boundary_area(outline), outline.expected_triangles)
    if outline.simple:
        cycle = outline.edges[:, 0]
    else:
        start = delaunay(outline)
        turned = turns(outline.points, start.astype(np.int32)) < 0.0
        start = np.where(turned[:, None], start[:, [0, 2, 1]], start).astype(np.int32)
        across = neighbours(start, len(outline.points))
        tree, size = spanning_tree(across, 0, np.zeros(len(start), dtype=np.int32))
        cycle = unfold(start, across, tree, 0, size)[0]
    points = outline.points[cycle]
    flat = 0.0 if on_grid(points) else _ROUNDING * float(np.ptp(points, axis=0).max()) ** 2
    best = box_optimum(points - points[0], weights[2:5], flat)
    if best is None:
        raise TriangulationError("optimal: no triangulation found")
    return cycle[best]
