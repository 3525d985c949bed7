"""Dense O(n^3) dynamic program over box and edge costs of one ring, microseconds for small rings.

`triangulate`, `triangulate_many` and `dropin` use it for small rings, so that costs are equal, and
`best_way` for larger rings in which most vertices see each other. It tries n^3 / 6 apexes and
stores n^2 numbers.

Source: G. T. Klincsek, "Minimal triangulations of polygonal domains", 1980 (and Gilbert 1979). With
the interior on the left, let cost(i, j) be the minimum cost of the sub-polygon of vertices i to j.
Its side i-j belongs to exactly one triangle, whose apex is some k between them, so

    cost(i, j) = diagonal(i, j) + min over k of cost(i, k) + cost(k, j) + box(i, k, j)

over the k for which i, k, j is counter-clockwise; cost(i, i + 1) = 0.

Loop order. For small polygons the usual innermost loop, over the apex k of a pair (i, j), has few
iterations and ends in a reduction. Here i descends, k ascends, and the innermost loop runs over j:
once cost(i, k) is final, it is pushed into every cost(i, j) beyond it,

    row[j] = min(row[j], cost(i, k) + table[k, j])

for each j > k for which i, k, j is counter-clockwise: an addition and a minimum in each SIMD lane.
A pair (i, k) without a triangulation is skipped. The cost of the diagonal (i, j) is added from a
row filled once for each i; it is NONE if the diagonal does not start into the polygon's angle at i.
Rows are padded to full SIMD registers, and entries left of the main diagonal are NONE: a sum with
NONE is never the minimum, so the loop may begin at a register's first lane.

No visibility is needed: a combinatorial triangulation of the ring whose triangles are all
counter-clockwise is one of the polygon, because its edges add up to the boundary.

Numbers. On a grid (`find_grid_unit`) coordinates become integers. For the half-perimeter only
diagonals have a cost (see `visible_lists`), and sums are exact. If width and height are below 2^15
units (128 px of 1/256), costs and doubled areas fit int32; for larger rings, float64 represents the
same integers. Off the grid the exact predicate decides orientations in doubt.
"""

import math
from typing import Any

import numpy as np

from triangulators.compute.kernels import FAST_MATH_FLAGS, LANES, fmin, njit, update_minimum_costs
from triangulators.geometry.predicates import (
    ORIENTATION_FILTER,
    find_bounding_box,
    find_grid_unit,
    orient,
)
from triangulators.polygon import twice_ring_area
from triangulators.polygon_arrays import Batch

MAX_SMALL_VERTICES = 192  # maximum number of vertices for batches and for polygons with holes
INT32_SPAN = 1 << 15  # width and height below which two products' difference fits int32
_NO_INT: Any = np.int32(1 << 29)  # int32 cost without a triangulation; the sum of three fits int32
# Indices of rows in the int32 workspace of a ring; the cost table begins at row _TABLE.
_X, _Y, _FROM_X, _FROM_Y, _WEIGHT, _ROW, _TABLE = range(7)
_NONE = 1e300  # float64 cost of a sub-polygon without a triangulation
_FAR = 1e30  # x and y of the vertices that pad float64 rows, far from all vertices of a ring


@njit(nogil=True)
def _fill_int_table(space: np.ndarray, n: int, sign: int, base: int) -> None:
    """Fill the cost table of a ring of n integer vertices.

    space: (_TABLE + n, lanes), input: rows _X and _Y. A diagonal costs base + sign * its L1 length:
    sign -1, with base the maximum, maximises lengths with costs that are not negative.
    """
    lanes = space.shape[1]
    for i in range(n):
        for j in range(lanes):
            space[_TABLE + i, j] = _NO_INT
    for i in range(n - 2, -1, -1):
        _fill_rows_of_vertex(space, n, i, sign, base)
        cost, k = np.int32(0), i + 1
        while True:
            if cost < _NO_INT:
                space[_TABLE + i, k] = cost
                numbers = (_ROW, _FROM_X, _FROM_Y, _WEIGHT, _TABLE + k)
                values = (space[_FROM_X, k], space[_FROM_Y, k], cost, _NO_INT)
                for j in range((k + 1) & ~(LANES - 1), lanes, LANES):
                    update_minimum_costs(space, numbers, j, values)
            k += 1
            if k == n:
                break
            cost = space[_ROW, k]


