"""Flips of existing triangles, and the triangulators that flip after ear clipping."""

import math
from functools import lru_cache
from typing import Any

import numpy as np

from triangulators import criteria
from triangulators.compute.kernels import copy_rows, njit
from triangulators.criteria import FLIP_TESTS
from triangulators.criteria.cost import Cost, compute_total_cost, find_plain_cost, make_cost
from triangulators.criteria.criterion import CriterionLike
from triangulators.errors import UnknownNameError
from triangulators.geometry.ear_clipping import clip_ears_of_ring
from triangulators.geometry.flips import (
    flip_as_earcut,
    flip_by_delaunay,
    flip_by_l1,
    flip_by_length,
)
from triangulators.geometry.half_edges import is_triangulation, link_half_edges
from triangulators.geometry.order import is_walk, put_in_walk_order_by_twins
from triangulators.initial import find_any_triangulation
from triangulators.libraries import ear_clipping
from triangulators.optimum.local_search import MAX_RING_TRIANGLES, flip_by_cost, optimise_windows
from triangulators.polygon import Boundary, boundary_area
from triangulators.polygon_arrays import Batch, rings_at
from triangulators.verify import check_triangle_indices

# Flip tests: the first three in the order of FLIP_TESTS; NONE: no flips. The kernels' argument
# `decreased` is the cost if the test is COST, otherwise None. Numba compiles separate code for
# None, which omits `optimise_windows`: a sixth of the compile time of a first run.
L1, EUCLIDEAN, DELAUNAY, AS_EARCUT, COST, NONE = range(6)

# Argument for flip tests that read no cost; compiled code needs a value of the type.
NO_COST = make_cost(criteria.find("half-perimeter"), 1.0, 1)


@njit(nogil=True)
def flip_by_test(points: np.ndarray, corner: np.ndarray, twin: np.ndarray, test: int) -> int:
    """Flip in place until no flip passes `test` (any except COST); return the number of flips."""
    if test == L1:
        return flip_by_l1(points, corner, twin)
    if test == EUCLIDEAN:
        return flip_by_length(points, corner, twin)
    if test == DELAUNAY:
        return flip_by_delaunay(points, corner, twin)
    if test == AS_EARCUT:
        return flip_as_earcut(points, corner, twin)
    return 0


@njit(nogil=True)
def _shorten_if_cheaper(
    points: np.ndarray, corner: np.ndarray, twin: np.ndarray, cost: Cost
) -> None:
    shorter, shorter_twin = corner.copy(), twin.copy()
    flip_by_l1(points, shorter, shorter_twin)
    before = compute_total_cost(points, corner.reshape(-1, 3), cost)
    if compute_total_cost(points, shorter.reshape(-1, 3), cost) < before:
        corner[:] = shorter
        twin[:] = shorter_twin


@njit(nogil=True)
def refine(
    points: np.ndarray,
    corner: np.ndarray,
    twin: np.ndarray,
    test: int,
    cost: Cost,
    decreased: Cost | None,
) -> np.ndarray:
    """Return a triangulation (m, 3), in walk order, that costs no more than the given triangles.

    corner, twin: (3 m,) half-edges, overwritten. decreased: the cost if `test` is COST, else None.

    L1 and Euclidean lengths: diagonals of two initial solutions are flipped, of the given and of
    the constrained Delaunay triangulation (flips by the in-circle test); the cheaper result is
    returned.

    Other costs: windows (see `local_search`) are optimised, then diagonals flipped. Above
    `MAX_RING_TRIANGLES`, flips by L1 lengths come first: they shorten long edges that cross several
    windows. Flips alone, from both initial solutions, take as long and leave the expected
    quads of letters 3.5 % above the optimum, not 0.1 %.
    """
    rows = corner.reshape(-1, 3)
    if decreased is not None:
        if len(rows) > MAX_RING_TRIANGLES:
            _shorten_if_cheaper(points, corner, twin, decreased)
        if not optimise_windows(points, rows, twin.reshape(-1, 3), decreased):
            flip_by_cost(points, points, corner, twin, decreased)
        return put_in_walk_order_by_twins(rows, twin, len(points))
    delaunay, delaunay_twin = corner.copy(), twin.copy()
    use_delaunay = flip_by_delaunay(points, delaunay, delaunay_twin) > 0
    flip_by_test(points, corner, twin, test)
    if use_delaunay:
        delaunay_rows = delaunay.reshape(-1, 3)
        flip_by_test(points, delaunay, delaunay_twin, test)
        if compute_total_cost(points, delaunay_rows, cost) < compute_total_cost(points, rows, cost):
            return put_in_walk_order_by_twins(delaunay_rows, delaunay_twin, len(points))
    return put_in_walk_order_by_twins(rows, twin, len(points))


