"""The optimum where cost sits on edges: a bare min-plus product over pairs that see each other.

For three numbers a <= b <= c, |a - b| + |b - c| + |a - c| = 2 (c - a). So twice the half-perimeter
of a triangle's box is its perimeter in the L1 metric, and summed over a triangulation

    2 H = L1(boundary) + 2 (sum of L1 over the diagonals).

The optimum for the half-perimeter is the minimum-weight triangulation under L1, that for the edge
length the one under L2, and neither needs a triangle's cost:

    cost(i, j) = |ij| + min over k of cost(i, k) + cost(k, j)

over pairs that see each other. Three corners that do, in the order of the ring, turn left, so no
orientation is tested either.

Numbers. On a grid L1 lengths are whole multiples of its unit. A triangulation of n corners has
n - 3 diagonals, none longer than w + h, so while n (w + h) is below 2^30 units every sum fits
int32, with room for NONE + NONE; int64 holds all others that a grid of 2^24 units can have. Both
are exact. Off the grid, and for L2, the sums are float64. Weights that are to be maximised become
(longest - weight): every triangulation has as many diagonals, so the order is the same and no
weight is negative, which NONE relies on.
"""

import math
from typing import Any

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.compute.simd import FAST
from triangulators.optimum.small_ring import box_of, grid_unit

INT32_LIMIT = 1 << 30  # n (w + h), in units of the grid, below which sums fit int32

_NONE: dict[np.dtype, Any] = {
    np.dtype(np.int32): np.int32((1 << 30) - 1),
    np.dtype(np.int64): np.int64((1 << 61) - 1),
    np.dtype(np.float64): np.float64(1e300),
}
"""Cost of what has no triangulation: two of them can be added."""

_SPARSE_TO_DENSE = 4.0  # measured: time of one apex tried from a list, against one of the table
_LANES = 16


def integer_type(corners: int, half_perimeter: float) -> type:
    """Return the integers that hold all sums of a ring's diagonals, in units of the grid."""
    return np.int32 if corners * half_perimeter < INT32_LIMIT else np.int64


def most_squares(corners: int) -> float:
    """Return the sum, over corners, of the squared number of those below that see it, up to which
    lists of visible pairs are quicker than the table. Its result has other ties.
    """
    return corners**3 / (3.0 * _SPARSE_TO_DENSE) if _SPARSE_TO_DENSE > 0.0 else math.inf


@njit(nogil=True)
def _l1_of_pairs(
    points: np.ndarray, unit: float, start: np.ndarray, target: np.ndarray, weight: np.ndarray
) -> None:
    """Write the L1 length of each pair, in units, into `weight` of integers."""
    for i in range(len(points)):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
            weight[p] = np.int64((abs(dx) + abs(dy)) / unit)


@njit(nogil=True)
def _length_of_pairs(
    points: np.ndarray, by_l1: float, by_l2: float, start: np.ndarray, target: np.ndarray
) -> np.ndarray:
    """Return the weighted sum of each pair's L1 and L2 lengths."""
    weight = np.empty(len(target))
    for i in range(len(points)):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
            weight[p] = by_l1 * (abs(dx) + abs(dy)) + by_l2 * np.sqrt(dx * dx + dy * dy)
    return weight


@njit(nogil=True)
def _push(
    table: np.ndarray,
    rows: np.ndarray,
    costs: tuple[float, float, float, float],
    k: np.uint64,
    first: np.uint64,
) -> None:
    """Push the costs of i, k for four corners i into their rows, by way of the table's row k.

    first: a register's first lane, at or before k + 1; what is before that lowers nothing, as the
    table has none left of the diagonal. Unsigned numbers let LLVM see that no index is negative.
    """
    a, b, c, d = costs
    for j in range(first, np.uint64(table.shape[1])):
        # The casts keep Numba from widening to int64, which would halve the lanes.
        beyond = table[k, j]
        rows[0, j] = min(rows[0, j], rows.dtype.type(a + beyond))
        rows[1, j] = min(rows[1, j], rows.dtype.type(b + beyond))
        rows[2, j] = min(rows[2, j], rows.dtype.type(c + beyond))
        rows[3, j] = min(rows[3, j], rows.dtype.type(d + beyond))


