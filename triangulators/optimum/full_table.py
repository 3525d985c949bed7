"""The optimum of one ring over boxes and edges: a whole table, for small rings in microseconds.

Single calls, batches and the drop-in all come here, so one name gives one cost wherever it is
asked for; and rings of any size where most corners see each other (see `best_way`). Time
grows with the cube of the corners, n^3 / 6 apexes tried; memory is n^2 numbers.

Source: G. T. Klincsek, "Minimal triangulations of polygonal domains", 1980 (and Gilbert 1979). With
the interior on the left, let cost(i, j) be the least cost of the sub-polygon of corners i, i + 1,
..., j. Its side i-j belongs to exactly one triangle, whose third corner is some k between them, so

    cost(i, j) = diagonal(i, j) + min over k of cost(i, k) + cost(k, j) + box(i, k, j)

over the k for which i, k, j turn left; cost(i, i + 1) = 0. What differs here is the order of the
three loops. For small polygons the usual innermost loop, over the apex k of a pair (i, j), has a
few rounds only, and it ends in a reduction. Here corner i is taken in descending order, then k in
ascending order, and the innermost loop runs over j: once cost(i, k) is final, it is pushed into
every cost(i, j) beyond it,
    row[j] = min(row[j], cost(i, k) + table[k, j])

for each j > k for which i, k, j turn left. That is an addition and a minimum in each SIMD lane,
without a reduction. A pair that no triangulation has is skipped together with all that would be
built on it. What the diagonal (i, j) costs is added in the same lane, from a row filled once for
each i, and is NONE where the diagonal does not start into the polygon's angle at i: one comparison,
of which a processor guesses the outcome wrong now and then, tells whether a pair is skipped. Rows
are padded to whole SIMD registers, and what is left of the diagonal is NONE: a sum with it never is
the minimum, so the loop may begin at a register's first lane.

No visibility is needed: a combinatorial triangulation of the ring whose triangles all turn left is
one of the polygon, because its edges add up to the boundary.

Numbers. On a grid (`grid_unit`) coordinates become integers. The half-perimeters of a
triangulation add up to half the L1 length of the boundary plus the L1 lengths of the diagonals, so
cost sits on diagonals and sums are exact. int32 holds them while all spans are below 2^15 units
(128 px of 1/256), where the doubled area of a triangle fits too; beyond, float64 holds the same
integers exactly. Off the grid float64 determinants decide unless they are within Shewchuk's bound
of zero; then the exact predicate does.
"""

import math
from typing import Any

import numpy as np

from triangulators.batch import Batch
from triangulators.compute.kernels import njit
from triangulators.compute.operations import FAST, LANES, fmin, push
from triangulators.geometry.predicates import FILTER, box_of, grid_unit, orient
from triangulators.polygon import twice_ring_area

SMALL = 192  # corners up to which batches and polygons with holes are done by these tables
SPAN = 1 << 15  # int32: |dx * dy'| < 2^30, so that their difference fits
_NO_INT: Any = np.int32(1 << 29)  # no triangulation; the sum of three of them still fits
# Rows in the space of a ring, before those of its table.
_X, _Y, _FROM_X, _FROM_Y, _WEIGHT, _ROW, _TABLE = range(7)
_NONE = 1e300
_FAR = 1e30


@njit(nogil=True)
def _fill_int(space: np.ndarray, n: int, sign: int, base: int) -> None:
    """Fill the table of a ring of n integer corners.

    space: (_TABLE + n, lanes) int32, of which the rows _X and _Y are given, padded, and the others
    are written; the table begins at row _TABLE. A diagonal costs `base` plus `sign` times its L1
    length: with sign -1 and the largest length for a base the longest are found, and no weight is
    negative.
    """
    lanes = space.shape[1]
    for i in range(n):
        for j in range(lanes):
            space[_TABLE + i, j] = _NO_INT
    for i in range(n - 2, -1, -1):
        _weigh(space, n, i, sign, base)
        cost, k = np.int32(0), i + 1
        while True:
            if cost < _NO_INT:
                space[_TABLE + i, k] = cost
                numbers = (_ROW, _FROM_X, _FROM_Y, _WEIGHT, _TABLE + k)
                values = (space[_FROM_X, k], space[_FROM_Y, k], cost, _NO_INT)
                for j in range((k + 1) & ~(LANES - 1), lanes, LANES):
                    push(space, numbers, j, values)
            k += 1
            if k == n:
                break
            cost = space[_ROW, k]


