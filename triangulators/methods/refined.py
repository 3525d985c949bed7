"""Ear clipping, then flips: each diagonal whose flip makes a criterion less is flipped.

Two triangles that share an edge are a quadrilateral. If it is strictly convex it has another
diagonal, and taking that one is a flip. Flips are made until none gains. For the half-perimeter
the test is whether the other diagonal is shorter in the L1 metric, because 2 H is the L1 length of
the boundary plus twice that of the diagonals.

What flips end in depends on where they begin. Ear clipping is one start; flips by the in-circle
test lead from there to the constrained Delaunay triangulation, which is another. From both the
criterion's flips follow, and the better result is kept: it is never worse than ear clipping.

Source: C. L. Lawson, "Software for C1 surface interpolation", 1977, with the in-circle test.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from triangulators import criteria
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost, cost_of, plain_cost, total_cost
from triangulators.geometry.flips import by_delaunay
from triangulators.geometry.half_edges import is_triangulation, link
from triangulators.geometry.order import walk_along
from triangulators.libraries import ear_clipping
from triangulators.methods.flips import L1, each, flip_by, test_of
from triangulators.optimum.many_rings import Batch
from triangulators.polygon import Boundary, boundary_area
from triangulators.starting.starts import starts


@njit(nogil=True)
def _l1_of(points: np.ndarray, corner: np.ndarray) -> float:
    """Return the L1 length of all triangles' edges."""
    total = 0.0
    for e in range(len(corner)):
        a, b = corner[e], corner[e + 1 if e % 3 < 2 else e - 2]
        total += abs(points[a, 0] - points[b, 0]) + abs(points[a, 1] - points[b, 1])
    return total


@njit(nogil=True)
def refine(
    points: np.ndarray,
    corner: np.ndarray,
    twin: np.ndarray,
    test: int,
    cost: Cost,
) -> np.ndarray:
    """Return what flips make of triangles, (m, 3), in the order of `order.walk`.

    corner, twin: (3 m,) half-edges, see `geometry.half_edges`; both are overwritten.
    """
    other, beside = corner.copy(), twin.copy()
    by_circles = by_delaunay(points, other, beside) > 0
    flip_by(points, corner, twin, test, cost)
    rows, others = corner.reshape(-1, 3), other.reshape(-1, 3)
    if by_circles:
        flip_by(points, other, beside, test, cost)
        if test == L1:
            by_circles = _l1_of(points, other) < _l1_of(points, corner)
        else:
            one = total_cost(points, rows, cost)
            by_circles = total_cost(points, others, cost) < one
    if by_circles:
        return walk_along(others, beside, len(points))
    return walk_along(rows, twin, len(points))


@njit(nogil=True, inline="always")
def _refined(
    points: np.ndarray,
    ends: np.ndarray,
    corner: np.ndarray,
    twin: np.ndarray,
    test: int,
    cost: Cost,
) -> np.ndarray:
    if is_triangulation(points, ends, corner, twin):
        return refine(points, corner, twin, test, cost)
    return corner.reshape(-1, 3)[:0]


@njit(nogil=True)
def refine_many(
    first: int,
    last: int,
    batch: Batch,
    raw: tuple[np.ndarray, np.ndarray],
    test: int,
    cost: Cost,
) -> None:
    """Do `refine` for each of many polygons, see `flips.each`."""
    each(first, last, batch, raw, test, cost, _refined)


def triangulate(
    outline: Boundary,
    *,
    criterion: criteria.Criterion | str | Callable[..., float] = "half-perimeter",
    **parameters: Any,
) -> np.ndarray:
    """Return a triangulation (m, 3) that no flip improves, never worse than ear clipping.

    parameters: the criterion's (see `criteria.find`). Its time grows with the number of vertices as
    ear clipping's does.
    """
    found = criteria.find(criterion, **parameters)
    cost = plain_cost(found) or cost_of(found, boundary_area(outline), outline.expected_triangles)
    points, ends = outline.points, outline.ends.astype(np.int64)
    start = np.array(ear_clipping.triangulate(outline), dtype=np.int32).reshape(-1)
    twin = link(start)
    if not is_triangulation(points, ends, start, twin):
        start = np.array(starts(outline)[0], dtype=np.int32).reshape(-1)
        twin = link(start)
    test = test_of(cost)
    return refine(points, start, twin, test, cost)
