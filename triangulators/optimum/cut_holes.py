"""The optimum of a small polygon with holes: the best of all ways to cut it into one ring.

Take a hole's vertex that lies further to the left than any other vertex of a hole. The polygon's
angle there opens to the left by more than 180 degrees and a triangle's is less, so every
triangulation has a diagonal from it to a vertex further left, which is none of a hole. Cut along
that diagonal the hole becomes a part of the ring around it, which takes two corners more. After as
many cuts as there are holes one ring is left, and its optimum is a table's (`full_table`). So the
least over all choices of cuts is the optimum, and nothing else is.

To the right, up and down the same holds, so at each step the direction with the fewest diagonals
is taken. They are few for one or two holes; beyond `_MOST_CUTS` rings it is left to others.

Tried without gain: filling once what the tables of one hole's cuts have in common, the pairs of
corners around it. A ring's table takes less than what is left to be filled for each cut.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.compute.operations import FAST, copy_row, copy_rows, fmin
from triangulators.geometry.order import walk
from triangulators.geometry.predicates import FILTER, box_of, grid_unit
from triangulators.optimum.full_table import SMALL, by_full_table, weight
from triangulators.polygon import wound

MOST_HOLES = 3
_MOST_CUTS = 250  # rings to triangulate at most
_NEAR = 1e-9  # of the span: rings nearer than that are left to those who know what touching means


@njit(nogil=True)
def by_cuts(
    points: np.ndarray, ring_offsets: np.ndarray, box: np.ndarray, triangles: np.ndarray
) -> bool:
    """Triangulate a polygon with holes at least cost; False if that is not for here.

    points (n, 2), ring_offsets (h + 2,): rings of either orientation, the exterior first; box:
    coefficients of half-perimeter, bounding-box area and edge length; triangles (n + 2h - 2, 3),
    which are left in the order of `order.walk`. False if rings touch, if there are too many cuts,
    or if none was found.
    """
    n, holes = len(points), len(ring_offsets) - 2
    most = n + 2 * holes
    if most > SMALL or holes > MOST_HOLES or _rings_touch(points, ring_offsets):
        return False
    _, _, w, h = box_of(points)
    # The filter's bound is a multiple of two products, each below the span's square.
    doubt = 0.0 if grid_unit(points) > 0.0 else 4.0 * FILTER * max(w, h) ** 2
    ring = wound(points, ring_offsets)
    cycle = np.empty((holes + 1, most), dtype=np.int32)  # at each depth, that around what is left
    copy_row(ring[: ring_offsets[1]], cycle[0])
    size = np.empty(holes + 1, dtype=np.int64)
    size[0] = ring_offsets[1]
    merged = np.zeros((holes + 1, holes + 1), dtype=np.bool_)  # at each depth, which holes
    bridges = np.empty((holes, most), dtype=np.int32)
    count = np.full(holes, -1, dtype=np.int64)  # of bridges; -1: not looked for yet
    taken = np.zeros(holes, dtype=np.int64)
    tip = np.empty(holes, dtype=np.int64)
    found = np.empty((most - 2, 3), dtype=np.int32)
    least, cuts, depth = np.inf, 0, 0
    while depth >= 0:
        around = cycle[depth, : size[depth]]
        if count[depth] < 0:
            ways, own = bridges[depth], tip[depth : depth + 1]
            count[depth] = _bridges(
                points, ring_offsets, ring, around, merged[depth], doubt, ways, own
            )
            taken[depth] = 0
        if taken[depth] == count[depth]:
            count[depth] = -1
            depth -= 1
            continue
        place = bridges[depth, taken[depth]]
        taken[depth] += 1
        hole = _merge(ring_offsets, ring, around, place, tip[depth], cycle[depth + 1])
        if depth + 1 < holes:
            size[depth + 1] = size[depth] + ring_offsets[hole + 1] - ring_offsets[hole] + 2
            copy_row(merged[depth], merged[depth + 1])
            merged[depth + 1, hole] = True
            depth += 1
            continue
        cuts += 1
        if cuts > _MOST_CUTS:
            return False
        cost = by_full_table(points[cycle[holes]], box, found)
        for level in range(holes):  # a cut is a side of the ring, but a diagonal of the polygon
            a, b = cycle[level + 1, 0], ring[tip[level]]
            cost += weight(points[a, 0] - points[b, 0], points[a, 1] - points[b, 1], box)
        if cost < least:
            least = cost
            for row in range(most - 2):
                for e in range(3):
                    triangles[row, e] = cycle[holes, found[row, e]]
    if least < np.inf:
        copy_rows(walk(triangles, n), triangles)
    return least < np.inf


@njit(nogil=True)
def _merge(
    ring_offsets: np.ndarray,
    ring: np.ndarray,
    cycle: np.ndarray,
    place: int,
    tip: int,
    merged: np.ndarray,
) -> int:
    """Write a cycle with a hole cut into it at a place; return the hole's number."""
    hole = 1
    while tip >= ring_offsets[hole + 1]:
        hole += 1
    start, length = ring_offsets[hole], ring_offsets[hole + 1] - ring_offsets[hole]
    size = len(cycle)
    for k in range(size + 1):
        merged[k] = cycle[(place + k) % size]
    for k in range(length + 1):
        merged[size + 1 + k] = ring[start + (tip - start + k) % length]
    return hole


