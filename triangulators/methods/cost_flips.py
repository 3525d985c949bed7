"""Flips that decrease a cost; for expected quads also pairs of flips (order: ports/ORDER.md).

A pair flips a diagonal, which alone may increase the cost, then a side of the quadrilateral. Pairs
double the time, and save another 1 to 12 % of the helper lanes in four scenes at 1024 px.
"""

from typing import Any

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost, cost_at
from triangulators.criteria.criterion import FEATURES
from triangulators.geometry.flips import flip_edge, is_convex, push_diagonals
from triangulators.geometry.half_edges import next_edge, previous_edge

_SLACK = 1e-12  # a gain below this share of the costs may be a rounding error, and is ignored
_QUADS = FEATURES.index("expected_quads")


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
