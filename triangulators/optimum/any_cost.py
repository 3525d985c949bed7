"""Sparse dynamic program for any cost; the costs of triangles are computed in blocks.

The recurrence, the visible pairs and the order of the loops are those of `visible_lists`: vertex i
descends, and each j has a list of the apexes k > i that see j. In contrast to `visible_lists`,
computing a triangle's cost takes much longer than two additions. So the triangles of a vertex i and
of several j are collected first, and their costs are computed in one block: the list of one j is so
short that it would leave SIMD lanes empty. The best apex of each pair is stored, so that no cost is
computed twice.

For expected quads, a ring of 21 vertices (letters) takes 22 microseconds; with one call for each
triangle it took 46.
"""

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
    """Return the optimum (n - 2, 3) of a cycle (n, 2) for any cost; no rows if there is none.

    start, target: the visible pairs of the cycle, see `find_visible_pairs`.
    """
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
def _find_best_apexes(
    start: np.ndarray, target: np.ndarray, points: np.ndarray, cost: Cost
) -> np.ndarray:
    """Return the best apex (p,) of each visible pair, -1 if there is none.

    start, target: see `solve_any_cost`. Costs are computed in blocks of triangles i, k, j of one i
    and several j; the costs of the pairs i-k and k-j are final when these are compared, j by j. If
    several apexes have the minimum cost, the one with the highest index is taken.
    """
    n, pairs = len(points), start[len(points)]
    first = np.zeros(n + 1, dtype=np.int64)
    for p in range(pairs):
        first[target[p] + 1] += 1
    for j in range(n):
        first[j + 1] += first[j]
    end = first[:n].copy()
    apex, below = np.empty(pairs, dtype=np.int32), np.empty(pairs)
    chosen, row = np.full(pairs, -1, dtype=np.int32), np.full(n, INFEASIBLE_COST)
    sees = np.zeros(n, dtype=np.bool_)
    corners, totals = allocate_block(_BLOCK_TRIANGLES + n)
    ax, ay = corners[0], corners[1]
    entries = np.empty(_BLOCK_TRIANGLES + n + 1, dtype=np.int64)
    ends, lists = np.empty(n, dtype=np.int64), (first, end, apex)
    for i in range(n - 1, -1, -1):
        for p in range(start[i], start[i + 1]):
            sees[target[p]] = True
        p = start[i]
        while p < start[i + 1]:
            last = _collect_triangles(
                p, start[i + 1], target, lists, points, sees, corners, entries, ends
            )
            count = ends[last - p - 1]
            for k in range(count):
                ax[k], ay[k] = points[i, 0], points[i, 1]
            weigh_block(cost, corners, count, totals)
            at = 0
            for pair in range(p, last):
                vertex, best = (
                    np.int64(target[pair]),
                    INFEASIBLE_COST if target[pair] > i + 1 else 0.0,
                )
                while at < ends[pair - p]:
                    r = entries[at]
                    k = apex[r]
                    total = row[k] + below[r] + totals[at]
                    if total < best:
                        best, chosen[pair] = total, k
                    at += 1
                row[vertex] = best
                apex[end[vertex]], below[end[vertex]] = i, best
                end[vertex] += 1
            p = last
        for p in range(start[i], start[i + 1]):
            row[target[p]], sees[target[p]] = INFEASIBLE_COST, False
    return chosen


@njit(nogil=True)
def _collect_triangles(
    pair: int,
    stop: int,
    target: np.ndarray,
    lists: tuple[np.ndarray, np.ndarray, np.ndarray],
    points: np.ndarray,
    sees: np.ndarray,
    corners: tuple[np.ndarray, ...],
    entries: np.ndarray,
    ends: np.ndarray,
) -> int:
    """Collect triangles of the pairs `pair`, `pair` + 1, ...; return the first pair left out.

    The pairs, up to `stop` - 1, have the same vertex i < j. target: vertex j of each pair;
    lists: start and end of each j's list, and the apexes of all lists; sees (n,): flags of the
    vertices that i sees. Writes the coordinates of vertices k and j of each triangle to `corners`,
    the index of k in the lists to `entries`, and the number of triangles up to each pair to `ends`.
    """
    first, end, apex = lists
    bx, by, cx, cy = corners[2], corners[3], corners[4], corners[5]
    count, number = 0, 0
    while pair < stop and count < _BLOCK_TRIANGLES:
        j = target[pair]
        x, y = points[j, 0], points[j, 1]
        for r in range(first[j], end[j]):
            k = apex[r]
            entries[count], bx[count], by[count] = r, points[k, 0], points[k, 1]
            cx[count], cy[count] = x, y
            count += sees[k]
        ends[number] = count
        number += 1
        pair += 1
    return pair
