"""Flips of anybody's triangles, and the triangulators that are ear clipping with flips after it."""

from collections.abc import Callable
from typing import Any

import numpy as np

from triangulators import criteria
from triangulators.compute.arrays import copy_rows
from triangulators.compute.kernels import njit
from triangulators.criteria.catalogue import FLIP_TESTS
from triangulators.criteria.cost import Cost, cost_at, cost_of, plain_cost
from triangulators.errors import UnknownName
from triangulators.geometry.flips import (
    as_earcut,
    by_delaunay,
    by_euclidean,
    by_l1,
    convex,
    run,
)
from triangulators.geometry.half_edges import is_triangulation, link
from triangulators.libraries import ear_clipping
from triangulators.optimum.many_rings import Batch, polygon_of
from triangulators.polygon import Boundary

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
def _by_cost(points: np.ndarray, corner: np.ndarray, twin: np.ndarray, cost: Cost) -> int:
    return run(points, corner, twin, cheaper, convex, cost)


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
    return _by_cost(points, corner, twin, cost) if test == COST else 0


@njit(nogil=True, inline="always")
def each(
    first: int,
    last: int,
    batch: Batch,
    raw: tuple[np.ndarray, np.ndarray],
    test: int,
    cost: Cost,
    improved: Any,
) -> None:
    """Improve the triangles of the polygons first..last - 1; mark in `done` those that conform.

    raw: triangles (m, 3), which are overwritten, and bounds: those of polygon i are from
    bounds[i - first] to bounds[i - first + 1]. improved(points, ends, corner, twin, test, cost)
    returns what becomes of one polygon's, (m, 3), or no rows where that does not conform.
    """
    given, bounds = raw
    coordinates, rings, owners, begins, starts, triangles, done = batch
    for index in range(first, last):
        points, ends = polygon_of(index, coordinates, rings, owners, begins)
        own = given[bounds[index - first] : bounds[index - first + 1]]
        room = triangles[starts[index] : starts[index + 1]]
        if len(own) > 0 and len(own) == len(room):
            corner = own.reshape(-1)
            better = improved(points, ends, corner, link(corner), test, cost)
            if len(better) > 0:
                copy_rows(better, room)
                done[index] = True


@njit(nogil=True, inline="always")
def _flipped(
    points: np.ndarray,
    ends: np.ndarray,
    corner: np.ndarray,
    twin: np.ndarray,
    test: int,
    cost: Cost,
) -> np.ndarray:
    flip_by(points, corner, twin, test, cost)
    rows = corner.reshape(-1, 3)
    return rows if is_triangulation(points, ends, corner, twin) else rows[:0]


@njit(nogil=True)
def flip_many(
    first: int,
    last: int,
    batch: Batch,
    raw: tuple[np.ndarray, np.ndarray],
    test: int,
    cost: Cost,
) -> None:
    """Do `flip_by` for each of many polygons, see `each`."""
    each(first, last, batch, raw, test, cost, _flipped)


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
    `UnknownName`.

        >>> kite = np.array([(0, 0), (2, -1), (9, 0), (2, 1)])
        >>> flip(kite, np.array([(0, 1, 2), (0, 2, 3)])).tolist()
        [[0, 1, 3], [3, 1, 2]]
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    given = np.asarray(triangles)
    if given.size and given.dtype.kind not in "iu":
        raise ValueError(f"flip: triangles are {given.dtype}, expected whole numbers")
    if given.ndim not in (1, 2) or given.shape[-1] not in (3, given.size) or given.size % 3:
        raise ValueError(f"flip: triangles have shape {given.shape}, expected (m, 3)")
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"flip: points have shape {points.shape}, expected (n, 2)")
    if given.size and not 0 <= given.min() <= given.max() < len(points):
        raise ValueError(f"flip: triangles have indices outside 0..{len(points) - 1}")
    rows = given.astype(np.int32).reshape(-1, 3)
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
    except UnknownName as error:
        raise UnknownName(f"flip: {error}, or one of {', '.join(FLIP_TESTS)}") from error
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
    return flip(outline.points, ear_clipping.triangulate(outline), criterion, **parameters)


def triangulate_as_earcut(outline: Boundary) -> np.ndarray:
    """Return ear clipping's triangles (m, 3) as `refine` of npm's earcut 3.2.4 changes them."""
    corner = np.array(ear_clipping.triangulate(outline), dtype=np.int32).reshape(-1)
    as_earcut(outline.points, corner, link(corner))
    return corner.reshape(-1, 3)