@njit(nogil=True)
def _bridges(
    points: np.ndarray,
    ring_offsets: np.ndarray,
    ring: np.ndarray,
    cycle: np.ndarray,
    merged: np.ndarray,
    doubt: float,
    bridges: np.ndarray,
    tip: np.ndarray,
) -> int:
    """Write the places of the cycle where a cut may end; return how many.

    The cut starts at the vertex ring[tip[0]] of a hole that is not merged, the furthest in the
    direction that leaves the fewest. Slanted directions are looked at too where sums of
    coordinates are exact, which they are where nothing is in doubt.
    """
    edges = _edges(points, ring_offsets, ring, cycle, merged)
    fewest = len(cycle) + 1
    places = np.empty(len(cycle), dtype=np.int32)
    for direction in range(8 if doubt == 0.0 else 4):
        best, limit = _furthest(points, ring_offsets, ring, merged, direction)
        x, y = points[ring[best], 0], points[ring[best], 1]
        count = 0
        for place in range(len(cycle)):
            ax, ay = points[cycle[place], 0], points[cycle[place], 1]
            if _along(ax, ay, direction) < limit and not _blocked(edges, x, y, ax, ay, doubt):
                places[count] = place
                count += 1
                if count == fewest:
                    break
        if 0 < count < fewest:
            fewest = count
            tip[0] = best
            copy_row(places[:count], bridges)
    return fewest if fewest <= len(cycle) else 0


@njit(nogil=True)
def _along(x: float, y: float, direction: int) -> float:
    """Return how far against one of eight directions a point lies."""
    along = x if direction % 4 < 2 else y
    if direction >= 4:
        along = x + y if direction < 6 else x - y
    return along if direction % 2 == 0 else -along


@njit(nogil=True)
def _furthest(
    points: np.ndarray,
    ring_offsets: np.ndarray,
    ring: np.ndarray,
    merged: np.ndarray,
    direction: int,
) -> tuple[int, float]:
    """Return the place in `ring` of the furthest vertex of what is not merged, and `_along`."""
    best, least = -1, 0.0
    for hole in range(1, len(ring_offsets) - 1):
        if not merged[hole]:
            for k in range(ring_offsets[hole], ring_offsets[hole + 1]):
                here = _along(points[ring[k], 0], points[ring[k], 1], direction)
                if best < 0 or here < least:
                    best, least = k, here
    return best, least


@njit(nogil=True)
def _edges(
    points: np.ndarray,
    ring_offsets: np.ndarray,
    ring: np.ndarray,
    cycle: np.ndarray,
    merged: np.ndarray,
) -> np.ndarray:
    """Return x and y of where edges begin and of where they end, (4, e): what may block a cut."""
    edges = np.empty((4, len(cycle) + len(ring)))
    count = len(cycle)
    for k in range(count):
        a, b = cycle[k], cycle[k + 1 if k + 1 < count else 0]
        edges[0, k], edges[1, k] = points[a, 0], points[a, 1]
        edges[2, k], edges[3, k] = points[b, 0], points[b, 1]
    for hole in range(1, len(ring_offsets) - 1):
        if not merged[hole]:
            start, end = ring_offsets[hole], ring_offsets[hole + 1]
            for k in range(start, end):
                a, b = ring[k], ring[k + 1 if k + 1 < end else start]
                edges[0, count], edges[1, count] = points[a, 0], points[a, 1]
                edges[2, count], edges[3, count] = points[b, 0], points[b, 1]
                count += 1
    return edges[:, :count]


@njit(nogil=True, fastmath=FAST)
def _blocked(edges: np.ndarray, x: float, y: float, ax: float, ay: float, doubt: float) -> bool:
    """Whether the open segment from x, y to ax, ay surely crosses an edge, inside both.

    It does if both ends of either are on different sides of the other, by determinants of more
    than `doubt`. What merely touches is not looked for, nor what is in doubt: then no
    triangulation of the ring will be found.
    """
    dx, dy = ax - x, ay - y
    least = 0.0
    for k in range(edges.shape[1]):
        cx, cy = edges[0, k] - x, edges[1, k] - y
        ex, ey = edges[2, k] - x, edges[3, k] - y
        begin, end = dx * cy - dy * cx, dx * ey - dy * ex
        here = cx * ey - cy * ex
        there = (edges[2, k] - edges[0, k]) * (ay - edges[1, k])
        there -= (edges[3, k] - edges[1, k]) * (ax - edges[0, k])
        below, above = (
            max(min(begin, end), min(here, there)),
            min(max(begin, end), max(here, there)),
        )
        least = fmin(least, max(below, -above))
    return least < -doubt


@njit(nogil=True)
def _rings_touch(points: np.ndarray, ring_offsets: np.ndarray) -> bool:
    """Whether a vertex of one ring lies on an edge of another, or too near to tell."""
    n = len(points)
    span = 0.0
    for k in range(n):
        span = max(span, abs(points[k, 0] - points[0, 0]), abs(points[k, 1] - points[0, 1]))
    near = _NEAR * span
    for number in range(len(ring_offsets) - 1):
        start, end = ring_offsets[number], ring_offsets[number + 1]
        for c in range(start, end):
            d = c + 1 if c + 1 < end else start
            dx, dy = points[d, 0] - points[c, 0], points[d, 1] - points[c, 1]
            low_x, high_x = min(points[c, 0], points[d, 0]), max(points[c, 0], points[d, 0])
            low_y, high_y = min(points[c, 1], points[d, 1]), max(points[c, 1], points[d, 1])
            length = abs(dx) + abs(dy)
            for v in range(n):
                x, y = points[v, 0], points[v, 1]
                beside = max(low_x - x, x - high_x, low_y - y, y - high_y)
                if beside <= near and not start <= v < end:
                    off = (x - points[c, 0]) * dy - (y - points[c, 1]) * dx
                    if abs(off) <= near * length:
                        return True
    return False
