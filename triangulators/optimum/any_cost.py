"""Sparse dynamic program for any cost; the costs of triangles are computed in blocks.

Recurrence, visible pairs and loop order are those of `visible_lists`, but computing a triangle's
cost takes much longer than two additions. So the triangles of many pairs i-j are weighed in one
block, because the list of one j would leave SIMD lanes empty. For expected quads, a ring of 21
vertices takes 22 microseconds; with one call for each triangle it took 46.
"""

from typing import Any

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost, allocate_block, weigh_block

# Cost of a sub-polygon without a triangulation, in float64; the sum of two does not overflow.
INFEASIBLE_COST = 1e300
_BLOCK_TRIANGLES = 256  # triangles whose costs are computed in one call


@njit(nogil=True)
def solve_any_cost(
    start: np.ndarray, target: np.ndarray, points: np.ndarray, cost: Cost
) -> np.ndarray:
    """Return the optimum (n - 2, 3) of a cycle (n, 2) for any cost; no rows if there is none."""
    chosen = _find_best_apexes(start, target, points, cost)
    n = len(points)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    stack = np.empty((n, 2), dtype=np.int32)
    stack[0, 0], stack[0, 1] = 0, n - 1
    height, size = 1, 0
    while height > 0:
        height -= 1
        i, j = stack[height, 0], stack[height, 1]
        if j - i < 2:
            continue
        low, high = start[i], start[i + 1]
        while low < high:  # binary search for the pair i-j
            middle = (low + high) // 2
            if target[middle] < j:
                low = middle + 1
            else:
                high = middle
        k = chosen[low]
        if k < 0:
            return triangles[:0]
        triangles[size, 0], triangles[size, 1], triangles[size, 2] = i, k, j
        size += 1
        stack[height, 0], stack[height, 1] = i, k
        stack[height + 1, 0], stack[height + 1, 1] = k, j
        height += 2
    return triangles


@njit(nogil=True)
def find_list_starts(target: np.ndarray, n: int) -> np.ndarray:
    """Return the starts (n + 1,) of lists by j < n, for visible pairs i-j with j in target (p,)."""
    first = np.zeros(n + 1, dtype=np.int64)
    for j in target:
        first[j + 1] += 1
    for j in range(n):
        first[j + 1] += first[j]
    return first


@njit(nogil=True)
def _find_best_apexes(
    start: np.ndarray, target: np.ndarray, points: np.ndarray, cost: Cost
) -> np.ndarray:
    """Return the best apex (p,) of each visible pair, of several the highest; -1 if there is none.

    The triangles of the next pairs, i descending and j ascending, are weighed in a block, then
    compared pair by pair: `row` has the costs of i-k, which precede i-j, and `below` those of k-j.
    """
    n, pairs = len(points), start[len(points)]
    first = find_list_starts(target, n)
    lists = (first, first[:n].copy(), np.empty(pairs, dtype=np.int32))
    apex, below = lists[2], np.empty(pairs)
    chosen, row = np.empty(pairs, dtype=np.int32), np.empty(n)
    sees = np.zeros(n, dtype=np.bool_)
    corners, totals = allocate_block(_BLOCK_TRIANGLES + n)
    entries = np.empty(_BLOCK_TRIANGLES + n + 1, dtype=np.uint32)
    ends = np.empty((2, pairs), dtype=np.int64)
    i, p = n - 1, start[n - 1]
    while i >= 0:
        next_i, next_p, count = _collect_triangles(
            i, p, start, target, lists, points, sees, corners, entries, ends
        )
        weigh_block(cost, corners, count, totals)
        at: Any = np.uint64(0)
        while i > next_i or p < next_p:
            if p == start[i + 1]:
                i -= 1
                p = start[i]
                continue
            end_vertex: Any = np.int64(target[p])
            best = INFEASIBLE_COST if end_vertex > i + 1 else 0.0
            stop: Any = np.uint64(ends[0, p])
            choice: Any = np.int32(-1)
            for triangle in range(at, stop):
                r = entries[triangle]
                k = np.uint32(apex[r])
                total = row[k] + below[r] + totals[triangle]
                if total < best:
                    best, choice = total, k
            at, chosen[p] = stop, choice
            row[end_vertex] = below[ends[1, p]] = best
            p += 1
    return chosen


@njit(nogil=True)
def _collect_triangles(
    i: int,
    p: int,
    start: np.ndarray,
    target: np.ndarray,
    lists: tuple[np.ndarray, np.ndarray, np.ndarray],
    points: np.ndarray,
    sees: np.ndarray,
    corners: tuple[np.ndarray, ...],
    entries: np.ndarray,
    ends: np.ndarray,
) -> tuple[int, int, int]:
    """Collect a block of triangles, of the pair p of vertex i and the following pairs.

    Returns the next block's vertex (-1 at the end) and pair, and the number of triangles. lists:
    start and end of each vertex's list, and the apexes of all lists; list j has the vertices that
    see j, descending, up to the current i. Writes the coordinates of triangles to `corners`, the
    index of the apex in the lists to `entries`, and to the rows of `ends`, for each pair, the
    number of triangles up to the pair, and the pair's index in the lists.
    """
    first, end, apex = lists
    ax, ay, bx, by, cx, cy = corners
    count: Any = np.uint64(0)
    while i >= 0 and count < _BLOCK_TRIANGLES:
        if p == start[i]:
            for q in range(p, start[i + 1]):
                sees[target[q]] = True
        before = count
        while p < start[i + 1] and count < _BLOCK_TRIANGLES:
            j = np.int64(target[p])
            x, y = points[j, 0], points[j, 1]
            # Numba does not test unsigned indices for a sign: this takes half as long.
            for r in range(np.uint64(first[j]), np.uint64(end[j])):
                k = np.uint32(apex[r])
                entries[count], bx[count], by[count] = r, points[k, 0], points[k, 1]
                cx[count], cy[count] = x, y
                count += np.uint64(sees[k])
            apex[end[j]] = i
            ends[0, p], ends[1, p] = count, end[j]
            end[j] += 1
            p += 1
        x, y = points[i, 0], points[i, 1]
        for column in range(before, count):
            ax[column], ay[column] = x, y
        if p == start[i + 1]:
            for q in range(start[i], p):
                sees[target[q]] = False
            i -= 1
            p = start[max(i, 0)]
    return i, p, int(count)