@njit(nogil=True)
def _fill_rows_of_vertex(space: np.ndarray, n: int, i: int, sign: int, base: int) -> None:
    """Fill the workspace rows of vertex i: coordinates relative to i, costs of diagonals from i."""
    x, y = space[_X, i], space[_Y, i]
    before = i - 1 if i > 0 else n - 1
    ox, oy = np.int32(space[_X, i + 1] - x), np.int32(space[_Y, i + 1] - y)
    ix, iy = np.int32(x - space[_X, before]), np.int32(y - space[_Y, before])
    convex = np.int32(ix * oy) > np.int32(iy * ox)
    first = (i + 1) & ~(LANES - 1)
    for j in range(np.uint64(first), np.uint64(space.shape[1])):
        a, b = np.int32(space[_X, j] - x), np.int32(space[_Y, j] - y)
        space[_FROM_X, j], space[_FROM_Y, j], space[_ROW, j] = a, b, _NO_INT
        is_left_of_exit = np.int32(ox * b) > np.int32(oy * a)
        is_left_of_entry = np.int32(ix * b) > np.int32(iy * a)
        # A diagonal starts into the angle at i: left of both sides, or of either if it is reflex.
        inside = (is_left_of_exit & is_left_of_entry) | (
            (is_left_of_exit | is_left_of_entry) & (not convex)
        )
        space[_WEIGHT, j] = np.int32(base + sign * (abs(a) + abs(b))) if inside else _NO_INT
    if i == 0:
        space[_WEIGHT, n - 1] = 0  # (0, n - 1) is a side of the ring, without a cost


@njit(nogil=True)
def _fill_float_table(
    x: np.ndarray, y: np.ndarray, n: int, box: np.ndarray, doubt: float, convex: bool
) -> np.ndarray:
    """Return the cost table of a ring, (n, lanes) float64.

    x, y (lanes,): padded with coordinates far from all vertices; doubt: determinants up to this
    size are evaluated exactly; convex: True to skip orientations, which are all counter-clockwise.
    """
    lanes = len(x)
    table = np.full((n, lanes), _NONE)
    row, side = np.empty(lanes), np.empty(lanes)
    rx, ry = np.empty(lanes), np.empty(lanes)
    number, by_box = np.arange(float(lanes)), box[1]
    for i in range(n - 2, -1, -1):
        for j in range(lanes):
            row[j] = _NONE
            rx[j], ry[j] = x[j] - x[i], y[j] - y[i]
        row[i + 1] = 0.0
        for k in range(i + 1, n):
            cost = row[k]
            if cost >= _NONE:
                continue
            a, b = rx[k], ry[k]
            if k > i + 1 and k - i < n - 1:
                cost += weigh_diagonal(a, b, box)
            table[i, k] = cost
            first = np.uint64((k + 1) & ~(LANES - 1))
            low_x, high_x, low_y, high_y = min(0.0, a), max(0.0, a), min(0.0, b), max(0.0, b)
            if doubt < 0.0 or convex:
                for j in range(first, np.uint64(lanes)):
                    w = max(high_x, rx[j]) - min(low_x, rx[j])
                    h = max(high_y, ry[j]) - min(low_y, ry[j])
                    total = cost + table[k, j] + by_box * (w * h)
                    is_left = (a * ry[j] > b * rx[j]) | convex
                    row[j] = min(row[j], total if is_left else _NONE)
                continue
            if _compute_determinants(number, rx, ry, k, first, side) <= doubt:
                for j in range(k + 1, n):
                    side[j] = orient(x[i], y[i], x[k], y[k], x[j], y[j])
            for j in range(first, np.uint64(lanes)):
                w = max(high_x, rx[j]) - min(low_x, rx[j])
                h = max(high_y, ry[j]) - min(low_y, ry[j])
                total = cost + table[k, j] + by_box * (w * h)
                row[j] = min(row[j], total if side[j] > 0.0 else _NONE)
    return table


