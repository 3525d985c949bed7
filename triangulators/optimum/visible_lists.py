"""The least over one ring by lists of corners that see each other, for any cost.

The recurrence of `full_table`, with memory proportional to the pairs that see each other: in a
noisy outline a corner sees a few per cent of the others, and n^3 / 6 apexes shrink to as many as
three corners that see each other.

Derivation. A diagonal of a triangulation joins two corners that see each other, so cost(i, j) is
needed for visible pairs only, and its apexes k are those that both i and j see. Three corners that
see each other pairwise, in the order of the ring, turn left, so no orientation is tested here:
the exact predicates have been used up in `visibility`.

Loop order. Corner i descends. `row[k]` holds cost(i, k) for the k that i sees and `none` for all
others. For each j there is a list of (k, cost(k, j)) for k > i, in descending order of k: it grows
at its end as i descends, which is why `first` and `end` of the lists are kept apart and a corner's
final length is known beforehand by counting. The inner loop so reads one list from front to back
and gathers from one row of n numbers, which the first-level cache holds; what i does not see
answers `none` and drops out of the minimum without a branch.

Four costs share the loop, each with an inner loop of its own:

edges    cost sits on edges, and no triangle is looked at. For three numbers a <= b <= c,
         |a - b| + |b - c| + |a - c| = 2 (c - a), so twice the half-perimeter of a triangle's box is
         its perimeter in the L1 metric, and summed over a triangulation

             2 H = L1(boundary) + 2 (sum of L1 over the diagonals).

         The optimum for the half-perimeter is the minimum-weight triangulation under L1, that for
         the edge length the one under L2.
boxes    half-perimeters and areas of boxes, and edges
any      whatever function of three points
weights  whole numbers, whose least costs are evidence that nothing is less (see `far_costs`)

Those of edges and boxes are made part of that loop (`forceinline`): to hand over four arrays for
each pair of corners took a tenth of the time.

Numbers. On a grid L1 lengths are whole multiples of its unit. A triangulation of n corners has
n - 3 diagonals, none longer than w + h, so while n (w + h) is below 2^30 units every sum fits
int32, with room for none + none; int64 holds all others that a grid of 2^24 units can have. Both
are exact. Off the grid, and for L2, the sums are float64. Weights that are to be maximised become
(longest - weight): every triangulation has as many diagonals, so the order is the same and no
weight is negative, which `none` relies on.
"""

from typing import Any

import numpy as np

from triangulators.checking.units import Units, weight
from triangulators.compute.kernels import njit
from triangulators.compute.operations import FAST, fmin
from triangulators.criteria.cost import (
    BBOX_AREA,
    HALF_PERIMETER,
    Cost,
    cost_at,
    triangle_cost,
    with_fields,
)
from triangulators.geometry.predicates import box_of, grid_unit

INT32_LIMIT = 1 << 30  # n (w + h), in units of the grid, below which sums fit int32
FLOAT = 1e300
_NONE: dict[np.dtype, Any] = {
    np.dtype(np.int32): np.int32((1 << 30) - 1),
    np.dtype(np.int64): np.int64((1 << 61) - 1),
    np.dtype(np.float64): np.float64(FLOAT),
}
"""Cost of what has no triangulation: two of them can be added."""

NOTHING = np.int64(2**60 - 1)  # weight where no triangles fit; thrice that is still an int64
_UNSEEN = np.int64(2**62)  # weight of a pair that does not see each other: it is not looked at