@njit(nogil=True)
def _weigh(space: np.ndarray, n: int, i: int, sign: int, base: int) -> None:
    """Prepare the row of corner i: where the others are from there, and what diagonals cost.

    A diagonal has to start into the polygon's angle at i: left of both its sides, or of either
    where the angle is reflex.
    """
    x, y = space[_X, i], space[_Y, i]
    before = i - 1 if i > 0 else n - 1
    ox, oy = np.int32(space[_X, i + 1] - x), np.int32(space[_Y, i + 1] - y)
    ix, iy = np.int32(x - space[_X, before]), np.int32(y - space[_Y, before])
    convex = np.int32(ix * oy) > np.int32(iy * ox)
    first = (i + 1) & ~(LANES - 1)
    for j in range(np.uint64(first), np.uint64(space.shape[1])):
        a, b = np.int32(space[_X, j] - x), np.int32(space[_Y, j] - y)
        space[_FROM_X, j], space[_FROM_Y, j], space[_ROW, j] = a, b, _NO_INT
        beside, along = np.int32(ox * b) > np.int32(oy * a), np.int32(ix * b) > np.int32(iy * a)
        inside = (beside & along) | ((beside | along) & (not convex))
        space[_WEIGHT, j] = np.int32(base + sign * (abs(a) + abs(b))) if inside else _NO_INT
    if i == 0:
        space[_WEIGHT, n - 1] = 0  # a side, as is the pair (i, i + 1), which nothing is pushed to


