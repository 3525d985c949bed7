"""The diagonals of a polygon, for `checker`: every pair of sites is tried against the boundary.

A segment is a diagonal if it starts into the interior at both ends and meets no other boundary
edge. Boundary edges are kept by the cells of a grid, and a segment looks only into the cells that
it runs through: which cells is computed with a margin, orientations are exact.
"""

import numpy as np
from numba import njit

from triangulators.predicates import turn


def visible(points: np.ndarray, edges: np.ndarray, site: np.ndarray) -> np.ndarray:
    """Return the diagonals (k, 2) between sites, a < b; edges (b, 2) have the interior left."""
    n = len(points)
    # The corners of the boundary: at a site, edge in and edge out; a site has several where rings
    # touch, and the interior there is what all of them have on their left.
    following = np.full(len(edges), -1, dtype=np.int32)
    ring_start = 0
    for e in range(len(edges)):
        following[e] = e + 1
        if edges[e, 1] == edges[ring_start, 0]:
            following[e] = ring_start
            ring_start = e + 1
    corner_of = np.argsort(edges[:, 1], kind="stable").astype(np.int32)
    first = np.searchsorted(edges[corner_of, 1], np.arange(n + 1))
    cells = max(1, min(512, int(np.sqrt(len(edges) / 2.0))))
    low = points.min(axis=0)
    size = np.maximum(np.ptp(points, axis=0), 1e-300) * (1.0 + 1e-9) / cells
    start, items = _fill(points, edges, low, size, cells)
    order = np.unique(site).astype(np.int32)
    return _diagonals(
        points, edges, following, corner_of, first, order, low, size, cells, start, items
    )


@njit(cache=True)
def _span(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    low: np.ndarray,
    size: np.ndarray,
    cells: int,
    column: int,
) -> tuple[int, int]:
    """Return the first and last row of cells that a segment meets in a column, with a margin."""
    left, right = low[0] + column * size[0], low[0] + (column + 1) * size[0]
    if bx < ax:
        ax, ay, bx, by = bx, by, ax, ay
    y0, y1 = ay, by
    if bx > ax:
        if left > ax:
            y0 = ay + (by - ay) * ((left - ax) / (bx - ax))
        if right < bx:
            y1 = ay + (by - ay) * ((right - ax) / (bx - ax))
    margin = 1e-6 * size[1]
    bottom = int(np.floor((min(y0, y1) - margin - low[1]) / size[1]))
    top = int(np.floor((max(y0, y1) + margin - low[1]) / size[1]))
    return max(0, bottom), min(cells - 1, top)


@njit(cache=True)
def _columns(ax: float, bx: float, low: float, size: float, cells: int) -> tuple[int, int]:
    margin = 1e-6 * size
    first = int(np.floor((min(ax, bx) - margin - low) / size))
    last = int(np.floor((max(ax, bx) + margin - low) / size))
    return max(0, first), min(cells - 1, last)


@njit(cache=True)
def _fill(
    points: np.ndarray, edges: np.ndarray, low: np.ndarray, size: np.ndarray, cells: int
) -> tuple[np.ndarray, np.ndarray]:
    start = np.zeros(cells * cells + 2, dtype=np.int64)
    items = np.empty(0, dtype=np.int32)
    for sweep in range(2):
        for e in range(len(edges)):
            a, b = edges[e, 0], edges[e, 1]
            ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
            first, last = _columns(ax, bx, low[0], size[0], cells)
            for column in range(first, last + 1):
                bottom, top = _span(ax, ay, bx, by, low, size, cells, column)
                for row in range(bottom, top + 1):
                    cell = column * cells + row
                    if sweep == 0:
                        start[cell + 2] += 1
                    else:
                        items[start[cell + 1]] = e
                        start[cell + 1] += 1
        if sweep == 0:
            start = start.cumsum()
            items = np.empty(start[-1], dtype=np.int32)
    return start[:-1].copy(), items


@njit(cache=True)
def _starts_inside(
    points: np.ndarray,
    edges: np.ndarray,
    following: np.ndarray,
    corner_of: np.ndarray,
    first: np.ndarray,
    a: int,
    b: int,
) -> bool:
    """Whether the segment from a to b starts strictly into the interior."""
    for place in range(first[a], first[a + 1]):
        e = corner_of[place]
        before, after = edges[e, 0], edges[following[e], 1]
        left_of_out = turn(points, a, after, b) > 0.0
        left_of_in = turn(points, before, a, b) > 0.0
        convex = turn(points, before, a, after) > 0.0
        if convex:
            if not (left_of_out and left_of_in):
                return False
        elif not (left_of_out or left_of_in):
            # Straight or reflex: left of either side will do, unless it runs along one of them.
            return False
    return True


@njit(cache=True)
def _meets(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the segments a-b and c-d, without a common end, have a point in common."""
    c_side, d_side = turn(points, a, b, c), turn(points, a, b, d)
    if (c_side > 0.0 and d_side > 0.0) or (c_side < 0.0 and d_side < 0.0):
        return False
    a_side, b_side = turn(points, c, d, a), turn(points, c, d, b)
    if (a_side > 0.0 and b_side > 0.0) or (a_side < 0.0 and b_side < 0.0):
        return False
    if c_side == 0.0 and d_side == 0.0:  # on one line
        for axis in range(2):
            if max(points[a, axis], points[b, axis]) < min(points[c, axis], points[d, axis]):
                return False
            if max(points[c, axis], points[d, axis]) < min(points[a, axis], points[b, axis]):
                return False
    return True


@njit(cache=True)
def _clear(
    points: np.ndarray,
    edges: np.ndarray,
    a: int,
    b: int,
    low: np.ndarray,
    size: np.ndarray,
    cells: int,
    start: np.ndarray,
    items: np.ndarray,
) -> bool:
    ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
    first, last = _columns(ax, bx, low[0], size[0], cells)
    step = 1 if bx >= ax else -1  # from a on: what blocks is often near
    for index in range(last - first + 1):
        column = first + index if step > 0 else last - index
        bottom, top = _span(ax, ay, bx, by, low, size, cells, column)
        for row in range(bottom, top + 1):
            cell = column * cells + row
            for place in range(start[cell], start[cell + 1]):
                c, d = edges[items[place], 0], edges[items[place], 1]
                if c == a or c == b or d == a or d == b:  # noqa: SIM109 - for Numba
                    # Edges at an end leave it elsewhere, or the segment would not start inside;
                    # unless one is the segment itself.
                    if (c == a or c == b) and (d == a or d == b):  # noqa: SIM109
                        return False
                    continue
                if _meets(points, a, b, c, d):
                    return False
    return True


@njit(cache=True)
def _diagonals(
    points: np.ndarray,
    edges: np.ndarray,
    following: np.ndarray,
    corner_of: np.ndarray,
    first: np.ndarray,
    order: np.ndarray,
    low: np.ndarray,
    size: np.ndarray,
    cells: int,
    start: np.ndarray,
    items: np.ndarray,
) -> np.ndarray:
    found = np.empty((16 + 4 * len(edges), 2), dtype=np.int32)
    count = 0
    for i in range(len(order)):
        a = order[i]
        for j in range(i + 1, len(order)):
            b = order[j]
            if not _starts_inside(points, edges, following, corner_of, first, a, b):
                continue
            if not _starts_inside(points, edges, following, corner_of, first, b, a):
                continue
            if not _clear(points, edges, a, b, low, size, cells, start, items):
                continue
            if count == len(found):
                found = np.concatenate((found, np.empty_like(found)))
            found[count, 0], found[count, 1] = a, b
            count += 1
    return found[:count]