@njit(nogil=True, inline="always")
def _fill(
    start: np.ndarray, target: np.ndarray, beside: np.ndarray, none: Any, least: Any, how: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (row costs, list starts, list apexes, lists): cost(i, j) by i, and by j.

    start, target: corner i sees `target[start[i]:start[i + 1]]`. beside (b, n): what a list holds
    of each corner beside the cost, of the costs' type. least(row, apex, lists, range, pair, none,
    how): cost(i, j) over the apexes in a range of j's list; pair: i, j, and its place in `target`.
    """
    n, pairs = len(start) - 1, start[len(start) - 1]
    first = np.zeros(n + 1, dtype=np.int64)
    for p in range(pairs):
        first[target[p] + 1] += 1
    for j in range(n):
        first[j + 1] += first[j]
    end = first[:n].copy()
    apex = np.empty(pairs, dtype=np.int32)
    lists = np.empty((1 + len(beside), pairs), dtype=beside.dtype)
    row_cost = np.empty(pairs, dtype=beside.dtype)
    row = np.empty(n, dtype=beside.dtype)
    row[:] = none
    for i in range(n - 1, -1, -1):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            best = beside.dtype.type(0)
            if j > i + 1:
                between = (np.uint64(first[j]), np.uint64(end[j]))
                best = least(row, apex, lists, between, (i, j, p), none, how)
            row[j] = row_cost[p] = best
            apex[end[j]], lists[0, end[j]] = i, best
            for b in range(len(beside)):
                lists[b + 1, end[j]] = beside[b, i]
            end[j] += 1
        # Cleared by what was written, not from end to end: that would cost n for each corner.
        for p in range(start[i], start[i + 1]):
            row[target[p]] = none
    return row_cost, first, apex, lists


@njit(nogil=True, inline="always")
def _trace(
    start: np.ndarray,
    target: np.ndarray,
    filled: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    none: Any,
    own: Any,
    how: Any,
) -> np.ndarray:
    """Return the triangles (n - 2, 3) behind what `_fill` found; no rows if there are none.

    No apex was kept: the n - 2 that are needed are found again, from the same sums, by a stack of
    pairs i-j whose sub-polygons are still to do. What a pair itself costs is there for each apex.
    own(i, k, j, how): what a triangle costs. Of apexes that tie it is the highest that is taken.
    """
    row_cost, first, apex, lists = filled
    n = len(start) - 1
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    row = np.empty(n, dtype=lists.dtype)
    row[:] = none
    stack = np.empty((n, 2), dtype=np.int32)
    stack[0, 0], stack[0, 1] = 0, n - 1
    height, found = 1, 0
    while height > 0:
        height -= 1
        i, j = stack[height, 0], stack[height, 1]
        if j - i < 2:
            continue
        for p in range(start[i], start[i + 1]):
            row[target[p]] = row_cost[p]
        best, best_apex = none, -1
        for r in range(first[j], first[j + 1]):
            k = apex[r]
            if k <= i:
                break  # the list descends: the rest lies outside i..j
            if row[k] < none:
                total = row[k] + lists[0, r] + own(i, k, j, how)
                if total < best:
                    best, best_apex = total, k
        for p in range(start[i], start[i + 1]):
            row[target[p]] = none
        if best_apex < 0:
            return triangles[:0]
        triangles[found, 0], triangles[found, 1], triangles[found, 2] = i, best_apex, j
        found += 1
        stack[height, 0], stack[height, 1] = i, best_apex
        stack[height + 1, 0], stack[height + 1, 1] = best_apex, j
        height += 2
    return triangles


@njit(nogil=True, forceinline=True, fastmath=FAST)
def _least_of_edges(
    row: np.ndarray,
    apex: np.ndarray,
    lists: np.ndarray,
    between: tuple[np.uint64, np.uint64],
    pair: tuple[int, int, int],
    none: Any,
    weights: np.ndarray,
) -> Any:
    (first, end), (_, _, p) = between, pair
    # Named once, and no branch around what is asked of `weights`: each would cost an array's
    # counted reference for each apex or pair. The casts keep Numba from widening to int64, which
    # would halve the lanes. The side from corner 0 to the last is counted: all have it.
    kind, best = row.dtype.type, none
    for r in range(first, end):
        best = min(best, kind(row[np.uint32(apex[r])] + lists[0, r]))
    return min(kind(best + weights[p]), none)


@njit(forceinline=True, fastmath=FAST)
def _least_of_boxes(
    row: np.ndarray,
    apex: np.ndarray,
    lists: np.ndarray,
    between: tuple[np.uint64, np.uint64],
    pair: tuple[int, int, int],
    none: float,
    how: tuple[np.ndarray, np.ndarray],
) -> float:
    (first, end), (i, j, _), (points, box) = between, pair, how
    xi, yi, xj, yj = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
    low_x, high_x = min(xi, xj), max(xi, xj)
    low_y, high_y = min(yi, yj), max(yi, yj)
    by_half_perimeter, by_area = box[0], box[1]
    best = none
    for r in range(first, end):
        w = max(high_x, lists[1, r]) - min(low_x, lists[1, r])
        h = max(high_y, lists[2, r]) - min(low_y, lists[2, r])
        below = row[np.uint32(apex[r])] + lists[0, r]
        best = fmin(best, below + by_half_perimeter * (w + h) + by_area * (w * h))
    return float(best + 2.0 * box[2] * np.sqrt((xi - xj) ** 2 + (yi - yj) ** 2))


@njit
def _least_of_any(
    row: np.ndarray,
    apex: np.ndarray,
    lists: np.ndarray,
    between: tuple[np.uint64, np.uint64],
    pair: tuple[int, int, int],
    none: float,
    how: tuple[np.ndarray, Cost],
) -> float:
    (first, end), (i, j, _), (points, cost) = between, pair, how
    xi, yi, xj, yj = points[i, 0], points[i, 1], points[j, 0], points[j, 1]
    best = none
    for r in range(first, end):
        left = row[apex[r]]
        if left < none:
            own = triangle_cost(cost, xi, yi, lists[1, r], lists[2, r], xj, yj)
            best = min(best, left + lists[0, r] + own)
    return best


@njit
def _least_of_weights(
    row: np.ndarray,
    apex: np.ndarray,
    lists: np.ndarray,
    between: tuple[np.uint64, np.uint64],
    pair: tuple[int, int, int],
    none: np.int64,
    how: tuple[np.ndarray, np.ndarray, Cost, Units],
) -> np.int64:
    (first, end), (i, j, _), (points, ring, cost, units) = between, pair, how
    best = NOTHING
    for r in range(first, end):
        k = apex[r]
        if row[k] < none:
            own = weight(points, ring[i], ring[k], ring[j], cost, units)
            best = min(best, row[k] + lists[0, r] + own)
    return best


@njit
def _free(_i: int, _k: int, _j: int, _how: Any) -> int:
    return 0


@njit
def _cost_in(i: int, k: int, j: int, how: tuple[np.ndarray, Cost]) -> float:
    return cost_at(how[0], i, k, j, how[1])


@njit
def _weight_in(i: int, k: int, j: int, how: tuple[np.ndarray, np.ndarray, Cost, Units]) -> np.int64:
    points, ring, cost, units = how
    return weight(points, ring[i], ring[k], ring[j], cost, units)


@njit(nogil=True)
def _by_edges(start: np.ndarray, target: np.ndarray, weights: np.ndarray, none: Any) -> np.ndarray:
    beside = np.empty((0, len(start) - 1), dtype=weights.dtype)
    filled = _fill(start, target, beside, none, _least_of_edges, weights)
    return _trace(start, target, filled, none, _free, None)


@njit(nogil=True)
def _by_boxes(
    start: np.ndarray, target: np.ndarray, points: np.ndarray, box: np.ndarray, in_boxes: Cost
) -> np.ndarray:
    how = (points, box)
    filled = _fill(start, target, points.T.copy(), FLOAT, _least_of_boxes, how)
    return _trace(start, target, filled, FLOAT, _cost_in, (points, in_boxes))


@njit(nogil=True)
def _by_any(start: np.ndarray, target: np.ndarray, points: np.ndarray, cost: Cost) -> np.ndarray:
    how = (points, cost)
    filled = _fill(start, target, points.T.copy(), FLOAT, _least_of_any, how)
    return _trace(start, target, filled, FLOAT, _cost_in, how)


@njit(nogil=True)
def far_costs(
    start: np.ndarray,
    target: np.ndarray,
    points: np.ndarray,
    ring: np.ndarray,
    cost: Cost,
    units: Units,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (far (p,) of each pair, triangles (n - 2, 3) of the least weight or no rows).

    Corner i of the ring is the site ring[i] of points, and sees `target[start[i]:start[i + 1]]`;
    far(i, j) is the least weight of a triangulation of the sub-polygon i, i + 1, ..., j by
    triangles of such pairs, `NOTHING` where there is none:

        far(i, i + 1) = 0,    far(i, j) = the least far(i, k) + far(k, j) + weight(ikj) over k.

    It is its own proof. Take -far(i, j) as the potential of the edge run from i to j, and so
    far(i, j) run from j to i. A triangle i < k < j runs i-k, k-j and j-i, and the inequality that
    potentials must satisfy,

        -far(i, k) - far(k, j) + far(i, j) <= weight(ikj),

    is what the least means, for each triangle of pairs that are there, in a triangulation or not:
    sums with `NOTHING` count as well. Sides of the ring have 0, but for the one from n - 1 to 0,
    which has far(0, n - 1): the bound is the optimum. Nothing is rounded. Source: G. T. Klincsek,
    "Minimal triangulations of polygonal domains", 1980.
    """
    how = (points, ring, cost, units)
    beside = np.empty((0, len(ring)), dtype=np.int64)
    filled = _fill(start, target, beside, _UNSEEN, _least_of_weights, how)
    return filled[0], _trace(start, target, filled, _UNSEEN, _weight_in, how)