@njit(nogil=True)
def _is_convex(x: np.ndarray, y: np.ndarray, n: int) -> bool:
    """Whether a ring is strictly convex: all angles turn left, and x changes direction twice."""
    changes = 0
    for k in range(n):
        before, after = k - 1 if k > 0 else n - 1, k + 1 if k + 1 < n else 0
        if orient(x[before], y[before], x[k], y[k], x[after], y[after]) <= 0.0:
            return False
        changes += (x[k] > x[before]) != (x[after] > x[k])
    return changes == 2


@njit(nogil=True, fastmath=FAST_MATH_FLAGS)
def _compute_determinants(
    number: np.ndarray, rx: np.ndarray, ry: np.ndarray, k: int, first: np.uint64, side: np.ndarray
) -> float:
    """Write the determinants of i, k, j to side[j]; return their minimum size over j > k."""
    a, b, last = rx[k], ry[k], float(k)
    minimum = _NONE
    for j in range(first, np.uint64(len(side))):
        side[j] = a * ry[j] - b * rx[j]
        minimum = fmin(minimum, abs(side[j]) if number[j] > last else _NONE)
    return minimum


@njit(nogil=True)
def weigh_diagonal(dx: float, dy: float, box: np.ndarray) -> float:
    """Return the cost of a diagonal (dx, dy), without box areas; Euclidean lengths count twice."""
    cost: float = box[0] * (abs(dx) + abs(dy))
    if box[2] != 0.0:
        cost += 2.0 * box[2] * math.sqrt(dx * dx + dy * dy)
    return cost


@njit(nogil=True)
def _write_triangles(
    table: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    by_box: float,
    exact: bool,
    sign: int,
    base: int,
    triangles: np.ndarray,
) -> bool:
    """Write the optimum of a cost table; False if there is none. Float costs have sign 0."""
    n, none = len(triangles) + 2, float(_NO_INT) if sign != 0 else _NONE
    stack = np.empty((n, 2), dtype=np.int32)
    stack[0, 0], stack[0, 1] = 0, n - 1
    height, size = 1, 0
    while height > 0:
        height -= 1
        i, j = stack[height, 0], stack[height, 1]
        if j - i < 2:
            continue
        # The apex is found again as the minimum of the same sums. Integer sums are exact, so the
        # search stops at the first sum that equals the table's entry.
        best, apex, target_sum = none, -1, -np.inf
        if sign != 0:
            side = j - i == n - 1
            target_sum = float(table[i, j])
            target_sum -= (
                0.0 if side else float(base + sign * (abs(x[j] - x[i]) + abs(y[j] - y[i])))
            )
        xi, yi, dx, dy = float(x[i]), float(y[i]), float(x[j] - x[i]), float(y[j] - y[i])
        for k in range(i + 1, j):
            if table[i, k] >= none:
                continue
            total = float(table[i, k]) + float(table[k, j])
            if by_box != 0.0:
                w = max(x[i], x[j], x[k]) - min(x[i], x[j], x[k])
                h = max(y[i], y[j], y[k]) - min(y[i], y[j], y[k])
                total += by_box * (w * h)
            if total < best:
                side = (x[k] - xi) * dy - (y[k] - yi) * dx
                if not exact:
                    side = orient(xi, yi, float(x[k]), float(y[k]), float(x[j]), float(y[j]))
                if side > 0.0:
                    best, apex = total, k
                    if total == target_sum:
                        break
        if apex < 0:
            return False
        triangles[size, 0], triangles[size, 1], triangles[size, 2] = j, i, apex
        size += 1
        # The new vertex is last in the row, and the smaller sub-polygon is visited first, as in
        # `put_in_walk_order`.
        smaller = 0 if apex - i > j - apex else 1
        stack[height + smaller, 0], stack[height + smaller, 1] = i, apex
        stack[height + 1 - smaller, 0], stack[height + 1 - smaller, 1] = apex, j
        height += 2
    return True