@njit(nogil=True)
def _refine_if_valid(
    points: np.ndarray,
    ring_offsets: np.ndarray,
    corner: np.ndarray,
    test: int,
    cost: Cost,
    decreased: Cost | None,
) -> np.ndarray:
    twin = link_half_edges(corner)
    if is_triangulation(points, ring_offsets, corner, twin):
        return refine(points, corner, twin, test, cost, decreased)
    return corner.reshape(-1, 3)[:0]


@njit(nogil=True)
def improve_batch(
    first: int,
    last: int,
    batch: Batch,
    raw: tuple[np.ndarray, np.ndarray, np.ndarray],
    test: int,
    cost: Cost,
    decreased: Cost | None,
    uses_refine: bool,
    in_walk: bool,
) -> None:
    """Write improved triangles of polygons first..last - 1 to `batch`; set `done` if they conform.

    raw: (triangles, bounds, to_clip): ear clipping's triangles (m, 3), overwritten; polygon i has
    the rows from bounds[i - first] to bounds[i - first + 1]; to_clip (p,): polygons without rows,
    to clip here. uses_refine: improve by `refine`, always in walk order, instead of flips only.
    """
    raw_triangles, bounds, to_clip = raw
    coords, ring_offsets, geom_offsets, _vertex_offsets, offsets, triangles, done = batch
    for index in range(first, last):
        points, rings = rings_at(index, coords, ring_offsets, geom_offsets)
        rows = raw_triangles[bounds[index - first] : bounds[index - first + 1]]
        room = triangles[offsets[index] : offsets[index + 1]]
        if to_clip[index]:
            rows = clip_ears_of_ring(points)
        if len(rows) == 0 or len(rows) != len(room):
            continue
        corner = rows.reshape(-1)
        twin = link_half_edges(corner)
        if not uses_refine:
            if decreased is not None:
                flip_by_cost(points, points, corner, twin, decreased)
            else:
                flip_by_test(points, corner, twin, test)
        if is_triangulation(points, rings, corner, twin):
            if uses_refine:
                rows = refine(points, corner, twin, test, cost, decreased)
            elif in_walk:
                rows = put_in_walk_order_by_twins(rows, twin, len(points))
            copy_rows(rows, room)
            done[index] = True


def find_flip_test(cost: Cost) -> int:
    """Return the flip test that decreases a cost: L1, EUCLIDEAN, or COST for any other cost."""
    by_l1, by_area, by_l2 = cost["box"].tolist()
    if cost["is_box"] and by_area == 0.0:
        if by_l1 > 0.0 and by_l2 == 0.0:
            return L1  # the half-perimeter decreases with L1 lengths: see `optimum.visible_lists`
        if by_l2 > 0.0 and by_l1 == 0.0:
            return EUCLIDEAN
    return COST