@njit(nogil=True)
def _length_of_pairs(
    points: np.ndarray, by_l1: float, by_l2: float, start: np.ndarray, target: np.ndarray
) -> np.ndarray:
    """Return the weighted sum of each pair's L1 and L2 lengths."""
    weights = np.empty(len(target))
    for i in range(len(points)):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
            weights[p] = by_l1 * (abs(dx) + abs(dy))
            if by_l2 != 0.0:
                weights[p] += by_l2 * np.sqrt(dx * dx + dy * dy)
    return weights


def weights_of_pairs(
    points: np.ndarray, start: np.ndarray, target: np.ndarray, box: np.ndarray
) -> np.ndarray:
    """Return what each visible pair costs as a diagonal, none below zero: int32, int64, float64.

    box: coefficients of half-perimeter, bounding-box area (0 here) and edge length.
    """
    unit = grid_unit(points) if box[2] == 0.0 else 0.0
    if unit > 0.0:
        _, _, w, h = box_of(points)
        kind: Any = np.int32 if len(points) * ((w + h) / unit) < INT32_LIMIT else np.int64
        lengths = _length_of_pairs(points, 1.0 / unit, 0.0, start, target).astype(kind)
        return lengths if box[0] >= 0.0 else kind((w + h) / unit) - lengths
    weights = _length_of_pairs(points, box[0], 2.0 * box[2], start, target)
    least = weights.min()
    return weights if least >= 0.0 else weights - least


def by_lists(points: np.ndarray, start: np.ndarray, target: np.ndarray, cost: Cost) -> np.ndarray:
    """Return the optimum (n - 2, 3) of a counter-clockwise cycle (n, 2); no rows if none.

    start, target: its `visible_pairs`, all of them.
    """
    if not cost["is_box"]:
        found: np.ndarray = _by_any(start, target, points, cost)
    elif cost["box"][1] == 0.0:
        weights = weights_of_pairs(points, start, target, cost["box"])
        found = _by_edges(start, target, weights, _NONE[weights.dtype])
    else:
        # Edges are counted with the pairs, and what is the same for all is left out.
        boxes = np.zeros_like(cost["weights"])
        boxes[HALF_PERIMETER], boxes[BBOX_AREA] = cost["box"][0], cost["box"][1]
        in_boxes = with_fields(cost, weights=boxes)
        found = _by_boxes(start, target, points, cost["box"], in_boxes)
    return found
