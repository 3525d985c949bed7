"""Sparse dynamic program over visible vertex pairs of one ring, for any cost.

The recurrence of `full_table`, with memory proportional to the visible pairs: in a noisy outline a
vertex sees a few per cent of the others, and n^3 / 6 apexes shrink to the number of mutually
visible triples.

Derivation. A diagonal joins two vertices that see each other, so cost(i, j) is needed for visible
pairs only, and its apexes k are those that both i and j see. Three mutually visible vertices, in
the order of the ring, are counter-clockwise, so no orientation is tested here.

Loop order. Vertex i descends. `row[k]` is cost(i, k) for the vertices k that i sees and `none` for
all others, which is never the minimum: no branch is needed. For each j a list has (k, cost(k, j))
for k > i, in descending order of k; it grows at the end as i descends, up to a length that is
counted in advance. The inner loop reads one list from front to back and gathers from one row of n
numbers, which fits the first-level cache.

Three kinds of costs share the loop over pairs, each with a separate inner loop; `any_cost` is for
all other costs:

edges    only edges have a cost, triangles have none. For three numbers a <= b <= c,
         |a - b| + |b - c| + |a - c| = 2 (c - a), so twice the half-perimeter of a triangle's box is
         its perimeter in the L1 metric, and summed over a triangulation

             2 H = L1(boundary) + 2 (sum of L1 over the diagonals).

         The optimum for the half-perimeter is the minimum-weight triangulation under L1, that for
         the edge length the one under L2.
boxes    half-perimeters and areas of boxes, and edges
weights  integers, whose minimum costs are evidence of optimality (see `compute_far_costs`)

Numbers. On a grid L1 lengths are integer multiples of the grid's unit. The n - 3 diagonals of a
triangulation are no longer than w + h, the width plus height of the bounding box. So if n (w + h)
is below 2^30 units, every sum fits int32, including none + none; for all other rings on a grid of
2^24 units int64 suffices. Off the grid, and for L2, sums are float64. To maximise, a diagonal's
cost is w + h minus its length: all triangulations have the same number of diagonals, so the longest
total has the lowest cost, and no cost is negative, as `none` requires.
"""

from typing import Any

import numpy as np

from triangulators.checking.evidence import Units, compute_weight
from triangulators.compute.kernels import FAST_MATH_FLAGS, fmin, njit
from triangulators.criteria.cost import BBOX_AREA, HALF_PERIMETER, Cost, cost_at, replace_fields
from triangulators.geometry.predicates import find_bounding_box, find_grid_unit
from triangulators.optimum.any_cost import INFEASIBLE_COST, find_list_starts, solve_any_cost

INT32_LIMIT = 1 << 30  # sums of lengths fit int32 if n (w + h), in units of the grid, is below this
# Cost of a sub-polygon without a triangulation; the sum of two does not overflow.
_NONE: dict[np.dtype, Any] = {
    np.dtype(np.int32): np.int32((1 << 30) - 1),
    np.dtype(np.int64): np.int64((1 << 61) - 1),
    np.dtype(np.float64): np.float64(INFEASIBLE_COST),
}

# Weight of a sub-polygon without a triangulation; the sum of three fits int64.
INFEASIBLE_WEIGHT = np.int64(2**60 - 1)
_UNSEEN = np.int64(2**62)  # marks vertices that vertex i does not see, which are skipped


