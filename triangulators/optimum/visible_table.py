"""Minimum-cost triangulation by dynamic programming over visible pairs only.

The same recurrence as `small_ring`, for any cost, with memory proportional to the visible pairs: in
a noisy outline a corner sees a few per cent of the others, and n^3 / 6 apexes shrink to as many as
three corners that see each other.

Derivation. A diagonal of a triangulation joins two corners that see each other, so cost(i, j) is
needed for visible pairs only, and its apexes k are those that both i and j see. Three corners that
see each other pairwise, in the order of the cycle, turn left, so no orientation is tested here:
the exact predicates have been used up in `visibility`.

Loop order. Corner i descends. `row[k]` holds cost(i, k) for the k that i sees and NONE for all
others. For each j there is a list of (k, cost(k, j)) for k > i, in descending order of k: it grows
at its end as i descends, which is why `first` and `end` of the lists are kept apart and a corner's
final length is known beforehand by counting. The inner loop so reads one list from front to back
and gathers from one row of n numbers, which the first-level cache holds; what i does not see
answers NONE and drops out of the minimum without a branch.

Rounding. Costs are float64 sums; nothing here decides by the sign of a small difference. On a grid
sums of half-perimeters and of areas are exact.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.compute.simd import fmin
from triangulators.criteria.cost import BBOX_AREA, HALF_PERIMETER, Cost, triangle_cost, with_fields

NONE = 1e300  # cost of what has no triangulation; a sum of two still is finite


@njit(fastmath={"nnan", "nsz", "reassoc", "contract", "arcp"})
def _best_box(
    row: np.ndarray,
    apex: np.ndarray,
    column: np.ndarray,
    first: np.uint64,
    end: np.uint64,
    ends: tuple[float, float, float, float],
    by_half_perimeter: float,
    by_box: float,
) -> float:
    """Least cost over the apexes k at first..end - 1; `column` holds cost(k, j), x[k] and y[k]."""
    xi, yi, xj, yj = ends
    low_x, high_x = min(xi, xj), max(xi, xj)
    low_y, high_y = min(yi, yj), max(yi, yj)
    best = NONE
    for r in range(first, end):
        w = max(high_x, column[1, r]) - min(low_x, column[1, r])
        h = max(high_y, column[2, r]) - min(low_y, column[2, r])
        below = row[np.uint32(apex[r])] + column[0, r]
        best = fmin(best, below + by_half_perimeter * (w + h) + by_box * (w * h))
    return best


@njit
def _best_any(
    row: np.ndarray,
    apex: np.ndarray,
    column: np.ndarray,
    first: int,
    end: int,
    ends: tuple[float, float, float, float],
    cost: Cost,
) -> float:
    """`_best_box` for any cost."""
    xi, yi, xj, yj = ends
    best = NONE
    for r in range(first, end):
        left, right = row[apex[r]], column[0, r]
        if left >= NONE:
            continue
        own = triangle_cost(cost, xi, yi, column[1, r], column[2, r], xj, yj)
        best = min(best, left + right + own)
    return best


@njit(nogil=True)
def fill_pairs(
    x: np.ndarray,
    y: np.ndarray,
    start: np.ndarray,
    target: np.ndarray,
    cost: Cost,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (row costs, list starts, list apexes, lists): cost(i, j) by i, and by j."""
    n, pairs, box = len(x), start[len(x)], cost.box
    first = np.zeros(n + 1, dtype=np.int64)
    for p in range(pairs):
        first[target[p] + 1] += 1
    for j in range(n):
        first[j + 1] += first[j]
    end = first[:n].copy()
    apex = np.empty(pairs, dtype=np.int32)
    column = np.empty((3, pairs))
    row_cost = np.empty(pairs)
    row = np.full(n, NONE)
    for i in range(n - 1, -1, -1):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            ends = (x[i], y[i], x[j], y[j])
            if j == i + 1:
                best = 0.0
            elif cost.is_box:
                low, high = np.uint64(first[j]), np.uint64(end[j])
                best = _best_box(row, apex, column, low, high, ends, box[0], box[1])
                best += 2.0 * box[2] * np.sqrt((x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2)
            else:
                best = _best_any(row, apex, column, first[j], end[j], ends, cost)
            row[j] = row_cost[p] = best
            apex[end[j]] = i
            column[0, end[j]], column[1, end[j]], column[2, end[j]] = best, x[i], y[i]
            end[j] += 1
        # Cleared by what was written, not from end to end: that would cost n for each corner.
        for p in range(start[i], start[i + 1]):
            row[target[p]] = NONE
    return row_cost, first, apex, column


@njit(nogil=True)
def trace_pairs(
    x: np.ndarray,
    y: np.ndarray,
    start: np.ndarray,
    target: np.ndarray,
    filled: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    cost: Cost,
) -> np.ndarray:
    """Return the triangles (n - 2, 3) behind what `fill_pairs` found."""
    row_cost, first, apex, column = filled
    n = len(x)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    # No apex was kept while filling: n - 2 of them are needed, and found again from the same sums.
    row = np.full(n, NONE)
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
        best, best_apex = np.inf, -1
        for r in range(first[j], first[j + 1]):
            k = apex[r]
            if k <= i:
                break  # the list descends: the rest lies outside i..j
            if row[k] >= NONE:
                continue
            own = triangle_cost(cost, x[i], y[i], x[k], y[k], x[j], y[j])
            left, right = row[k], column[0, r]
            total = left + right + own
            if total < best:
                best, best_apex = total, k
        for p in range(start[i], start[i + 1]):
            row[target[p]] = NONE
        triangles[found, 0], triangles[found, 1], triangles[found, 2] = i, best_apex, j
        found += 1
        stack[height, 0], stack[height, 1] = i, best_apex
        stack[height + 1, 0], stack[height + 1, 1] = best_apex, j
        height += 2
    return triangles


def sparse_optimum(
    points: np.ndarray, start: np.ndarray, target: np.ndarray, cost: Cost
) -> np.ndarray:
    """Return the optimum (n - 2, 3) of a counter-clockwise cycle of points (n, 2).

    start, target: its `visible_pairs`, all of them.
    """
    x, y = np.ascontiguousarray(points.T)
    filled = fill_pairs(x, y, start, target, cost)
    return trace_pairs(x, y, start, target, filled, _as_filled(cost))


def _as_filled(cost: Cost) -> Cost:
    """Return the cost with which `trace_pairs` sees triangles as `fill_pairs` counted them.

    For a box the edges are counted with the pairs, and what is the same for all is left out.
    """
    if not cost["is_box"]:
        return cost
    weights = np.zeros_like(cost["weights"])
    weights[HALF_PERIMETER], weights[BBOX_AREA] = cost["box"][0], cost["box"][1]
    return with_fields(cost, weights=weights)
