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
from triangulators.criteria.cost import Cost, cost_at, cost_of, plain_cost, total_cost
from triangulators.geometry.order import walk_along
from triangulators.geometry.predicates import turn
from triangulators.geometry.unfold import neighbours_of
from triangulators.libraries import ear_clipping
from triangulators.optimum.batch_kernels import polygon_of
from triangulators.polygon import Boundary, boundary_area
from triangulators.starting.starts import starts

_L1, _ANY, _IN_CIRCLE = range(3)
_SLACK = 1e-12  # of what is compared: a gain below it may be rounding, and flips would not end
_SWEEPS = 100  # for the in-circle test, whose rounding might let flips go round in a circle


@njit(nogil=True)
def is_triangulation(
    points: np.ndarray, ends: np.ndarray, triangles: np.ndarray, across: np.ndarray
) -> bool:
    """Whether triangles all turn left and what they do not share is the rings' edges, once each.

    across: their neighbours, as `neighbours_of` returns them.
    """
    n = len(points)
    if len(triangles) != n + 2 * (len(ends) - 1) - 2:
        return False
    following = np.arange(1, n + 1)
    start = 0
    for end in ends:
        following[end - 1] = start
        start = end
    edges = 0
    for row in range(len(triangles)):
        a, b, c = triangles[row, 0], triangles[row, 1], triangles[row, 2]
        if turn(points, a, b, c) <= 0.0:
            return False
        for e in range(3):
            if across[row, e] < 0:
                edges += 1
                if following[a] != b and following[b] != a:
                    return False
            a, b, c = b, c, a
    return edges == n


@njit(nogil=True)
def _l1(points: np.ndarray, a: int, b: int) -> float:
    return abs(points[a, 0] - points[b, 0]) + abs(points[a, 1] - points[b, 1])


@njit(nogil=True)
def _in_circle(points: np.ndarray, a: int, b: int, c: int, d: int) -> float:
    """Return how far d is inside the circle through a, b, c, which turn left; in no unit."""
    ax, ay = points[a, 0] - points[d, 0], points[a, 1] - points[d, 1]
    bx, by = points[b, 0] - points[d, 0], points[b, 1] - points[d, 1]
    cx, cy = points[c, 0] - points[d, 0], points[c, 1] - points[d, 1]
    aa, bb, cc = ax * ax + ay * ay, bx * bx + by * by, cx * cx + cy * cy
    size = aa * abs(bx * cy - by * cx) + bb * abs(cx * ay - cy * ax) + cc * abs(ax * by - ay * bx)
    inside = aa * (bx * cy - by * cx) + bb * (cx * ay - cy * ax) + cc * (ax * by - ay * bx)
    return inside - _SLACK * size


@njit(nogil=True)
def _gains(points: np.ndarray, a: int, b: int, c: int, d: int, test: int, cost: Cost) -> bool:
    """Whether the diagonal c-d is better than a-b, in the quadrilateral a, d, b, c."""
    if test == _L1:
        return _l1(points, c, d) < _l1(points, a, b)
    if test == _IN_CIRCLE:
        return _in_circle(points, a, b, c, d) > 0.0
    old = cost_at(points, a, b, c, cost) + cost_at(points, b, a, d, cost)
    new = cost_at(points, a, d, c, cost) + cost_at(points, d, b, c, cost)
    return new < old - _SLACK * (abs(old) + abs(new))


@njit(nogil=True)
def _point_back(
    triangles: np.ndarray, across: np.ndarray, row: int, tail: int, head: int, to: int
) -> None:
    """Make `to` the neighbour of triangle `row`, if it is one, across its edge tail-head."""
    if row < 0:
        return
    for e in range(3):
        if triangles[row, e] == tail and triangles[row, (e + 1) % 3] == head:
            across[row, e] = to