@njit(nogil=True)
def _fill_float(
    x: np.ndarray, y: np.ndarray, n: int, box: np.ndarray, doubt: float, convex: bool
) -> np.ndarray:
    """Return the table of a ring, (n, lanes) float64.

    box: coefficients of half-perimeter, bounding-box area and edge length; doubt: determinants of
    no larger size are looked at again, exactly; none if it is negative; convex: whether any three
    corners turn left, so that none is asked for. x, y: float64, padded with what is far from all
    corners.
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
                cost += weight(a, b, box)
            table[i, k] = cost
            first = np.uint64((k + 1) & ~(LANES - 1))
            low_x, high_x, low_y, high_y = min(0.0, a), max(0.0, a), min(0.0, b), max(0.0, b)
            if doubt < 0.0 or convex:
                for j in range(first, np.uint64(lanes)):
                    w = max(high_x, rx[j]) - min(low_x, rx[j])
                    h = max(high_y, ry[j]) - min(low_y, ry[j])
                    total = cost + table[k, j] + by_box * (w * h)
                    left = (a * ry[j] > b * rx[j]) | convex
                    row[j] = min(row[j], total if left else _NONE)
                continue
            if _sides(number, rx, ry, k, first, side) <= doubt:
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
    """Whether a ring of n corners turns left at all of them and goes round once.

    Then every three of its corners, in order, turn left. It goes round once if it turns from right
    to left, and back, once each.
    """
    changes = 0
    for k in range(n):
        before, after = k - 1 if k > 0 else n - 1, k + 1 if k + 1 < n else 0
        if orient(x[before], y[before], x[k], y[k], x[after], y[after]) <= 0.0:
            return False
        changes += (x[k] > x[before]) != (x[after] > x[k])
    return changes == 2


@njit(nogil=True, fastmath=FAST)
def _sides(
    number: np.ndarray, rx: np.ndarray, ry: np.ndarray, k: int, first: np.uint64, side: np.ndarray
) -> float:
    """Write the determinants of i, k, j into side[j] for j from `first` on.

    Returns the least size among those for j > k. number: 0.0, 1.0, ... for each lane.
    """
    a, b, last = rx[k], ry[k], float(k)
    least = _NONE
    for j in range(first, np.uint64(len(side))):
        side[j] = a * ry[j] - b * rx[j]
        least = fmin(least, abs(side[j]) if number[j] > last else _NONE)
    return least


@njit(nogil=True)
def weight(dx: float, dy: float, box: np.ndarray) -> float:
    """What a diagonal costs: it is an edge of two triangles, and so twice half its L1 length."""
    cost: float = box[0] * (abs(dx) + abs(dy))
    if box[2] != 0.0:
        cost += 2.0 * box[2] * math.sqrt(dx * dx + dy * dy)
    return cost


@njit(nogil=True)
def _trace(
    table: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    by_box: float,
    exact: bool,
    sign: int,
    base: int,
    triangles: np.ndarray,
) -> bool:
    """Write the n - 2 triangles behind a table into `triangles`; False if there are none.

    by_box: the coefficient of bounding-box areas; exact: whether float64 determinants are; sign,
    base: of what a diagonal costs (see `_fill_int`), and sign is 0 where sums are floats. No apex
    was kept: the n - 2 that are needed are found again, from the same sums. Where those are
    integers the sum is known, and the first apex that has it will do.
    """
    n, none = len(triangles) + 2, float(_NO_INT) if sign != 0 else _NONE
    stack = np.empty((n, 2), dtype=np.int32)
    stack[0, 0], stack[0, 1] = 0, n - 1
    height, found = 1, 0
    while height > 0:
        height -= 1
        i, j = stack[height, 0], stack[height, 1]
        if j - i < 2:
            continue
        best, apex, wanted = none, -1, -np.inf
        if sign != 0:
            side = j - i == n - 1
            wanted = float(table[i, j])
            wanted -= 0.0 if side else float(base + sign * (abs(x[j] - x[i]) + abs(y[j] - y[i])))
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
                left = (x[k] - xi) * dy - (y[k] - yi) * dx
                if not exact:
                    left = orient(xi, yi, float(x[k]), float(y[k]), float(x[j]), float(y[j]))
                if left > 0.0:
                    best, apex = total, k
                    if total == wanted:
                        break
        if apex < 0:
            return False
        triangles[found, 0], triangles[found, 1], triangles[found, 2] = j, i, apex
        found += 1
        # The new vertex comes last and the smaller side is done first, as `order.walk` has it.
        smaller = 0 if apex - i > j - apex else 1
        stack[height + smaller, 0], stack[height + smaller, 1] = i, apex
        stack[height + 1 - smaller, 0], stack[height + 1 - smaller, 1] = apex, j
        height += 2
    return True


@njit(nogil=True)
def by_full_table(points: np.ndarray, box: np.ndarray, triangles: np.ndarray) -> float:
    """Triangulate one ring (n, 2) of either winding into `triangles` (n - 2, 3) at least cost.

    box: coefficients of half-perimeter, bounding-box area and edge length, which may be negative.
    The triangles turn left, each with the vertex last that the ones before it have not met.
    Returns the cost, up to what all triangulations share; `inf` if none was found: the ring is
    not simple, or has a vertex twice in a row.
    """
    n = len(points)
    lanes = (n + LANES - 1) // LANES * LANES
    unit = grid_unit(points)
    area = twice_ring_area(points)
    low_x, low_y, w, h = box_of(points)
    edges_only = box[1] == 0.0 and box[2] == 0.0
    if unit > 0.0 and edges_only and max(w, h) < SPAN * unit:
        space = np.empty((_TABLE + n, lanes), dtype=np.int32)
        for k in range(n):
            source = k if area > 0.0 else n - 1 - k
            space[_X, k] = np.int32((points[source, 0] - low_x) / unit)
            space[_Y, k] = np.int32((points[source, 1] - low_y) / unit)
        space[_X : _Y + 1, n:] = 0
        sign = 1 if box[0] >= 0.0 else -1
        base = 0 if sign > 0 else int((w + h) / unit)
        _fill_int(space, n, sign, base)
        whole, x, y = space[_TABLE:], space[_X], space[_Y]
        if not _trace(whole, x, y, 0.0, True, sign, base, triangles):
            return np.inf
        total = abs(box[0]) * unit * float(whole[0, n - 1])
    else:
        u, v = np.full(lanes, _FAR), np.full(lanes, _FAR)
        for k in range(n):
            source = k if area > 0.0 else n - 1 - k
            u[k], v[k] = points[source, 0], points[source, 1]
        # The filter's bound is a multiple of two products, each below the span's square.
        doubt = -1.0 if unit > 0.0 else 4.0 * FILTER * max(w, h) ** 2
        table = _fill_float(u, v, n, box, doubt, unit == 0.0 and _is_convex(u, v, n))
        if not _trace(table, u, v, box[1], unit > 0.0, 0, 0, triangles):
            return np.inf
        total = table[0, n - 1]
    if area <= 0.0:
        for row in range(n - 2):
            for e in range(3):
                triangles[row, e] = n - 1 - triangles[row, e]
    return float(total)


@njit(nogil=True)
def do_rings(first: int, last: int, batch: Batch, wanted: np.ndarray, box: np.ndarray) -> None:
    """Triangulate the polygons first..last - 1 that are `wanted` (p,), which have no holes.

    What threads of a batch run: one compiled call does many, so that a polygon of ten corners,
    which takes two microseconds, is not behind a call from Python that takes as long. Neighbours in
    the arrays are done by one thread, so no two of them write to a cache line for long.
    """
    for index in range(first, last):
        if wanted[index]:
            points = batch.coords[batch.vertex_offsets[index] : batch.vertex_offsets[index + 1]]
            own = batch.triangles[batch.triangle_offsets[index] : batch.triangle_offsets[index + 1]]
            batch.done[index] = by_full_table(points, box, own) < np.inf
