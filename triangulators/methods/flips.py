"""Flips of anybody's triangles, and the triangulators that are ear clipping with flips after it.

Two triangles that share an edge are a quadrilateral. If it is strictly convex it has another
diagonal, and taking that one is a flip. Flips are made until none gains. For the half-perimeter
the test is whether the other diagonal is shorter in the L1 metric, because 2 H is the L1 length of
the boundary plus twice that of the diagonals.

Source: C. L. Lawson, "Software for C1 surface interpolation", 1977, with the in-circle test.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from triangulators import criteria
from triangulators.batch import Batch, rings_at
from triangulators.compute.kernels import njit
from triangulators.compute.operations import copy_rows
from triangulators.criteria import FLIP_TESTS
from triangulators.criteria.cost import Cost, cost_at, cost_of, plain_cost, total_cost
from triangulators.errors import UnknownNameError
from triangulators.geometry.flips import (
    as_earcut,
    by_delaunay,
    by_euclidean,
    by_l1,
    convex,
    run,
)
from triangulators.geometry.half_edges import is_triangulation, link
from triangulators.geometry.order import walk_along
from triangulators.initial import initial_triangulations
from triangulators.libraries import ear_clipping
from triangulators.polygon import Boundary, boundary_area
from triangulators.verify import rows_of

L1, EUCLIDEAN, DELAUNAY, AS_EARCUT, COST, NONE = range(6)  # the first as in FLIP_TESTS

_SLACK = 1e-12  # of what is compared: a gain below it may be rounding, and flips would not end
NO_COST = cost_of(criteria.find("half-perimeter"), 1.0, 1)


@njit(nogil=True)
def cheaper(points: np.ndarray, a: int, b: int, c: int, d: int, cost: Cost) -> bool:
    """Whether a cost is less with the diagonal a-d than with b-c, for more than rounding."""
    old = cost_at(points, a, b, c, cost) + cost_at(points, d, c, b, cost)
    new = cost_at(points, a, b, d, cost) + cost_at(points, a, d, c, cost)
    return new < old - _SLACK * (abs(old) + abs(new))


@njit(nogil=True)
def flip_by(points: np.ndarray, corner: np.ndarray, twin: np.ndarray, test: int, cost: Cost) -> int:
    """Flip in place until no flip gains; return how many were made. See `geometry.flips.run`."""
    if test == L1:
        return by_l1(points, corner, twin)
    if test == EUCLIDEAN:
        return by_euclidean(points, corner, twin)
    if test == DELAUNAY:
        return by_delaunay(points, corner, twin)
    if test == AS_EARCUT:
        return as_earcut(points, corner, twin)
    if test == COST:
        return run(points, corner, twin, cheaper, convex, cost)
    return 0


@njit(nogil=True)
def refine(
    points: np.ndarray, corner: np.ndarray, twin: np.ndarray, test: int, cost: Cost
) -> np.ndarray:
    """Return the better of what flips end in from two starts, (m, 3), in the order of `order.walk`.

    What flips end in depends on where they begin. The triangles given are one start; flips by the
    in-circle test lead from there to the constrained Delaunay triangulation, which is another. From
    both the cost's flips follow, and the better result is kept: it is never worse than the given.
    corner, twin: (3 m,) half-edges, see `geometry.half_edges`; both are overwritten.
    """
    other, beside = corner.copy(), twin.copy()
    by_circles = by_delaunay(points, other, beside) > 0
    flip_by(points, corner, twin, test, cost)
    rows, others = corner.reshape(-1, 3), other.reshape(-1, 3)
    if by_circles:
        flip_by(points, other, beside, test, cost)
        by_circles = total_cost(points, others, cost) < total_cost(points, rows, cost)
    if by_circles:
        return walk_along(others, beside, len(points))
    return walk_along(rows, twin, len(points))


@njit(nogil=True)
def improve_many(
    first: int,
    last: int,
    batch: Batch,
    raw: tuple[np.ndarray, np.ndarray],
    test: int,
    cost: Cost,
    two_starts: bool,
) -> None:
    """Improve the triangles of the polygons first..last - 1; mark in `done` those that conform.

    raw: triangles (m, 3), which are overwritten, and bounds: those of polygon i are from
    bounds[i - first] to bounds[i - first + 1]. two_starts: whether to `refine` them; otherwise they
    are flipped alone.
    """
    given, bounds = raw
    coords, ring_offsets, geom_offsets, _vertex_offsets, offsets, triangles, done = batch
    for index in range(first, last):
        points, rings = rings_at(index, coords, ring_offsets, geom_offsets)
        own = given[bounds[index - first] : bounds[index - first + 1]]
        room = triangles[offsets[index] : offsets[index + 1]]
        if len(own) == 0 or len(own) != len(room):
            continue
        corner = own.reshape(-1)
        twin = link(corner)
        if not two_starts:
            flip_by(points, corner, twin, test, cost)
        if is_triangulation(points, rings, corner, twin):
            copy_rows(refine(points, corner, twin, test, cost) if two_starts else own, room)
            done[index] = True


def test_of(cost: Cost) -> int:
    """Return the test by which flips lessen a cost."""
    by_l1, by_area, by_l2 = cost["box"].tolist()
    if cost["is_box"] and by_area == 0.0:
        if by_l1 > 0.0 and by_l2 == 0.0:
            return L1
        if by_l2 > 0.0 and by_l1 == 0.0:
            return EUCLIDEAN
    return COST


def flip(
    points: np.ndarray,
    triangles: np.ndarray,
    by: criteria.Criterion | str | Callable[..., float] = "l1",
    **parameters: Any,
) -> np.ndarray:
    """Flip the diagonals of anybody's triangles while a flip gains; return (m, 3) int32.

    points: (n, 2), float64 or whole numbers up to 2^53; triangles: (m, 3) or flat indices, all
    wound alike. A diagonal is an edge of two triangles; no other edge changes, no vertex is added.
    by: "l1" flips to diagonals with less |dx| + |dy|, which is what a GPU's quads follow;
    "euclidean" to shorter ones; "delaunay" until no corner is inside a neighbour's circle; a
    criterion, any that sums over triangles, until no flip lessens it. parameters: the criterion's
    (see `criteria.find`). Which flips, and in which order: ports/ORDER.md.

    Raises `ValueError` for arrays of other shapes and indices that are not of a point;
    `UnknownNameError`.

        >>> kite = np.array([(0, 0), (2, -1), (9, 0), (2, 1)])
        >>> flip(kite, np.array([(0, 1, 2), (0, 2, 3)])).tolist()
        [[0, 1, 3], [1, 2, 3]]
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"flip: points have shape {points.shape}, expected (n, 2)")
    given = np.asarray(triangles)
    flat = given.ndim == 1 and given.size % 3 == 0
    rows = rows_of(given.reshape(-1, 3) if flat else given, points).copy()
    cost, test = _cost(points, rows, by, parameters)
    corner = rows.reshape(-1)
    flip_by(points, corner, link(corner), test, cost)
    return rows


