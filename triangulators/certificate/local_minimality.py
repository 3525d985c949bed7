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
noise of `integer_costs` there are next to no ties, which would keep both diagonals of a rectangle.

A polygon of 100,000 vertices may have some hundred million triangles. `thin` looks at each edge
once and works out its triangles from what its ends see, so that nothing needs to be kept but edges;
`exclude` goes on with the few triangles that are left.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from triangulators.certificate.candidates import Candidates, holds_ring
from triangulators.certificate.sight import Fans, Sight
from triangulators.compute.kernels import njit
from triangulators.compute.threads import cores
from triangulators.criteria.cost import Cost, cost_at
from triangulators.criteria.integer_costs import Units, noise, units_of
from triangulators.geometry.predicates import turn

_SAMPLE = 1000  # edges to judge by whether thinning is worth its time
_AT_ONCE, _SLICES = 500, 4  # edges that are thinned at once, and in how many slices


def thin(sight: Sight, fans: Fans, cost: Cost, units: Units, worth: float) -> np.ndarray | None:
    """Return edges that are in no optimum, in the order in which that is seen.

    None where less than the share `worth` of a few edges is seen to be in none.
    """
    queue = _longest_first(sight.points, sight.edges)
    given, terms = (*sight, *fans), (cost, units)
    gone = np.zeros(len(sight.edges), dtype=np.bool_)
    few = queue[:: max(1, len(queue) // _SAMPLE)]
    if len(_thin(*given, few, gone, *terms)) < worth * len(few):
        return None
    found = []
    with ThreadPoolExecutor(cores()) as pool:
        for begin in range(0, len(queue), _AT_ONCE):
            # Each slice knows what went before all of them, however many threads there are. What
            # goes with more triangles there, goes with fewer, so they may come in any order.
            slices = np.array_split(queue[begin : begin + _AT_ONCE], _SLICES)
            jobs = [pool.submit(_thin, *given, each, gone, *terms) for each in slices]
            excluded = np.concatenate([job.result() for job in jobs])
            gone[excluded] = True
            found.append(excluded)
    return np.concatenate(found)


def largest_cost(sight: Sight, fans: Fans, cost: Cost) -> float:
    """Return the largest absolute cost of three sites that see each other."""
    return float(_largest(sight.points, sight.edges, fans.begin, fans.near, cost))


def exclude(
    candidates: Candidates,
    weights: np.ndarray,
    cost: Cost,
    units: Units,
    out: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (excluded edges in their order, which triangles (t,) are left).

    weights: (t,) of the triangles, in `integer_costs`; out (e,): edges that are excluded already.
    """
    queue = _longest_first(candidates.points, candidates.edges)
    excluded = np.empty(len(queue), dtype=np.int32)
    alive = np.ones(len(candidates.triangles), dtype=np.bool_)
    if out is not None:
        alive = ~out[candidates.sides].any(axis=1)
        queue = queue[~out[queue]]
    how_many = _exclude(
        *candidates,
        weights // units.factor,
        queue,
        excluded,
        alive,
        cost,
        units,
    )
    return excluded[:how_many].copy(), alive


def _longest_first(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return edges in the order in which to look at them: a long one takes many triangles along."""
    spans = np.abs(points[edges[:, 0]] - points[edges[:, 1]]).sum(axis=1)
    return np.argsort(-spans, kind="stable")


@njit(nogil=True)
def _largest(
    points: np.ndarray,
    edges: np.ndarray,
    begin: np.ndarray,
    near: np.ndarray,
    cost: Cost,
) -> float:
    most = 0.0
    both = np.empty((len(points), 2), dtype=np.int64)
    for e in range(len(edges)):
        a, b = edges[e, 0], edges[e, 1]
        for k in range(seen_by_both(begin, near, a, b, both)):
            c = near[both[k, 0]]
            if c > b:
                most = max(most, abs(cost_at(points, a, b, c, cost)))
    return most


@njit(nogil=True)
def _thin(
    points: np.ndarray,
    edges: np.ndarray,
    side: np.ndarray,
    rings: np.ndarray,
    begin: np.ndarray,
    near: np.ndarray,
    by: np.ndarray,
    queue: np.ndarray,
    gone: np.ndarray,
    cost: Cost,
    units: Units,
) -> np.ndarray:
    """Return edges of `queue` that are excluded where those in `gone` (e,) are."""
    excluded = np.empty(len(queue), dtype=np.int32)
    apex, value = np.empty((2, len(points)), np.int32), np.empty((2, len(points)), np.int64)
    count, both = np.empty(2, dtype=np.int64), np.empty((len(points), 2), dtype=np.int64)
    found = 0
    for e in queue:
        if side[e] != 0:
            continue
        a, b = edges[e, 0], edges[e, 1]
        _apexes(points, side, begin, near, by, gone, a, b, apex, count, both)
        for left in range(2):
            for k in range(count[left]):
                i, j = (a, b) if left else (b, a)
                value[left, k] = units_of(points, i, j, apex[left, k], cost, units.scale)
        kept = False
        for p in range(count[1]):
            for q in range(count[0]):
                c, d = apex[1, p], apex[0, q]
                total = value[1, p] + value[0, q]
                if (
                    not _can_be_flipped(points, a, b, c, d, total, cost, units)
                    and not holds_ring(points, rings, a, b, c, 1)
                    and not holds_ring(points, rings, a, b, d, -1)
                ):
                    kept = True
                    break
            if kept:
                break
        if not kept:
            excluded[found] = e
            found += 1
    return excluded[:found].copy()


@njit
def _apexes(
    points: np.ndarray,
    side: np.ndarray,
    begin: np.ndarray,
    near: np.ndarray,
    by: np.ndarray,
    gone: np.ndarray,
    a: int,
    b: int,
    apex: np.ndarray,
    count: np.ndarray,
    both: np.ndarray,
) -> None:
    """Write the third corners of the triangles left of a-b to `apex[1]`, of the others to [0]."""
    count[:] = 0
    for k in range(seen_by_both(begin, near, a, b, both)):
        c, p, q = near[both[k, 0]], by[both[k, 0]], by[both[k, 1]]
        if gone[p] or gone[q]:
            continue
        # Counter-clockwise a-b-c runs b to c and c to a; on the other side a to c and c to b.
        left = turn(points, a, b, c) > 0.0
        way = 1 if left else -1
        b_to_c, c_to_a = (way if b < c else -way), (way if c < a else -way)
        if side[q] != -b_to_c and side[p] != -c_to_a:
            apex[int(left), count[int(left)]] = c
            count[int(left)] += 1


@njit
def seen_by_both(begin: np.ndarray, near: np.ndarray, a: int, b: int, both: np.ndarray) -> int:
    """Write where the sites that a and b see stand in `near`, for each of them; return how many."""
    found = 0
    i, j = begin[a], begin[b]
    while i < begin[a + 1] and j < begin[b + 1]:
        if near[i] < near[j]:
            i += 1
        elif near[i] > near[j]:
            j += 1
        else:
            both[found, 0], both[found, 1] = i, j
            found += 1
            i += 1
            j += 1
    return found


@njit
def _can_be_flipped(
    points: np.ndarray,
    a: int,
    b: int,
    c: int,
    d: int,
    value: int,
    cost: Cost,
    units: Units,
) -> np.bool_:
    """Whether a-b-c and b-a-d, of `value` units together, weigh less with the diagonal c-d.

    The noise of the four sides is the same before and after. That of the diagonals, which counts
    twice, decides where units are equal: it is less than one of them.
    """
    if turn(points, d, b, c) <= 0.0 or turn(points, c, a, d) <= 0.0:
        return np.bool_(False)
    flipped = units_of(points, d, b, c, cost, units.scale)
    flipped += units_of(points, c, a, d, cost, units.scale)
    if flipped == value:
        return noise(c, d, units.bits) < noise(a, b, units.bits)
    return flipped < value


@njit(nogil=True)
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
    cost: Cost,
    units: Units,
) -> int:
    """Write the excluded edges, mark what they leave in `alive`; return how many they are."""
    count = len(edges)
    # Where the search for a pair that cannot be flipped stands; a pair that can be, always can.
    at_left, at_right = start[0:-1:2].copy(), start[1::2].copy()
    waiting = side == 0
    again = np.empty(count, dtype=np.int32)
    head, height, found = 0, 0, 0
    while head < len(queue) or height > 0:
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
            c = triangles[t, 0] + triangles[t, 1] + triangles[t, 2] - a - b
            while alive[t] and right < end:
                u = items[right]
                d = triangles[u, 0] + triangles[u, 1] + triangles[u, 2] - a - b
                total = value[t] + value[u]
                if alive[u] and not _can_be_flipped(points, a, b, c, d, total, cost, units):
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


@njit
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