@njit(nogil=True)
def _flip(triangles: np.ndarray, across: np.ndarray, r: int, e: int, s: int, f: int) -> None:
    """Flip the edge e of triangle r, which is the edge f of triangle s."""
    a, b, c = triangles[r, e], triangles[r, (e + 1) % 3], triangles[r, (e + 2) % 3]
    d = triangles[s, (f + 2) % 3]
    beyond_bc, beyond_ca = across[r, (e + 1) % 3], across[r, (e + 2) % 3]
    beyond_ad, beyond_db = across[s, (f + 1) % 3], across[s, (f + 2) % 3]
    triangles[r, 0], triangles[r, 1], triangles[r, 2] = a, d, c
    across[r, 0], across[r, 1], across[r, 2] = beyond_ad, s, beyond_ca
    triangles[s, 0], triangles[s, 1], triangles[s, 2] = d, b, c
    across[s, 0], across[s, 1], across[s, 2] = beyond_db, beyond_bc, r
    _point_back(triangles, across, beyond_ad, d, a, r)
    _point_back(triangles, across, beyond_bc, c, b, s)


@njit(nogil=True, inline="always")
def _flips(
    points: np.ndarray, triangles: np.ndarray, across: np.ndarray, test: int, cost: Cost
) -> int:
    """Flip in place until no flip gains; return how many were made.

    The gain is looked at first: it is two distances, where convexity is two exact orientations.
    An edge is looked at from the triangle with the smaller number only. Every flip by a criterion
    makes its sum less, so no triangulation is met twice and it ends.
    """
    flips, sweeps, before = 0, 0, -1
    while flips != before and (test != _IN_CIRCLE or sweeps < _SWEEPS):
        before = flips
        sweeps += 1
        for r in range(len(triangles)):
            for e in range(3):
                s = across[r, e]
                if s < r:
                    continue
                a, b, c = triangles[r, e], triangles[r, (e + 1) % 3], triangles[r, (e + 2) % 3]
                d: Any = np.int32(triangles[s, 0] + triangles[s, 1] + triangles[s, 2] - a - b)
                if (
                    _gains(points, a, b, c, d, test, cost)
                    and turn(points, a, d, c) > 0.0
                    and turn(points, d, b, c) > 0.0
                ):
                    f = 0
                    while triangles[s, f] != b:
                        f += 1
                    _flip(triangles, across, r, e, s, f)
                    flips += 1
    return flips


# One compiled form for each test: to ask for it at each edge takes longer than what it chooses.


@njit(nogil=True)
def _flips_by_l1(points: np.ndarray, triangles: np.ndarray, across: np.ndarray, cost: Cost) -> int:
    return _flips(points, triangles, across, _L1, cost)


@njit(nogil=True)
def _flips_by_circles(
    points: np.ndarray, triangles: np.ndarray, across: np.ndarray, cost: Cost
) -> int:
    return _flips(points, triangles, across, _IN_CIRCLE, cost)


@njit(nogil=True)
def _flips_by_cost(
    points: np.ndarray, triangles: np.ndarray, across: np.ndarray, cost: Cost
) -> int:
    return _flips(points, triangles, across, _ANY, cost)


@njit(nogil=True)
def _l1_of(points: np.ndarray, triangles: np.ndarray) -> float:
    """Return the L1 length of all triangles' edges."""
    total = 0.0
    for row in range(len(triangles)):
        a, b, c = triangles[row, 0], triangles[row, 1], triangles[row, 2]
        total += _l1(points, a, b) + _l1(points, b, c) + _l1(points, c, a)
    return total


