"""Local search for any cost, in place: windows that are optimised exactly, and flips.

Windows. A window is a tree of adjacent triangles, unfolded into a simple polygon (see
`half_edges`). A ring of up to 48 triangles is one window, which gives its optimum. Other windows
have up to 28 triangles, of which 15 may be in earlier windows: windows that overlap freely have 2.2
times the triangles of a polygon with holes. On a scene of dense windows (cad), 48 triangles with 20
in earlier windows take 1.2 times as long for the same result. Time and memory are linear.

Flips. For expected quads also pairs of flips are tried (order: ports/ORDER.md). A pair flips a
diagonal, which alone may increase the cost, then a side of the quadrilateral. Pairs double the
time, and save another 1 to 12 % of the helper lanes in four scenes at 1024 px.
"""

from typing import Any

import numpy as np

from triangulators.compute.kernels import copy_row, copy_rows, njit
from triangulators.criteria.cost import Cost, cost_at
from triangulators.criteria.criterion import FEATURES
from triangulators.geometry.flips import flip_edge, is_convex, push_diagonals
from triangulators.geometry.half_edges import (
    grow_tree,
    link_half_edges,
    next_edge,
    previous_edge,
    replace_tree_triangles,
    unfold_tree,
)
from triangulators.geometry.visibility import find_visible_pairs
from triangulators.optimum.any_cost import solve_any_cost

MAX_RING_TRIANGLES = 48
_WINDOW_TRIANGLES = 28
_MAX_OVERLAP = 15  # triangles of a window that are in earlier windows
_SLACK = 1e-12  # a gain below this share of the costs may be a rounding error, and is ignored
_QUADS = FEATURES.index("expected_quads")


