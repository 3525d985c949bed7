"""Exclude edges that no optimum contains, by local minimality (the LMT skeleton).

Source: M. Dickerson and M. Montague, "A (usually?) connected subgraph of the minimum weight
triangulation", 1996.

Let an optimum contain the diagonal a-b, with the triangles a-b-c on its left and b-a-d on its
right. If c-d crosses a-b, then d-b-c and c-a-d are empty triangles too, and putting them in their
place gives another triangulation; so

    weight(abc) + weight(bad) <= weight(dbc) + weight(cad).

Nothing is used but that the cost sums over triangles. Therefore an edge goes if every pair of
triangles that are left on its two sides could be flipped to less weight, and with it the
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
        *candidates,
        weights,
        queue,
        excluded,
        alive,
        *cost[:4],
        units.scale,
        units.factor,
        units.bits,
    )
    return excluded[:how_many].copy(), alive


@njit(cache=True)
def _can_be_flipped(
    points: np.ndarray,
    a: int,
    b: int,
    c: int,
    d: int,
    value: int,
    weights: np.ndarray,
    function: Any,
    custom: bool,
    sign: float,
    scale: float,
    factor: int,
    bits: int,
) -> np.bool_:
    """Whether a-b-c and b-a-d, of weight `value` together, weigh less with the diagonal c-d."""
    if turn(points, d, b, c) <= 0.0 or turn(points, c, a, d) <= 0.0:
        return np.bool_(False)
    i, j, k = lowest_first(d, b, c)
    units = (scale, factor, bits)
    flipped = weight(points, i, j, k, weights, function, custom, sign, *units)
    i, j, k = lowest_first(c, a, d)
    return flipped + weight(points, i, j, k, weights, function, custom, sign, *units) < value


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
    """Write the excluded edges, mark what they leave in `alive`; return how many they are."""
    count = len(edges)
    # Where the search for a pair that cannot be flipped stands; a pair that can be, always can.
    at_left, at_right = start[0:-1:2].copy(), start[1::2].copy()
    waiting = side == 0
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
        a, b = edges[e, 0], edges[e, 1]
        middle, end = start[2 * e + 1], start[2 * e + 2]
        left, right = at_left[e], at_right[e]
        kept = False
        while left < middle and not kept:
            t = items[left]
            while alive[t] and right < end:
                u = items[right]
                if alive[u] and not _can_be_flipped(
                    points,
                    a,
                    b,
                    triangles[t].sum() - a - b,
                    triangles[u].sum() - a - b,
                    value[t] + value[u],
                    *(weights, function, custom, sign, scale, factor, bits),
                ):
                    kept = True
                    break
                right += 1
            if not kept:
                left += 1
                right = middle
        at_left[e], at_right[e] = left, right
        if kept:
            continue
        excluded[found] = e
        found += 1
        for place in range(start[2 * e], end):
            t = items[place]
            if alive[t]:
                alive[t] = False
                height = _look_again(sides[t], e, side, at_left, start, waiting, again, height)
    return found


@njit(cache=True)
def _look_again(
    three: np.ndarray,
    gone: int,
    side: np.ndarray,
    at_left: np.ndarray,
    start: np.ndarray,
    waiting: np.ndarray,
    again: np.ndarray,
    height: int,
) -> int:
    """Let the other sides of a triangle that is gone wait for another look; return the height."""
    for other in three:
        # An edge is gone itself where the search for its pair has come to its end.
        open_still = at_left[other] < start[2 * other + 1]
        if other != gone and side[other] == 0 and open_still and not waiting[other]:
            waiting[other] = True
            again[height] = other
            height += 1
    return height
