"""The optimum of a small polygon with holes: the best of all ways to cut it into one ring.

The polygon's angle at the leftmost vertex of all holes is open to the left and exceeds 180 degrees,
while a triangle's angle is less, so every triangulation has a diagonal from this vertex to a vertex
further left, which belongs to no hole. A cut along that diagonal joins the hole with the ring
around it, with two more vertices. After one cut per hole a single ring remains, whose optimum
`full_table` finds. So the minimum over all choices of cuts is the optimum. Of leftmost, rightmost,
highest and lowest vertex, each step uses the one with the fewest possible cuts.

Rejected: computing the costs of vertex pairs that are the same for all cuts of a hole once, to copy
them. The dynamic program from scratch takes less time than completing a copy.
"""

import numpy as np

from triangulators.compute.kernels import FAST_MATH_FLAGS, copy_row, copy_rows, fmin, njit
from triangulators.geometry.order import put_in_walk_order
from triangulators.geometry.predicates import ORIENTATION_FILTER, find_bounding_box, find_grid_unit
from triangulators.optimum.full_table import MAX_SMALL_VERTICES, solve_ring, weigh_diagonal
from triangulators.polygon import orient_rings

MAX_HOLES = 3
_MAX_CUTS = 250  # maximum number of rings to triangulate, one for each way to cut all holes
# Relative to the polygon's span: rings nearer to each other may touch, which is unsupported.
_MIN_DISTANCE = 1e-9


@njit(nogil=True)
def solve_by_cuts(
    points: np.ndarray, ring_offsets: np.ndarray, box: np.ndarray, triangles: np.ndarray
) -> bool:
    """Write the triangulation of minimum cost of a polygon with holes to `triangles`.

    Rings have either orientation, the exterior is first; triangles (n + 2h - 2, 3): in walk order.
    False if unsupported: too large, rings that touch, more than `_MAX_CUTS` cuts, or no result.
    """
    n, holes = len(points), len(ring_offsets) - 2
    ring_size = n + 2 * holes
    if ring_size > MAX_SMALL_VERTICES or holes > MAX_HOLES or _do_rings_touch(points, ring_offsets):
        return False
    _, _, w, h = find_bounding_box(points)
    # Bound of a determinant's rounding error: its products are below the span's square.
    doubt = 0.0 if find_grid_unit(points) > 0.0 else 4.0 * ORIENTATION_FILTER * max(w, h) ** 2
    ring = orient_rings(points, ring_offsets)
    cycle = np.empty((holes + 1, ring_size), dtype=np.int32)  # at each depth, the ring cut so far
    copy_row(ring[: ring_offsets[1]], cycle[0])
    size = np.empty(holes + 1, dtype=np.int64)
    size[0] = ring_offsets[1]
    merged = np.zeros((holes + 1, holes + 1), dtype=np.bool_)  # at each depth, the merged holes
    cut_ends = np.empty((holes, ring_size), dtype=np.int32)
    count = np.full(holes, -1, dtype=np.int64)  # number of cut ends; -1: not searched yet
    taken = np.zeros(holes, dtype=np.int64)
    tip = np.empty(holes, dtype=np.int64)
    local = np.empty((ring_size - 2, 3), dtype=np.int32)
    min_cost, cuts, depth = np.inf, 0, 0
    while depth >= 0:
        around = cycle[depth, : size[depth]]
        if count[depth] < 0:
            ends, vertex = cut_ends[depth], tip[depth : depth + 1]
            count[depth] = _find_cut_ends(
                points, ring_offsets, ring, around, merged[depth], doubt, ends, vertex
            )
            taken[depth] = 0
        if taken[depth] == count[depth]:
            count[depth] = -1
            depth -= 1
            continue
        position = cut_ends[depth, taken[depth]]
        taken[depth] += 1
        hole = _join_hole(ring_offsets, ring, around, position, tip[depth], cycle[depth + 1])
        if depth + 1 < holes:
            size[depth + 1] = size[depth] + ring_offsets[hole + 1] - ring_offsets[hole] + 2
            copy_row(merged[depth], merged[depth + 1])
            merged[depth + 1, hole] = True
            depth += 1
            continue
        cuts += 1
        if cuts > _MAX_CUTS:
            return False
        cost = solve_ring(points[cycle[holes]], box, local)
        # A cut is a side of the ring, which has no cost, but a diagonal of the polygon.
        for level in range(holes):
            a, b = cycle[level + 1, 0], ring[tip[level]]
            cost += weigh_diagonal(points[a, 0] - points[b, 0], points[a, 1] - points[b, 1], box)
        if cost < min_cost:
            min_cost = cost
            for row in range(ring_size - 2):
                for e in range(3):
                    triangles[row, e] = cycle[holes, local[row, e]]
    if min_cost < np.inf:
        copy_rows(put_in_walk_order(triangles, n), triangles)
    return min_cost < np.inf