@njit(nogil=True)
def _optimise_ring(points: np.ndarray, triangles: np.ndarray, twin: np.ndarray, cost: Cost) -> bool:
    """Replace the triangles of a single ring, of either orientation, by its optimum, in place.

    Returns False, without a change, if the polygon has holes or its ring touches itself. The
    vertices are the cycle of the dynamic program, so nothing needs to be unfolded.
    """
    n = len(points)
    if len(triangles) != n - 2:
        return False
    corner, ascending, descending = triangles.reshape(-1), 0, 0
    for e in range(len(corner)):
        if twin[e // 3, e % 3] < 0:
            ascending += corner[next_edge(e)] == (corner[e] + 1) % n
            descending += corner[e] == (corner[next_edge(e)] + 1) % n
    is_reversed = descending == n
    if ascending < n and not is_reversed:
        return False  # a ring that touches itself: triangles have one vertex for several
    if is_reversed:
        points = points[::-1].copy()
        _reverse_vertices(corner, n)
    start, target = find_visible_pairs(points, triangles, twin)
    better = solve_any_cost(start, target, points, cost)
    if len(better) == len(triangles):
        copy_rows(better, triangles)
        copy_row(link_half_edges(corner), twin.reshape(-1))
    if is_reversed:
        _reverse_vertices(corner, n)
    return True


@njit(nogil=True)
def _reverse_vertices(corner: np.ndarray, count: int) -> None:
    for e in range(len(corner)):
        corner[e] = count - 1 - corner[e]


@njit(nogil=True)
def optimise_windows(
    points: np.ndarray, triangles: np.ndarray, twin: np.ndarray, cost: Cost
) -> bool:
    """Replace windows by their optima, in place; no replacement increases the cost.

    Returns True if the result is the optimum: one window is the full polygon, without cuts.
    triangles, twin: (m, 3), see `half_edges`. Windows grow breadth first from the triangles that
    are in no window yet, in ascending order.
    """
    count = len(triangles)
    if count <= MAX_RING_TRIANGLES and _optimise_ring(points, triangles, twin, cost):
        return True
    tree, rows = np.zeros((count, 3), dtype=np.bool_), np.empty(_WINDOW_TRIANGLES, dtype=np.int32)
    visited, covered = np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
    position_of = np.full(3 * count, -1, dtype=np.int32)
    for root in range(count):
        if covered[root]:
            continue
        size = grow_tree(twin, root, False, 0, tree, rows, visited, covered, _MAX_OVERLAP)
        window = rows[:size]
        cycle, local, outline = unfold_tree(triangles, twin, tree, root, size)
        for row in window:
            covered[row] = True
            for e in range(3):
                tree[row, e] = False
        if size == 1:
            continue
        corners = points[cycle]
        local_twin = link_half_edges(local.reshape(-1)).reshape(-1, 3)
        start, target = find_visible_pairs(corners, local, local_twin)
        better = solve_any_cost(start, target, corners, cost)
        if len(better) == size:
            replace_tree_triangles(triangles, twin, window, cycle, outline, better, position_of)
        if size == count:
            return len(cycle) == len(points)  # no vertex occurs twice: without cuts
    return False


@njit(nogil=True)
def _is_certainly_less(new: float, old: float) -> bool:
    return new < old - _SLACK * (abs(old) + abs(new))


@njit(nogil=True)
def flip_by_cost(
    points: np.ndarray, scaled: np.ndarray, corner: np.ndarray, twin: np.ndarray, cost: Cost
) -> int:
    """Flip in place until no flip decreases a cost of `scaled` (n, 2), in px; return the number."""
    stack, waiting = np.empty(len(corner), dtype=np.int32), np.zeros(len(corner), dtype=np.bool_)
    size = push_diagonals(twin, stack, waiting)
    # Each cost is stored when the triangle appears, so the sum decreases in spite of rounding.
    costs = np.empty(len(corner) // 3)
    for t in range(len(costs)):
        costs[t] = cost_at(scaled, corner[3 * t], corner[3 * t + 1], corner[3 * t + 2], cost)
    flips = 0
    while size > 0:
        size -= 1
        e: Any = np.int64(stack[size])
        waiting[e] = False
        f: Any = np.int64(twin[e])
        if f < 0:
            continue
        e2, f2 = previous_edge(e), previous_edge(f)
        a, b, c, d = corner[e2], corner[e], corner[f], corner[f2]
        if not is_convex(points, a, b, c, d):
            continue
        old = costs[e // 3] + costs[f // 3]
        below, above = cost_at(scaled, a, b, d, cost), cost_at(scaled, a, d, c, cost)
        if _is_certainly_less(below + above, old):
            flips += 1
            costs[f // 3], costs[e // 3] = below, above
            size = flip_edge(corner, twin, e, stack, waiting, size)
            continue
        if cost.weights[_QUADS] == 0.0:
            continue
        # For each side of the quadrilateral: the side's half-edge before and after the flip of e,
        # the third vertex of the new triangle at the side, and the cost of the other new triangle.
        max_gain, side, left, right = 0.0, e, 0.0, 0.0
        for before, after, third, other in (
            (f2, e, a, below),
            (e2, f, d, above),
            (next_edge(e), next_edge(e), d, below),
            (next_edge(f), next_edge(f), a, above),
        ):
            g: Any = np.int64(twin[before])
            if g < 0:
                continue
            tail, head, apex = corner[before], corner[g], corner[previous_edge(g)]
            if not is_convex(points, third, tail, head, apex):
                continue
            first = cost_at(scaled, third, tail, apex, cost)
            second = cost_at(scaled, third, apex, head, cost)
            total, new = old + costs[g // 3], other + first + second
            if _is_certainly_less(new, total) and total - new > max_gain:
                max_gain, side, left, right = total - new, after, first, second
        if max_gain > 0.0:
            flips += 2
            costs[f // 3], costs[e // 3] = below, above
            size = flip_edge(corner, twin, e, stack, waiting, size)
            g = np.int64(twin[side])
            costs[g // 3], costs[side // 3] = left, right
            size = flip_edge(corner, twin, side, stack, waiting, size)
    return flips