def _cost(
    points: np.ndarray,
    rows: np.ndarray,
    by: criteria.Criterion | str | Callable[..., float],
    parameters: dict[str, Any],
) -> tuple[Cost, int]:
    if isinstance(by, str) and by in FLIP_TESTS and not parameters:
        return NO_COST, FLIP_TESTS.index(by)
    try:
        found = criteria.find(by, **parameters)
    except UnknownNameError as error:
        message = f"flip: {error}; flip tests: {', '.join(FLIP_TESTS)}"
        raise UnknownNameError(message) from error
    cost = plain_cost(found)
    if cost is None:
        sides = points[rows[:, 1:]] - points[rows[:, :1]]
        area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]).sum() / 2.0
        cost = cost_of(found, float(area), len(rows))
    return cost, test_of(cost)


def triangulate(
    outline: Boundary,
    *,
    criterion: criteria.Criterion | str | Callable[..., float] = "l1",
    **parameters: Any,
) -> np.ndarray:
    """Return what `flip` makes of ear clipping's triangles (m, 3)."""
    return flip(outline.points, ear_clipping(outline), criterion, **parameters)


def triangulate_as_earcut(outline: Boundary) -> np.ndarray:
    """Return ear clipping's triangles (m, 3) as `refine` of npm's earcut 3.2.4 changes them."""
    corner = np.array(ear_clipping(outline), dtype=np.int32).reshape(-1)
    as_earcut(outline.points, corner, link(corner))
    return corner.reshape(-1, 3)


def triangulate_refined(
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
    points = outline.points
    start = np.array(ear_clipping(outline), dtype=np.int32).reshape(-1)
    twin = link(start)
    if not is_triangulation(points, outline.ring_offsets, start, twin):
        start = np.array(initial_triangulations(outline)[0], dtype=np.int32).reshape(-1)
        twin = link(start)
    test = test_of(cost)
    return refine(points, start, twin, test, cost)