@njit(nogil=True)
def fill_table(table: np.ndarray, none: float) -> None:
    """Turn the weights of pairs into the least costs of what lies above them, in place.

    table: (n, lanes), the weight of i, j at [i, j], `none` where they do not see each other and
    left of the diagonal; 0 for the sides.

    Loop order. Corner i descends; for each, k ascends, and once cost(i, k) is final it is pushed
    into cost(i, j) for all j beyond: additions and minima in SIMD lanes, no reduction, and pairs
    that do not see each other cost nothing. The table's row k is read once for four corners i at a
    time, which are four rows that stay in the first-level cache: what bounds the speed is then
    arithmetic, no longer the table's way from memory. Of the four, a lower one has to wait for the
    higher ones at each k; that is the scalar part.
    """
    n = len(table)
    rows = np.empty((4, table.shape[1]), dtype=table.dtype)
    nothing = table.dtype.type(none)
    for top in range(n - 1, -1, -4):
        size = min(4, top + 1)
        rows[:] = nothing
        for k in range(top - size + 2, n):
            for r in range(size):
                i = top - r
                if k <= i + 1:
                    continue
                cost = rows[r, k]
                for between in range(i + 1, min(top + 1, k)):
                    cost = min(cost, table.dtype.type(table[i, between] + table[between, k]))
                table[i, k] = min(table.dtype.type(cost + table[i, k]), nothing)
            if k <= top:
                continue
            a = table[top, k]
            b = table[top - 1, k] if size > 1 else nothing
            c = table[top - 2, k] if size > 2 else nothing
            d = table[top - 3, k] if size > 3 else nothing
            if min(min(a, b), min(c, d)) < nothing:
                first = np.uint64((k + 1) & ~(_LANES - 1))
                _push(table, rows, (a, b, c, d), np.uint64(k), first)


@njit(nogil=True)
def _trace_table(table: np.ndarray, none: float) -> np.ndarray:
    """Return the triangles (n - 2, 3) behind a filled table; no rows if there are none.

    No apex was kept: the n - 2 that are needed are found again, from the same sums, by a stack of
    pairs i-j whose sub-polygons are still to do. What a pair itself costs is there for each apex.
    """
    n = len(table)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    stack = np.empty((n, 2), dtype=np.int32)
    stack[0, 0], stack[0, 1] = 0, n - 1
    height, found = 1, 0
    while height > 0:
        height -= 1
        i, j = stack[height, 0], stack[height, 1]
        if j - i < 2:
            continue
        best, apex = none, -1
        for k in range(i + 1, j):
            total = table[i, k] + table[k, j]
            if total < best:
                best, apex = total, k
        if apex < 0:
            return triangles[:0]
        triangles[found, 0], triangles[found, 1], triangles[found, 2] = i, apex, j
        found += 1
        stack[height, 0], stack[height, 1] = i, apex
        stack[height + 1, 0], stack[height + 1, 1] = apex, j
        height += 2
    return triangles


@njit(nogil=True)
def _spread(
    n: int, start: np.ndarray, target: np.ndarray, weight: np.ndarray, none: float
) -> np.ndarray:
    """Return the table of weights that `fill_table` takes."""
    lanes = (n + _LANES - 1) // _LANES * _LANES
    table = np.empty((n, lanes), dtype=weight.dtype)
    table[:] = none
    for i in range(n):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            side = j == i + 1 or j - i == n - 1
            table[i, j] = 0 if side else weight[p]
    return table


@njit(nogil=True, fastmath=FAST)
def _least(
    row: np.ndarray, apex: np.ndarray, column: np.ndarray, first: np.uint64, end: np.uint64
) -> float:
    """Return the least of row[apex[r]] + column[r] for r in first..end - 1, at least one."""
    best = row.dtype.type(row[np.uint32(apex[first])] + column[first])
    for r in range(first + np.uint64(1), end):
        best = min(best, row.dtype.type(row[np.uint32(apex[r])] + column[r]))
    return best