@njit(nogil=True)
def refine(
    points: np.ndarray, triangles: np.ndarray, across: np.ndarray, test: int, cost: Cost
) -> np.ndarray:
    """Return what flips make of triangles (m, 3), in the order of `order.walk`.

    across: the neighbours of the triangles; both are overwritten.
    """
    other, beside = triangles.copy(), across.copy()
    by_circles = _flips_by_circles(points, other, beside, cost) > 0
    if test == _L1:
        _flips_by_l1(points, triangles, across, cost)
        if by_circles:
            _flips_by_l1(points, other, beside, cost)
            by_circles = _l1_of(points, other) < _l1_of(points, triangles)
    else:
        _flips_by_cost(points, triangles, across, cost)
        if by_circles:
            _flips_by_cost(points, other, beside, cost)
            one = total_cost(points, triangles, cost)
            by_circles = total_cost(points, other, cost) < one
    if by_circles:
        return walk_along(other, beside, len(points))
    return walk_along(triangles, across, len(points))


@njit(nogil=True)
def refine_many(
    first: int,
    last: int,
    coordinates: np.ndarray,
    ring_ends: np.ndarray,
    owners: np.ndarray,
    raw: np.ndarray,
    bounds: np.ndarray,
    test: int,
    cost: Cost,
    starts: np.ndarray,
    triangles: np.ndarray,
    done: np.ndarray,
) -> None:
    """Do `refine` for the polygons first..last - 1; mark in `done` those that had a start.

    raw[bounds[i - first]:bounds[i - first + 1]] are the triangles to start from of polygon i; they
    are overwritten.
    """
    for index in range(first, last):
        points, ends = polygon_of(index, coordinates, ring_ends, owners)
        own = raw[bounds[index - first] : bounds[index - first + 1]]
        if len(own) == 0:
            continue
        across = neighbours_of(own, len(points))
        if is_triangulation(points, ends, own, across):
            room = triangles[starts[index] : starts[index + 1]]
            room[:] = refine(points, own, across, test, cost)
            done[index] = True


@njit(nogil=True)
def take_many(
    first: int,
    last: int,
    coordinates: np.ndarray,
    ring_ends: np.ndarray,
    owners: np.ndarray,
    raw: np.ndarray,
    bounds: np.ndarray,
    starts: np.ndarray,
    triangles: np.ndarray,
    done: np.ndarray,
) -> None:
    """Take over the triangles of `raw`, as `refine_many` gets them, where they are conforming."""
    for index in range(first, last):
        points, ends = polygon_of(index, coordinates, ring_ends, owners)
        own = raw[bounds[index - first] : bounds[index - first + 1]]
        room = triangles[starts[index] : starts[index + 1]]
        if len(own) == 0 or len(own) != len(room):
            continue
        if is_triangulation(points, ends, own, neighbours_of(own, len(points))):
            room[:] = own
            done[index] = True


def test_of(cost: Cost) -> int:
    """Return the test by which flips lessen a cost."""
    by_l1, by_area, by_l2 = cost["box"].tolist()
    return _L1 if cost["is_box"] and by_l1 > 0.0 and by_area == by_l2 == 0.0 else _ANY


def triangulate(
    outline: Boundary,
    *,
    criterion: criteria.Criterion | str | Callable[..., float] = "half-perimeter",
    **parameters: Any,
) -> np.ndarray:
    """Return a triangulation (m, 3) that no flip improves, never worse than ear clipping.

    criterion: any that sums over triangles, `ValueError` for others; parameters: the criterion's
    (see `criteria.find`). Its time grows with the number of vertices as ear clipping's does.
    """
    found = criteria.find(criterion, **parameters)
    if found.maximum:
        raise ValueError(f"refined: {found.name} is no sum over triangles; drop minmax-")
    cost = plain_cost(found) or cost_of(found, boundary_area(outline), outline.expected_triangles)
    points, ends = outline.points, outline.ends.astype(np.int64)
    start = np.array(ear_clipping.triangulate(outline), dtype=np.int32, order="C")
    across = neighbours_of(start, len(points))
    if not is_triangulation(points, ends, start, across):
        start = np.array(starts(outline)[0], dtype=np.int32, order="C")
        across = neighbours_of(start, len(points))
    test = test_of(cost)
    return refine(points, start, across, test, cost)
