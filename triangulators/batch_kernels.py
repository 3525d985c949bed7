"""Compiled parts of `batch`: what is done for each polygon, without holding the GIL."""

import numpy as np
from numba import njit

from triangulators.dense import fill_box_table, trace_box_table
from triangulators.features import bbox_area, edge_length, half_perimeter
from triangulators.order import walk_of
from triangulators.predicates import orient, turn
from triangulators.unfold import fold_back, grow, neighbours_of, unfold

SMALL = 192  # corners up to which the table is used
_CUTS = 4  # choices of cuts tried on a polygon with holes


@njit(cache=True, nogil=True)
def on_pixel_grid(points: np.ndarray) -> bool:
    """Whether all coordinates are multiples of 1/256 below 2^14."""
    for value in points.ravel():
        if value * 256.0 != np.rint(value * 256.0) or abs(value) >= 16384.0:
            return False
    return True


@njit(cache=True, nogil=True)
def one_ring(
    points: np.ndarray,
    box: np.ndarray,
    table: np.ndarray,
    x: np.ndarray,
    y: np.ndarray,
    triangles: np.ndarray,
) -> bool:
    """Triangulate one ring of either winding into `triangles` (n - 2, 3); False if it failed."""
    n = len(points)
    area = 0.0
    for k in range(n):
        after = points[k + 1] if k + 1 < n else points[0]
        area += (points[k, 0] - points[0, 0]) * (after[1] - points[0, 1])
        area -= (points[k, 1] - points[0, 1]) * (after[0] - points[0, 0])
    for k in range(n):
        source = k if area > 0.0 else n - 1 - k
        x[k], y[k] = points[source, 0], points[source, 1]
    flat = 0.0
    if not on_pixel_grid(points):
        span = max(x[:n].max() - x[:n].min(), y[:n].max() - y[:n].min())
        flat = 16.0 * 2.0**-53 * span * span
    fill_box_table(table, x[:n], y[:n], box, flat)
    if trace_box_table(table, x[:n], y[:n], box, flat, triangles) != n - 2:
        return False
    if flat > 0.0:
        for row in range(n - 2):  # rounding may have gone further than `flat` allows for
            a, b, c = triangles[row, 0], triangles[row, 1], triangles[row, 2]
            if orient(x[a], y[a], x[b], y[b], x[c], y[c]) <= 0.0:
                return False
    if area <= 0.0:
        for row in range(n - 2):
            for e in range(3):
                triangles[row, e] = n - 1 - triangles[row, e]
    return True


@njit(cache=True, nogil=True)
def do_rings(
    first: int,
    last: int,
    coordinates: np.ndarray,
    begins: np.ndarray,
    wanted: np.ndarray,
    box: np.ndarray,
    starts: np.ndarray,
    triangles: np.ndarray,
    done: np.ndarray,
) -> None:
    """Do `one_ring` for each wanted polygon of first..last - 1; mark in `done` which succeeded."""
    table = np.empty((SMALL, SMALL))
    x, y = np.empty(SMALL), np.empty(SMALL)
    for index in range(first, last):
        if wanted[index]:
            done[index] = one_ring(
                coordinates[begins[index] : begins[index + 1]],
                box,
                table,
                x,
                y,
                triangles[starts[index] : starts[index + 1]],
            )


@njit(cache=True, nogil=True)
def _is_triangulation(
    points: np.ndarray, ends: np.ndarray, triangles: np.ndarray, across: np.ndarray
) -> bool:
    """Whether all triangles turn left and what they do not share is the rings' edges, once each."""
    n = len(points)
    following = np.arange(1, n + 1)
    start = 0
    for end in ends:
        following[end - 1] = start
        start = end
    edges = 0
    for row in range(len(triangles)):
        if turn(points, triangles[row, 0], triangles[row, 1], triangles[row, 2]) <= 0.0:
            return False
        for e in range(3):
            if across[row, e] < 0:
                edges += 1
                a, b = triangles[row, e], triangles[row, (e + 1) % 3]
                if following[a] != b and following[b] != a:
                    return False
    return edges == n and len(triangles) == n + 2 * (len(ends) - 1) - 2


@njit(cache=True, nogil=True)
def _optimum_of_piece(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    """The optimum of a simple polygon (n, 2), counter-clockwise; no rows if none was found."""
    n = len(points)
    table = np.empty((n, n))
    x, y = np.empty(n), np.empty(n)
    better = np.empty((n - 2, 3), dtype=np.int32)
    return better if one_ring(points, box, table, x, y, better) else better[:0]


@njit(cache=True, nogil=True)
def _total(points: np.ndarray, triangles: np.ndarray, box: np.ndarray) -> float:
    """Cost of a triangulation; box: coefficients of half-perimeter, box area and edge length."""
    total = 0.0
    for row in range(len(triangles)):
        ax, ay = points[triangles[row, 0], 0], points[triangles[row, 0], 1]
        bx, by = points[triangles[row, 1], 0], points[triangles[row, 1], 1]
        cx, cy = points[triangles[row, 2], 0], points[triangles[row, 2], 1]
        total += box[0] * half_perimeter(ax, ay, bx, by, cx, cy)
        total += box[1] * bbox_area(ax, ay, bx, by, cx, cy)
        if box[2] != 0.0:
            total += box[2] * edge_length(ax, ay, bx, by, cx, cy)
    return total


@njit(cache=True, nogil=True)
def _improve(points: np.ndarray, ends: np.ndarray, triangles: np.ndarray, box: np.ndarray) -> bool:
    """Improve one triangulation in place over a few cuts; False if it is none to begin with."""
    size = len(triangles)
    across = neighbours_of(triangles, len(points))
    if size == 0 or not _is_triangulation(points, ends, triangles, across):
        return False
    tree = np.zeros(across.shape, dtype=np.bool_)
    rows = np.empty(size, dtype=np.int32)
    least = np.inf
    for attempt in range(_CUTS if len(ends) > 1 else 1):
        root = attempt * size // _CUTS
        tree[:] = False
        grow(across, root, size, attempt % 2 == 0, attempt % 3, tree, rows)
        cycle, _, outline = unfold(triangles, across, tree, root, size)
        better = _optimum_of_piece(points[cycle], box)
        if len(better) != size:
            return False
        fold_back(triangles, across, rows, cycle, outline, better)
        total = _total(points, triangles, box)
        if attempt > 0 and total >= least - 1e-12 * abs(least):
            break  # other cuts gained nothing: most likely it is the optimum
        least = total
    return True


@njit(cache=True, nogil=True)
def improve_many(
    first: int,
    last: int,
    coordinates: np.ndarray,
    ring_ends: np.ndarray,
    owners: np.ndarray,
    which: np.ndarray,
    box: np.ndarray,
    triangles: np.ndarray,
    bounds: np.ndarray,
    done: np.ndarray,
) -> None:
    """Improve triangulations first..last - 1 in place; mark in `done` those that were valid.

    which: (q,) polygons, whose rings' ends are `ring_ends[owners[i]:owners[i + 1]]`; bounds
    (q + 1,): where each one's triangles are in `triangles`.
    """
    for task in range(first, last):
        index = which[task]
        start = ring_ends[owners[index] - 1] if owners[index] > 0 else 0
        ends = ring_ends[owners[index] : owners[index + 1]] - start
        points = coordinates[start : start + ends[-1]]
        own = triangles[bounds[task] : bounds[task + 1]]
        done[task] = _improve(points, ends, own, box)
        own[:] = walk_of(own, len(points))