@njit(nogil=True, inline="always")
def _fill_costs(
    start: np.ndarray,
    target: np.ndarray,
    extra_rows: np.ndarray,
    none: Any,
    minimise: Any,
    context: Any,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Compute the minimum cost of the sub-polygon i, ..., j of every visible pair (i, j).

    Returns the costs (p,) in the order of `target`; and in lists by j: their starts (n + 1,),
    apexes (p,), and lists (1 + b, p), whose first row has the costs, and the others the
    columns of extra_rows (b, n). minimise(row, apex, lists, range, pair, none, context) returns
    cost(i, j), the minimum over the apexes in a range of j's list; pair: i, j and the index of the
    pair in `target`.
    """
    n, pairs = len(start) - 1, start[len(start) - 1]
    first = find_list_starts(target, n)
    end = first[:n].copy()
    apex = np.empty(pairs, dtype=np.int32)
    lists = np.empty((1 + len(extra_rows), pairs), dtype=extra_rows.dtype)
    row_cost = np.empty(pairs, dtype=extra_rows.dtype)
    row = np.empty(n, dtype=extra_rows.dtype)
    row[:] = none
    for i in range(n - 1, -1, -1):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            best = extra_rows.dtype.type(0)
            if j > i + 1:
                between = (np.uint64(first[j]), np.uint64(end[j]))
                best = minimise(row, apex, lists, between, (i, j, p), none, context)
            row[j] = row_cost[p] = best
            apex[end[j]], lists[0, end[j]] = i, best
            for b in range(len(extra_rows)):
                lists[b + 1, end[j]] = extra_rows[b, i]
            end[j] += 1
        # Clear only the written entries; clearing the row would take n steps for each vertex.
        for p in range(start[i], start[i + 1]):
            row[target[p]] = none
    return row_cost, first, apex, lists


@njit(nogil=True, inline="always")
def _list_triangles(
    start: np.ndarray,
    target: np.ndarray,
    filled: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    none: Any,
    triangle_cost: Any,
    context: Any,
) -> np.ndarray:
    """Return the triangles (n - 2, 3) of the optimum that `_fill_costs` found, or no rows."""
    row_cost, first, apex, lists = filled
    n = len(start) - 1
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    row = np.empty(n, dtype=lists.dtype)
    row[:] = none
    stack = np.empty((n, 2), dtype=np.int32)
    stack[0, 0], stack[0, 1] = 0, n - 1
    height, size = 1, 0
    while height > 0:
        height -= 1
        i, j = stack[height, 0], stack[height, 1]
        if j - i < 2:
            continue
        for p in range(start[i], start[i + 1]):
            row[target[p]] = row_cost[p]
        # Each apex is found again as the minimum of the same sums, without the pair's cost.
        # `triangle_cost` is called here: Numba could not cache a caller that passes it on.
        best, best_apex = none, -1
        for r in range(first[j], first[j + 1]):
            k = apex[r]
            if k <= i:
                break  # the list descends: all further apexes are outside i..j
            if row[k] < none:
                total = row[k] + lists[0, r] + triangle_cost(i, k, j, context)
                if total < best:
                    best, best_apex = total, k
        for p in range(start[i], start[i + 1]):
            row[target[p]] = none
        if best_apex < 0:
            return triangles[:0]
        triangles[size, 0], triangles[size, 1], triangles[size, 2] = i, best_apex, j
        size += 1
        stack[height, 0], stack[height, 1] = i, best_apex
        stack[height + 1, 0], stack[height + 1, 1] = best_apex, j
        height += 2
    return triangles


# Inlined: passing four arrays for each pair of vertices took a tenth of the time.
@njit(nogil=True, forceinline=True, fastmath=FAST_MATH_FLAGS)
def _minimise_edges(
    row: np.ndarray,
    apex: np.ndarray,
    lists: np.ndarray,
    between: tuple[np.uint64, np.uint64],
    pair: tuple[int, int, int],
    none: Any,
    weights: np.ndarray,
) -> Any:
    (first, end), (_, _, p) = between, pair
    # No array is assigned to a second variable, and `weights` is read without a branch: otherwise
    # Numba would count references for each apex or pair. The casts keep Numba from widening to
    # int64, which would halve the number of SIMD lanes. The side from vertex 0 to the last counts
    # as a diagonal, which adds the same constant to every triangulation.
    kind, best = row.dtype.type, none
    for r in range(first, end):
        best = min(best, kind(row[np.uint32(apex[r])] + lists[0, r]))
    return min(kind(best + weights[p]), none)


@njit(forceinline=True, fastmath=FAST_MATH_FLAGS)
def _minimise_boxes(
    row: np.ndarray,
    apex: np.ndarray,
    lists: np.ndarray,
    between: tuple[np.uint64, np.uint64],
    pair: tuple[int, int, int],
    none: float,
    context: tuple[np.ndarray, np.ndarray],
) -> float:
    (first, end), (i, j, _), (points, box) = between, pair, context
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
def _minimise_weights(
    row: np.ndarray,
    apex: np.ndarray,
    lists: np.ndarray,
    between: tuple[np.uint64, np.uint64],
    pair: tuple[int, int, int],
    none: np.int64,
    context: tuple[np.ndarray, np.ndarray, Cost, Units],
) -> np.int64:
    (first, end), (i, j, _), (points, ring, cost, units) = between, pair, context
    best = INFEASIBLE_WEIGHT
    for r in range(first, end):
        k = apex[r]
        if row[k] < none:
            triangle = compute_weight(points, ring[i], ring[k], ring[j], cost, units)
            best = min(best, row[k] + lists[0, r] + triangle)
    return best


@njit
def _get_zero(_i: int, _k: int, _j: int, _context: Any) -> int:
    return 0


@njit
def _get_cost(i: int, k: int, j: int, context: tuple[np.ndarray, Cost]) -> float:
    return cost_at(context[0], i, k, j, context[1])


@njit
def _get_weight(
    i: int, k: int, j: int, context: tuple[np.ndarray, np.ndarray, Cost, Units]
) -> np.int64:
    points, ring, cost, units = context
    return compute_weight(points, ring[i], ring[k], ring[j], cost, units)


@njit(nogil=True)
def _find_optimum_of_edge_costs(
    start: np.ndarray, target: np.ndarray, weights: np.ndarray, none: Any
) -> np.ndarray:
    extra_rows = np.empty((0, len(start) - 1), dtype=weights.dtype)
    filled = _fill_costs(start, target, extra_rows, none, _minimise_edges, weights)
    return _list_triangles(start, target, filled, none, _get_zero, None)


@njit(nogil=True)
def _find_optimum_of_box_costs(
    start: np.ndarray, target: np.ndarray, points: np.ndarray, box: np.ndarray, in_boxes: Cost
) -> np.ndarray:
    context = (points, box)
    filled = _fill_costs(start, target, points.T.copy(), INFEASIBLE_COST, _minimise_boxes, context)
    return _list_triangles(start, target, filled, INFEASIBLE_COST, _get_cost, (points, in_boxes))


@njit(nogil=True)
def compute_far_costs(
    start: np.ndarray,
    target: np.ndarray,
    points: np.ndarray,
    ring: np.ndarray,
    cost: Cost,
    units: Units,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the far cost (p,) of each pair, and the optimal triangles (n - 2, 3) or no rows.

    Position i of the ring (n,) is the site ring[i] of `points`. The far cost far(i, j) is the
    minimum weight of a triangulation of the sub-polygon i, i + 1, ..., j by triangles of visible
    pairs of positions, `INFEASIBLE_WEIGHT` if there is none:

        far(i, i + 1) = 0,    far(i, j) = min over k of far(i, k) + far(k, j) + weight(ikj).

    These costs prove their optimality. Take -far(i, j) as the potential of the edge from i to j,
    and so far(i, j) from j to i. For a triangle i < k < j, which runs i-k, k-j and j-i, the
    inequality that potentials must satisfy,

        -far(i, k) - far(k, j) + far(i, j) <= weight(ikj),

    holds because far(i, j) is the minimum over all k; also for triangles in no triangulation, whose
    sums contain `INFEASIBLE_WEIGHT`. Sides of the ring have the potential 0, except the last side,
    from n - 1 to 0, which has far(0, n - 1): so the bound equals the optimum.
    """
    context = (points, ring, cost, units)
    extra_rows = np.empty((0, len(ring)), dtype=np.int64)
    filled = _fill_costs(start, target, extra_rows, _UNSEEN, _minimise_weights, context)
    return filled[0], _list_triangles(start, target, filled, _UNSEEN, _get_weight, context)


@njit(nogil=True)
def _compute_pair_lengths(
    points: np.ndarray, by_l1: float, by_l2: float, start: np.ndarray, target: np.ndarray
) -> np.ndarray:
    """Return by_l1 times the L1 length plus by_l2 times the L2 length (p,) of each visible pair."""
    weights = np.empty(len(target))
    for i in range(len(points)):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
            weights[p] = by_l1 * (abs(dx) + abs(dy))
            if by_l2 != 0.0:
                weights[p] += by_l2 * np.sqrt(dx * dx + dy * dy)
    return weights


def weigh_pairs(
    points: np.ndarray, start: np.ndarray, target: np.ndarray, box: np.ndarray
) -> np.ndarray:
    """Return the cost (p,) >= 0 of each visible pair as a diagonal; on a grid in integer units."""
    unit = find_grid_unit(points) if box[2] == 0.0 else 0.0
    if unit > 0.0:
        _, _, w, h = find_bounding_box(points)
        kind: Any = np.int32 if len(points) * ((w + h) / unit) < INT32_LIMIT else np.int64
        lengths = _compute_pair_lengths(points, 1.0 / unit, 0.0, start, target).astype(kind)
        return lengths if box[0] >= 0.0 else kind((w + h) / unit) - lengths
    weights = _compute_pair_lengths(points, box[0], 2.0 * box[2], start, target)
    lowest = weights.min()
    return weights if lowest >= 0.0 else weights - lowest


def solve_visible_pairs(
    points: np.ndarray, start: np.ndarray, target: np.ndarray, cost: Cost
) -> np.ndarray:
    """Return the optimum (n - 2, 3) of a counter-clockwise cycle (n, 2), or no rows."""
    if not cost["is_box"]:
        triangles: np.ndarray = solve_any_cost(start, target, points, cost)
    elif cost["box"][1] == 0.0:
        weights = weigh_pairs(points, start, target, cost["box"])
        triangles = _find_optimum_of_edge_costs(start, target, weights, _NONE[weights.dtype])
    else:
        # The cost of triangles for `_list_triangles`: without edge lengths, which `_minimise_boxes`
        # adds to the pairs, and without the area and the number of triangles, whose sums are equal
        # for all triangulations.
        boxes = np.zeros_like(cost["weights"])
        boxes[HALF_PERIMETER], boxes[BBOX_AREA] = cost["box"][0], cost["box"][1]
        in_boxes = replace_fields(cost, weights=boxes)
        triangles = _find_optimum_of_box_costs(start, target, points, cost["box"], in_boxes)
    return triangles