def flip(
    points: np.ndarray,
    triangles: np.ndarray,
    by: CriterionLike = "l1",
    order: str = "walk",
    scale: float = 1.0,
    **parameters: Any,
) -> np.ndarray:
    """Flip the diagonals of existing triangles until no flip reduces a cost.

    A diagonal is an edge of two triangles; no other edge changes, and no vertex is added. The order
    of flips and of the resulting triangles is specified in ports/ORDER.md.

    Parameters
    ----------
    points
        (n, 2) float64, or integers up to 2^53.
    triangles
        (m, 3) or (3 m,) indices, all of the same orientation.
    by
        "l1" flips to diagonals with less abs(dx) + abs(dy), which reduces the number of 2x2 pixel
        quads that a GPU shades; "euclidean" flips to shorter diagonals; "delaunay" flips until no
        vertex is inside the circumcircle of an adjacent triangle; a criterion (see `criteria.find`)
        flips until no flip decreases the criterion. For "expected-quads", pairs of flips are tried
        as well.
    order
        "walk" puts the result in an order from neighbour to neighbour, in which a GPU transforms
        few vertices twice; "native" leaves a flip's two triangles at the positions of the old two.
    scale
        Pixels per unit of the points; "expected-quads" and other criteria depend on it.
    **parameters
        Parameters of the criterion.

    Returns
    -------
    ndarray
        (m, 3) int32.

    Raises
    ------
    ValueError
        If an array has another shape, an index is out of range, or the scale is not positive.
    UnknownNameError
        If `by` is neither a test nor a criterion, or the order is unknown.

    References
    ----------
    C. L. Lawson, "Software for C1 surface interpolation", 1977.

    Examples
    --------
    >>> kite = np.array([(0, 0), (2, -1), (9, 0), (2, 1)])
    >>> flip(kite, np.array([(0, 1, 2), (0, 2, 3)])).tolist()
    [[0, 1, 3], [3, 1, 2]]
    """
    in_walk = is_walk(order)
    points = np.ascontiguousarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"flip: points have shape {points.shape}, expected (n, 2)")
    indices = np.asarray(triangles)
    flat = indices.ndim == 1 and indices.size % 3 == 0
    rows = check_triangle_indices(indices.reshape(-1, 3) if flat else indices, points).copy()
    if not 0.0 < scale < math.inf:
        raise ValueError(f"flip: scale must be a positive number, not {scale}")
    scaled = points * scale
    cost, test = _resolve_cost(scaled, rows, by, parameters)
    corner = rows.reshape(-1)
    twin = link_half_edges(corner)
    if test == COST:
        flip_by_cost(points, scaled, corner, twin, cost)
    else:
        flip_by_test(points, corner, twin, test)
    return put_in_walk_order_by_twins(rows, twin, len(points)) if in_walk else rows


def _resolve_cost(
    points: np.ndarray, rows: np.ndarray, by: CriterionLike, parameters: dict[str, Any]
) -> tuple[Cost, int]:
    if isinstance(by, str) and by in FLIP_TESTS and not parameters:
        return NO_COST, FLIP_TESTS.index(by)
    try:
        resolved = criteria.find(by, **parameters)
    except UnknownNameError as error:
        message = f"flip: {error}; flip tests: {', '.join(FLIP_TESTS)}"
        raise UnknownNameError(message) from error
    cost = find_plain_cost(resolved)
    if cost is None:
        sides = points[rows[:, 1:]] - points[rows[:, :1]]
        area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]).sum() / 2.0
        cost = make_cost(resolved, float(area), len(rows))
    return cost, find_flip_test(cost)


def triangulate(
    outline: Boundary, *, criterion: CriterionLike = "l1", **parameters: Any
) -> np.ndarray:
    """Return ear clipping's triangles (m, 3) after `flip` by `criterion`, in native order."""
    return flip(outline.points, ear_clipping(outline), criterion, "native", **parameters)


def triangulate_as_earcut(outline: Boundary) -> np.ndarray:
    """Return ear clipping's triangles (m, 3) after the flips of npm's earcut 3.2.4 (`refine()`)."""
    corner = np.array(ear_clipping(outline), dtype=np.int32).reshape(-1)
    flip_as_earcut(outline.points, corner, link_half_edges(corner))
    return corner.reshape(-1, 3)


def triangulate_refined(
    outline: Boundary, *, criterion: CriterionLike = "half-perimeter", **parameters: Any
) -> np.ndarray:
    """Return ear clipping's triangulation (m, 3), improved by `refine` for a criterion."""
    resolved = criteria.find(criterion, **parameters)
    cost, test = _find_plain_cost_and_test(resolved)
    if cost is None:
        cost = make_cost(resolved, boundary_area(outline), outline.expected_triangles)
        test = find_flip_test(cost)
    points, rings = outline.points, outline.ring_offsets
    ears = ear_clipping(outline).astype(np.int32).reshape(-1)
    decreased = cost if test == COST else None
    rows: np.ndarray = _refine_if_valid(points, rings, ears, test, cost, decreased)
    if len(rows) > 0:
        return rows
    corner = find_any_triangulation(outline).astype(np.int32).reshape(-1)
    return refine(points, corner, link_half_edges(corner), test, cost, decreased)


@lru_cache(maxsize=64)
def _find_plain_cost_and_test(criterion: criteria.Criterion) -> tuple[Cost | None, int]:
    cost = find_plain_cost(criterion)
    return cost, NONE if cost is None else find_flip_test(cost)
