"""Minimum-cost triangulation by interval dynamic programming over a full table.

Source: G. T. Klincsek, "Minimal triangulations of polygonal domains", 1980 (and Gilbert 1979).
No visibility is needed: a combinatorial triangulation of the cycle of vertices whose triangles all
turn left is a triangulation of the polygon, because its edges add up to the boundary.

It is for large polygons and costs that sit on triangles, such as the overdraw; where cost sits on
edges `edge_table` does it, and small rings are done by `small_ring`.

Derivation. With the interior on the left, let cost(i, j) be the least cost of the sub-polygon of
corners i, i + 1, ..., j. Its side i-j belongs to exactly one triangle, whose third corner is some
k between them, so

    cost(i, j) = min over k of cost(i, k) + cost(k, j) + triangle(i, k, j),  cost(i, i + 1) = 0

over the k for which i, k, j turn left. The n - 2 triangles behind cost(0, n - 1) all turn left and
each inner edge is used once in each direction, so as a chain they add up to the boundary, and they
cover the polygon once.

Loop order. i descends and j ascends, so that cost(i, k) and cost(k, j) are known for every k
between. Both are read along k. Stored at [i, j] and at [j, i], cost(k, j) is row j, so both
operands of the inner loop are rows and it reads memory in order. With the cost written as
minima and maxima of coordinates the loop is SIMD throughout, and it keeps no argmin: the few that
are needed are found again on the way back.

Rounding. On a grid (`predicates.on_grid`) differences of coordinates fit 25 bits and products 50,
so the determinant that says left is exact in float64 and `flat` is 0. Off it, `flat` is a bound on
the determinant's error, and what is not sure to turn left is left out.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.compute.simd import fmin

NONE = 1e300  # cost of a sub-polygon that has no triangulation; a sum of two still is finite
_FAST = {"nnan", "nsz", "reassoc", "contract", "arcp"}  # all but the assumption of no infinities


@njit(fastmath=_FAST)
def _best_apex(
    table: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    i: np.uint64,
    j: np.uint64,
    by_half_perimeter: float,
    by_box: float,
    flat: float,
) -> float:
    """Return the minimum over k of table[i, k] + table[j, k] + cost of the triangle i, k, j.

    Unsigned indices spare the test for negative ones, which would stop SIMD; slices instead of
    them cost more than the loop where the polygon is small.
    """
    xi, yi, xj, yj = x[i], y[i], x[j], y[j]
    low_x, high_x = min(xi, xj), max(xi, xj)
    low_y, high_y = min(yi, yj), max(yi, yj)
    dx, dy = xj - xi, yj - yi
    best = NONE
    # Two loads, six minima and maxima, two products: no branch, so that a whole register of apexes
    # is done at once. NONE is a number and not infinity, because fastmath may drop the sum of what
    # is infinite; NONE + NONE is finite and no less than NONE.
    for k in range(i + np.uint64(1), j):
        w = max(high_x, x[k]) - min(low_x, x[k])
        h = max(high_y, y[k]) - min(low_y, y[k])
        cost = table[i, k] + table[j, k] + by_half_perimeter * (w + h) + by_box * (w * h)
        left = (x[k] - xi) * dy - (y[k] - yi) * dx > flat
        best = fmin(best, cost if left else NONE)
    return best


@njit(fastmath=_FAST)
def _mark_inward(
    x: np.ndarray, y: np.ndarray, sides: np.ndarray, i: int, flat: float, inward: np.ndarray
) -> None:
    """Mark the j > i for which the segment i-j starts into the polygon's angles at i and at j.

    sides: (3, n), the vector from each corner to the next, and 1 where the corner is convex. An
    angle contains d if d is left of both its sides, or of either where it is reflex. A segment too
    close to a side to tell is marked.
    """
    n = len(x)
    ux, uy, convex = sides[0], sides[1], sides[2]
    out_x, out_y, in_x, in_y = ux[i], uy[i], ux[i - 1], uy[i - 1]
    for j in range(i + 2, n):
        dx, dy = x[j] - x[i], y[j] - y[i]
        a, b = out_x * dy - out_y * dx, in_x * dy - in_y * dx
        here = min(a, b) if convex[i] > 0.0 else max(a, b)
        c, d = uy[j] * dx - ux[j] * dy, uy[j - 1] * dx - ux[j - 1] * dy
        there = min(c, d) if convex[j] > 0.0 else max(c, d)
        inward[j] = min(here, there) > -abs(flat)


@njit(nogil=True)
def fill_box_table(
    table: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    weights: np.ndarray,
    flat: float,
) -> None:
    """Fill `table` (n, n) with the least cost of each sub-polygon i..j, at [i, j] and [j, i].

    weights: coefficients of half-perimeter, bounding-box area and edge length. A triangle counts
    as turning left if its doubled area exceeds `flat`.
    """
    n = len(x)
    sides = np.empty((3, n))
    for i in range(n):
        after = i + 1 if i + 1 < n else 0
        sides[0, i], sides[1, i] = x[after] - x[i], y[after] - y[i]
    for i in range(n):
        sides[2, i] = sides[0, i - 1] * sides[1, i] - sides[1, i - 1] * sides[0, i] > flat
    inward = np.empty(n, dtype=np.bool_)
    for i in range(n - 1, -1, -1):
        _mark_inward(x, y, sides, i, flat, inward)
        if i == 0:
            inward[n - 1] = True  # the side that closes the polygon
        table[i, i] = 0.0
        if i + 1 < n:
            table[i, i + 1] = table[i + 1, i] = 0.0
        for j in range(i + 2, n):
            if not inward[j]:
                table[i, j] = table[j, i] = NONE
                continue
            best = _best_apex(table, x, y, np.uint64(i), np.uint64(j), weights[0], weights[1], flat)
            if best < NONE and weights[2] != 0.0:
                # A diagonal is an edge of two triangles; the last one closes the polygon.
                best += 2.0 * weights[2] * np.sqrt((x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2)
            table[i, j] = table[j, i] = min(best, NONE)


@njit(nogil=True)
def trace_box_table(
    table: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    weights: np.ndarray,
    flat: float,
    triangles: np.ndarray,
) -> int:
    """Write the n - 2 triangles behind `table` into `triangles`; return how many (0 if none)."""
    n = len(x)
    if table[0, n - 1] >= NONE:
        return 0
    stack = np.empty((n, 2), dtype=np.int32)
    stack[0, 0], stack[0, 1] = 0, n - 1
    height, found = 1, 0
    while height > 0:
        height -= 1
        i, j = stack[height, 0], stack[height, 1]
        if j - i < 2:
            continue
        best, apex = np.inf, -1
        for k in range(i + 1, j):
            if (x[k] - x[i]) * (y[j] - y[i]) - (y[k] - y[i]) * (x[j] - x[i]) <= flat:
                continue
            w = max(x[i], x[j], x[k]) - min(x[i], x[j], x[k])
            h = max(y[i], y[j], y[k]) - min(y[i], y[j], y[k])
            cost = table[i, k] + table[j, k] + weights[0] * (w + h) + weights[1] * (w * h)
            if cost < best:
                best, apex = cost, k
        if apex < 0:
            return 0
        triangles[found, 0], triangles[found, 1], triangles[found, 2] = j, i, apex
        found += 1
        # The new vertex comes last and the smaller side is done first, as `order.walk` has it.
        left = 0 if apex - i > j - apex else 1
        stack[height + left, 0], stack[height + left, 1] = i, apex
        stack[height + 1 - left, 0], stack[height + 1 - left, 1] = apex, j
        height += 2
    return found


def box_optimum(points: np.ndarray, weights: np.ndarray, flat: float) -> np.ndarray | None:
    """Return the optimum (n - 2, 3) of a counter-clockwise cycle of points (n, 2), or None.

    weights: (3,) coefficients of half-perimeter, bounding-box area and edge length. None where no
    triangulation has all triangles thicker than `flat`.
    """
    x, y = np.ascontiguousarray(points.T)
    table = np.empty((len(x), len(x)))
    triangles = np.empty((len(x) - 2, 3), dtype=np.int32)
    fill_box_table(table, x, y, weights, flat)
    found = trace_box_table(table, x, y, weights, flat, triangles)
    return triangles if found == len(triangles) else None