@njit(nogil=True)
def _join_hole(
    ring_offsets: np.ndarray,
    ring: np.ndarray,
    cycle: np.ndarray,
    position: int,
    tip: int,
    merged: np.ndarray,
) -> int:
    """Cut a polygon along a diagonal, write the joined cycle to `merged`; return the hole."""
    hole = 1
    while tip >= ring_offsets[hole + 1]:
        hole += 1
    start, length = ring_offsets[hole], ring_offsets[hole + 1] - ring_offsets[hole]
    size = len(cycle)
    for k in range(size + 1):
        merged[k] = cycle[(position + k) % size]
    for k in range(length + 1):
        merged[size + 1 + k] = ring[start + (tip - start + k) % length]
    return hole


@njit(nogil=True)
def _find_cut_ends(
    points: np.ndarray,
    ring_offsets: np.ndarray,
    ring: np.ndarray,
    cycle: np.ndarray,
    merged: np.ndarray,
    doubt: float,
    cut_ends: np.ndarray,
    tip: np.ndarray,
) -> int:
    """Write to `cut_ends` the indices in `cycle` at which a cut may end; return their number.

    Cuts start at index tip[0] of `ring`, an output: the furthest vertex of unmerged holes in the
    direction with the fewest cuts. Diagonal directions need exact sums of coordinates (`doubt` 0).
    """
    edges = _list_blocking_edges(points, ring_offsets, ring, cycle, merged)
    min_count = len(cycle) + 1
    positions = np.empty(len(cycle), dtype=np.int32)
    for direction in range(8 if doubt == 0.0 else 4):
        best, limit = _find_furthest_vertex(points, ring_offsets, ring, merged, direction)
        x, y = points[ring[best], 0], points[ring[best], 1]
        count = 0
        for position in range(len(cycle)):
            ax, ay = points[cycle[position], 0], points[cycle[position], 1]
            if _project_on_direction(ax, ay, direction) < limit and not _is_blocked(
                edges, x, y, ax, ay, doubt
            ):
                positions[count] = position
                count += 1
                if count == min_count:
                    break
        if 0 < count < min_count:
            min_count = count
            tip[0] = best
            copy_row(positions[:count], cut_ends)
    return min_count if min_count <= len(cycle) else 0


@njit(nogil=True)
def _project_on_direction(x: float, y: float, direction: int) -> float:
    """Return a point's distance against a direction (0 to 7): the furthest point has the lowest."""
    along = x if direction % 4 < 2 else y
    if direction >= 4:
        along = x + y if direction < 6 else x - y
    return along if direction % 2 == 0 else -along


@njit(nogil=True)
def _find_furthest_vertex(
    points: np.ndarray,
    ring_offsets: np.ndarray,
    ring: np.ndarray,
    merged: np.ndarray,
    direction: int,
) -> tuple[int, float]:
    furthest, min_along = -1, 0.0
    for hole in range(1, len(ring_offsets) - 1):
        if not merged[hole]:
            for k in range(ring_offsets[hole], ring_offsets[hole + 1]):
                along = _project_on_direction(points[ring[k], 0], points[ring[k], 1], direction)
                if furthest < 0 or along < min_along:
                    furthest, min_along = k, along
    return furthest, min_along


@njit(nogil=True)
def _list_blocking_edges(
    points: np.ndarray,
    ring_offsets: np.ndarray,
    ring: np.ndarray,
    cycle: np.ndarray,
    merged: np.ndarray,
) -> np.ndarray:
    """Return the edges that may block a cut, (4, e): x and y of the start and of the end."""
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


@njit(nogil=True, fastmath=FAST_MATH_FLAGS)
def _is_blocked(edges: np.ndarray, x: float, y: float, ax: float, ay: float, doubt: float) -> bool:
    """Whether the segment from x, y to ax, ay certainly crosses an edge in the interior of both.

    The ends of each are then on different sides of the other, by more than `doubt`. For an invalid
    cut that touches an edge or is in doubt, the dynamic program finds no triangulation.
    """
    dx, dy = ax - x, ay - y
    min_crossing = 0.0
    for k in range(edges.shape[1]):
        cx, cy = edges[0, k] - x, edges[1, k] - y
        ex, ey = edges[2, k] - x, edges[3, k] - y
        begin, end = dx * cy - dy * cx, dx * ey - dy * ex
        from_start = cx * ey - cy * ex
        from_end = (edges[2, k] - edges[0, k]) * (ay - edges[1, k])
        from_end -= (edges[3, k] - edges[1, k]) * (ax - edges[0, k])
        below = max(min(begin, end), min(from_start, from_end))
        above = min(max(begin, end), max(from_start, from_end))
        min_crossing = fmin(min_crossing, max(below, -above))
    return min_crossing < -doubt


@njit(nogil=True)
def _do_rings_touch(points: np.ndarray, ring_offsets: np.ndarray) -> bool:
    n = len(points)
    span = 0.0
    for k in range(n):
        span = max(span, abs(points[k, 0] - points[0, 0]), abs(points[k, 1] - points[0, 1]))
    near = _MIN_DISTANCE * span
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
                box_distance = max(low_x - x, x - high_x, low_y - y, y - high_y)
                if box_distance <= near and not start <= v < end:
                    off = (x - points[c, 0]) * dy - (y - points[c, 1]) * dx
                    if abs(off) <= near * length:
                        return True
    return False