@njit(nogil=True)
def fill_lists(
    n: int, start: np.ndarray, target: np.ndarray, weight: np.ndarray, none: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (row costs, list starts, list apexes, list costs): cost(i, j) by i, and by j.

    The same recurrence over visible pairs only, with memory in proportion to them. Corner i
    descends; `row[k]` is cost(i, k) for the k that i sees, and for each j the costs (k, j) with
    k > i are a list that grows as i descends. So for each pair one list is read from front to
    back, and one row gathered from: the row is a few kilobytes and stays in the first-level cache.
    Where k does not see i, row[k] is `none`.
    """
    first = np.zeros(n + 1, dtype=np.int64)
    for p in range(start[n]):
        first[target[p] + 1] += 1
    for j in range(n):
        first[j + 1] += first[j]
    end = first[:n].copy()
    apex = np.empty(start[n], dtype=np.int32)
    column = np.empty(start[n], dtype=weight.dtype)
    row_cost = np.empty(start[n], dtype=weight.dtype)
    row = np.empty(n, dtype=weight.dtype)
    row[:] = none
    nothing = weight.dtype.type(none)
    for i in range(n - 1, -1, -1):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            best = nothing
            if j == i + 1:
                best = weight.dtype.type(0)
            elif end[j] > first[j]:
                best = _least(row, apex, column, np.uint64(first[j]), np.uint64(end[j]))
                if j - i < n - 1:
                    best = min(weight.dtype.type(best + weight[p]), nothing)
            row[j] = row_cost[p] = best
            apex[end[j]], column[end[j]] = i, best
            end[j] += 1
        for p in range(start[i], start[i + 1]):
            row[target[p]] = none
    return row_cost, first, apex, column


@njit(nogil=True)
def _trace_lists(
    n: int,
    start: np.ndarray,
    target: np.ndarray,
    filled: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    none: float,
) -> np.ndarray:
    """Return the triangles (n - 2, 3) behind what `fill_lists` found; no rows if none.

    As `_trace_table`, with the pairs of i spread into a row: a list descends, so its apexes that
    are in question come first, and of those that tie it is the highest that is taken.
    """
    row_cost, first, apex, column = filled
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    row = np.empty(n, dtype=column.dtype)
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
                break
            total = row[k] + column[r]
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


def weights_of_pairs(
    points: np.ndarray, start: np.ndarray, target: np.ndarray, box: np.ndarray
) -> np.ndarray:
    """Return what each visible pair costs as a diagonal, none below zero: int32, int64, float64.

    box: coefficients of half-perimeter, bounding-box area (0 here) and edge length.
    """
    unit = grid_unit(points) if box[2] == 0.0 else 0.0
    if unit > 0.0:
        _, _, w, h = box_of(points)
        kind = integer_type(len(points), (w + h) / unit)
        weight: np.ndarray = np.empty(len(target), dtype=kind)
        _l1_of_pairs(points, unit, start, target, weight)
        if box[0] < 0.0:
            np.subtract(kind((w + h) / unit), weight, out=weight)
        return weight
    weight = _length_of_pairs(points, box[0], 2.0 * box[2], start, target)
    least = weight.min()
    return weight if least >= 0.0 else weight - least


def edge_optimum(
    points: np.ndarray, start: np.ndarray, target: np.ndarray, box: np.ndarray
) -> np.ndarray:
    """Return the optimum (n - 2, 3) of a counter-clockwise cycle (n, 2); no rows if none.

    start, target: its `visible_pairs`, all of them; box: as for `weights_of_pairs`. By the table
    where corners see many others, else by lists of visible pairs.
    """
    n = len(points)
    weight = weights_of_pairs(points, start, target, box)
    none = _NONE[weight.dtype]
    seen_from_below = np.bincount(target, minlength=n).astype(np.float64)
    if float(np.dot(seen_from_below, seen_from_below)) > most_squares(n):
        table = _spread(n, start, target, weight, none)
        fill_table(table, none)
        return _trace_table(table, none)
    filled = fill_lists(n, start, target, weight, none)
    return _trace_lists(n, start, target, filled, none)