@njit(nogil=True)
def solve_ring(points: np.ndarray, box: np.ndarray, triangles: np.ndarray) -> float:
    """Write the minimum-cost triangulation of a ring (n, 2) to `triangles` (n - 2, 3).

    box: coefficients of half-perimeter, bounding-box area and edge length, also negative. The ring
    has either orientation; triangles are counter-clockwise, with the new vertex last. Returns the
    cost, up to a constant, or `inf` if the ring is not simple or repeats a vertex.
    """
    n = len(points)
    lanes = (n + LANES - 1) // LANES * LANES
    unit = find_grid_unit(points)
    area = twice_ring_area(points)
    low_x, low_y, w, h = find_bounding_box(points)
    edges_only = box[1] == 0.0 and box[2] == 0.0
    if unit > 0.0 and edges_only and max(w, h) < INT32_SPAN * unit:
        space = np.empty((_TABLE + n, lanes), dtype=np.int32)
        for k in range(n):
            source = k if area > 0.0 else n - 1 - k
            space[_X, k] = np.int32((points[source, 0] - low_x) / unit)
            space[_Y, k] = np.int32((points[source, 1] - low_y) / unit)
        space[_X : _Y + 1, n:] = 0
        sign = 1 if box[0] >= 0.0 else -1
        base = 0 if sign > 0 else int((w + h) / unit)
        _fill_int_table(space, n, sign, base)
        costs, x, y = space[_TABLE:], space[_X], space[_Y]
        if not _write_triangles(costs, x, y, 0.0, True, sign, base, triangles):
            return np.inf
        total = abs(box[0]) * unit * float(costs[0, n - 1])
    else:
        u, v = np.full(lanes, _FAR), np.full(lanes, _FAR)
        for k in range(n):
            source = k if area > 0.0 else n - 1 - k
            u[k], v[k] = points[source, 0], points[source, 1]
        # Bound of a determinant's rounding error: its products are below the span's square.
        doubt = -1.0 if unit > 0.0 else 4.0 * ORIENTATION_FILTER * max(w, h) ** 2
        table = _fill_float_table(u, v, n, box, doubt, unit == 0.0 and _is_convex(u, v, n))
        if not _write_triangles(table, u, v, box[1], unit > 0.0, 0, 0, triangles):
            return np.inf
        total = table[0, n - 1]
    if area <= 0.0:
        for row in range(n - 2):
            for e in range(3):
                triangles[row, e] = n - 1 - triangles[row, e]
    return float(total)


@njit(nogil=True)
def triangulate_rings_optimally(
    first: int, last: int, batch: Batch, selected: np.ndarray, box: np.ndarray
) -> None:
    """Write the optima of the `selected` (p,) polygons among first..last - 1; none has a hole."""
    # Compiled, because a call from Python takes as long as a polygon of ten vertices.
    for index in range(first, last):
        if selected[index]:
            points = batch.coords[batch.vertex_offsets[index] : batch.vertex_offsets[index + 1]]
            triangles = batch.triangles[
                batch.triangle_offsets[index] : batch.triangle_offsets[index + 1]
            ]
            batch.done[index] = solve_ring(points, box, triangles) < np.inf


def solve_by_full_table(points: np.ndarray, box: np.ndarray) -> np.ndarray | None:
    """Return the minimum-cost triangulation (n - 2, 3) of a ring, or None; see `solve_ring`."""
    triangles = np.empty((len(points) - 2, 3), dtype=np.int32)
    return triangles if solve_ring(points, box, triangles) < np.inf else None
