"""Exclude edges that no optimum contains, by local minimality (the LMT skeleton).

Source: M. Dickerson and M. Montague, "A (usually?) connected subgraph of the minimum weight
triangulation", 1996.

Let an optimum contain the diagonal a-b, with the triangles a-b-c on its left and b-a-d on its
right. If c-d crosses a-b, then c-b-d and d-a-c are empty triangles too, and putting them in their
place gives another triangulation; so

    weight(abc) + weight(bad) <= weight(cbd... ) that is: <= weight(dbc) + weight(cad).

Nothing is used but that the cost sums over triangles. Therefore an edge goes if every pair of
triangles that are left on its two sides could be flipped to less weight, and with it go the
triangles that have it as a side; that may take others with it, until nothing more goes. With the
noise of `units` there are next to no ties, which would keep both diagonals of a rectangle.
"""

from typing import Any

import numpy as np
from numba import njit

from triangulators.candidates import Candidates
from triangulators.cost import Cost
from triangulators.predicates import turn
from triangulators.units import Units, lowest_first, weight


def exclude(
    candidates: Candidates, weights: np.ndarray, cost: Cost, units: Units
) -> tuple[np.ndarray, np.ndarray]:
    """Return (excluded edges in their order, which triangles (t,) are left).

    weights: (t,) of the triangles, in `units`.
    """
    spans = np.abs(np.diff(candidates.points[candidates.edges], axis=1)).sum(axis=(1, 2))
    queue = np.argsort(-spans, kind="stable")  # long edges go first and take many triangles along
    excluded = np.empty(len(queue), dtype=np.int32)
    alive = np.ones(len(candidates.triangles), dtype=np.bool_)
    how_many = _exclude(
        *candidates, weights, queue, excluded, alive, *cost[:4], units.scale, units.factor, units.bits
    )
    return excluded[:how_many].copy(), alive


@njit(cache=True, nogil=True)
def _exclude(
    points: np.ndarray,
    edges: np.ndarray,
    side: np.ndarray,
    triangles: np.ndarray,
    sides: np.ndarray,
    start: np.ndarray,
    items: np.ndarray,
    value: np.ndarray,
    queue: np.ndarray,
    excluded: np.ndarray,
    alive: np.ndarray,
    weights: np.ndarray,
    function: Any,
    custom: bool,
    sign: float,
    scale: float,
    factor: int,
    bits: int,
) -> int:
    count = len(edges)
    # Where the search for a pair that cannot be improved stands; a pair that can be, always can.
    at_left, at_right = start[0:-1:2].copy(), start[1::2].copy()
    waiting = np.ones(count, dtype=np.bool_)
    gone = np.zeros(count, dtype=np.bool_)
    again = np.empty(count, dtype=np.int32)
    head, height, found = 0, 0, 0
    while head < count or height > 0:
        if height > 0:
            height -= 1
            e = again[height]
        else:
            e = queue[head]
            head += 1
            if not waiting[e]:
                continue
        waiting[e] = False
        if gone[e] or side[e] != 0:
            continue
        a, b = edges[e, 0], edges[e, 1]
        middle, end = start[2 * e + 1], start[2 * e + 2]
        left, right = at_left[e], at_right[e]
        kept = False
        while left < middle:
            t = items[left]
            if alive[t]:
                c = triangles[t, 0] + triangles[t, 1] + triangles[t, 2] - a - b
                while right < end:
                    u = items[right]
                    if alive[u]:
                        d = triangles[u, 0] + triangles[u, 1] + triangles[u, 2] - a - b
                        if turn(points, d, b, c) <= 0.0 or turn(points, c, a, d) <= 0.0:
                            kept = True
                            break
                        i, j, k = lowest_first(d, b, c)
                        flipped = weight(
                            *(points, i, j, k, weights, function, custom, sign),
                            *(scale, factor, bits),
                        )
                        i, j, k = lowest_first(c, a, d)
                        flipped += weight(
                            *(points, i, j, k, weights, function, custom, sign),
                            *(scale, factor, bits),
                        )
                        if value[t] + value[u] <= flipped:
                            kept = True
                            break
                    right += 1
                if kept:
                    break
            left += 1
            right = middle
        at_left[e], at_right[e] = left, right
        if kept:
            continue
        gone[e] = True
        excluded[found] = e
        found += 1
        for place in range(start[2 * e], end):
            t = items[place]
            if not alive[t]:
                continue
            alive[t] = False
            for k in range(3):
                other = sides[t, k]
                if not gone[other] and side[other] == 0 and not waiting[other]:
                    # Only if the pair that keeps it was this triangle's.
                    waiting[other] = True
                    again[height] = other
                    height += 1
    return found
