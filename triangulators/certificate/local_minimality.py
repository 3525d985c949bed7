"""Exclude edges that no optimum contains, by local minimality (the LMT skeleton).

Source: M. Dickerson and M. Montague, "A (usually?) connected subgraph of the minimum weight
triangulation", 1996.

Let an optimum contain the diagonal a-b, with the triangles a-b-c on its left and b-a-d on its
right. If c-d crosses a-b, then d-b-c and c-a-d are empty triangles too, and putting them in their
place gives another triangulation; so

    weight(abc) + weight(bad) <= weight(dbc) + weight(cad).

Nothing is used but that the cost sums over triangles. Take the remaining triangles on the left of
an edge and those on its right: if every pair of one of each could be flipped to less weight, the
edge is excluded, and with it the triangles that have it as a side. That may exclude other edges,
until nothing more goes. A pair that makes no strictly convex quadrilateral cannot be flipped, so it
blocks the exclusion: an optimum may contain it, whatever it weighs. With the noise of
`checking.units` there are next to no ties, which would keep both diagonals of a rectangle.

Which edges remain at the end does not depend on the order in which they are looked at: fewer
triangles make fewer pairs, so what may be excluded now may be excluded later. The order in which
they went is kept all the same, because each exclusion is justified by those before it.

A polygon of 100,000 vertices may have some hundred million triangles. `thin` works out an edge's
triangles from what its ends see, so that nothing needs to be kept but edges; `exclude` goes on with
the few triangles that remain. An edge with t triangles on its left and u on its right takes at most
t * u flips to try, and in `exclude` up to t + u more, each the first of another look.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from triangulators.certificate.candidates import Candidates, holds_ring
from triangulators.certificate.integer_costs import noise, units_of
from triangulators.certificate.sight import Fans, Sight
from triangulators.checking.units import Units
from triangulators.compute.kernels import njit
from triangulators.compute.threads import cores
from triangulators.criteria.cost import Cost
from triangulators.geometry.predicates import turn

_SAMPLE = 1000  # edges to judge by whether thinning is worth its time
_AT_ONCE, _SLICES = 500, 4  # edges that are thinned at once, and in how many slices


def thin(sight: Sight, fans: Fans, cost: Cost, units: Units, worth: float) -> np.ndarray | None:
    """Return edges that are in no optimum, in the order in which that is seen.

    None where less than the share `worth` of a few edges is seen to be in none.
    """
    queue = _longest_first(sight.points, sight.edges)
    gone = np.zeros(len(sight.edges), dtype=np.bool_)
    few = queue[:: max(1, len(queue) // _SAMPLE)]
    if len(_thin(sight, fans, few, gone, cost, units)) < worth * len(few):
        return None
    found = []
    with ThreadPoolExecutor(cores()) as pool:
        for begin in range(0, len(queue), _AT_ONCE):
            # Each slice knows what went before all of them, however many threads there are. What
            # goes with more triangles there, goes with fewer, so they may come in any order.
            slices = np.array_split(queue[begin : begin + _AT_ONCE], _SLICES)
            jobs = [pool.submit(_thin, sight, fans, each, gone, cost, units) for each in slices]
            excluded = np.concatenate([job.result() for job in jobs])
            gone[excluded] = True
            found.append(excluded)
    return np.concatenate(found)


def exclude(
    candidates: Candidates, weights: np.ndarray, cost: Cost, units: Units, out: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (excluded edges in their order, which triangles (t,) are left).

    weights: (t,) of the triangles, in `units`; out (e,): edges that are excluded already.
    """
    queue = _longest_first(candidates.points, candidates.edges)
    alive = ~out[candidates.sides].any(axis=1)
    value = weights // units.factor
    excluded = _exclude(candidates, value, queue[~out[queue]], alive, cost, units)
    return excluded, alive


def _longest_first(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return edges in the order in which to look at them: a long one takes many triangles along."""
    spans = np.abs(points[edges[:, 0]] - points[edges[:, 1]]).sum(axis=1)
    return np.argsort(-spans, kind="stable")


@njit(nogil=True)
def _thin(
    sight: Sight, fans: Fans, queue: np.ndarray, gone: np.ndarray, cost: Cost, units: Units
) -> np.ndarray:
    """Return edges of `queue` that are excluded where those in `gone` (e,) are.

    `gone` does not change here: every edge is judged by what was gone before the call, so that the
    answer depends neither on the order of the queue nor on other threads.
    """
    points, edges = sight.points, sight.edges
    excluded = np.empty(len(queue), dtype=np.int32)
    # Third corners and units of the triangles of one edge: row 1 for its left, row 0 for its right.
    apex, value = np.empty((2, len(points)), np.int32), np.empty((2, len(points)), np.int64)
    count, both = np.empty(2, dtype=np.int64), np.empty((len(points), 2), dtype=np.int64)
    found = 0
    for e in queue:
        if sight.side[e] != 0:
            continue
        a, b = edges[e, 0], edges[e, 1]
        _apexes(sight, fans, gone, e, apex, count, both)
        for left in range(2):
            i, j = (a, b) if left else (b, a)  # counter-clockwise
            for k in range(count[left]):
                value[left, k] = units_of(points, i, j, apex[left, k], cost, units)
        # Invariant: every pair (p, q) that was looked at could be flipped to less weight, or one of
        # its triangles runs round a hole and is none. The first other pair keeps the edge. Holes
        # are looked for last, as that takes the longest.
        kept = False
        for p in range(count[1]):
            for q in range(count[0]):
                c, d = apex[1, p], apex[0, q]
                total = value[1, p] + value[0, q]
                if (
                    not _is_lighter_flipped(points, a, b, c, d, total, cost, units)
                    and not holds_ring(points, sight.rings, a, b, c, 1)
                    and not holds_ring(points, sight.rings, a, b, d, -1)
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
    sight: Sight,
    fans: Fans,
    gone: np.ndarray,
    e: int,
    apex: np.ndarray,
    count: np.ndarray,
    both: np.ndarray,
) -> None:
    """Write the third corners of the triangles left of edge e to `apex[1]`, of others to [0].

    both: room for what the two ends see.
    """
    points, side, a, b = sight.points, sight.side, sight.edges[e, 0], sight.edges[e, 1]
    count[:] = 0
    for k in range(seen_by_both(fans, a, b, both)):
        c, p, q = fans.near[both[k, 0]], fans.by[both[k, 0]], fans.by[both[k, 1]]
        if gone[p] or gone[q]:
            continue
        way = way_round(points, side, a, b, c, p, q)
        if way != 0:
            left = int(way > 0)
            apex[left, count[left]] = c
            count[left] += 1


@njit
def way_round(points: np.ndarray, side: np.ndarray, a: int, b: int, c: int, p: int, q: int) -> int:
    """Return 1 if c is on the left of a-b, a < b, -1 on its right, 0 if the triangle lies outside.

    p, q: the edges a-c and b-c. Counter-clockwise a-b-c runs b to c and c to a; on the other side
    a to c and c to b. So an edge is run with `way` on the left and against it on the right, and the
    other way round where its lower end is not the first. A side of the boundary must not be run
    against its own direction: the triangle would lie outside.
    """
    way = 1 if turn(points, a, b, c) > 0.0 else -1
    b_to_c, c_to_a = (way if b < c else -way), (way if c < a else -way)
    return 0 if side[q] == -b_to_c or side[p] == -c_to_a else way


@njit
def seen_by_both(fans: Fans, a: int, b: int, both: np.ndarray) -> int:
    """Write where the sites that a and b see stand in `near`, for each of them; return how many.

    A merge of two ascending lists: all that both have before i and j is written.
    """
    near = fans.near
    found = 0
    i, j = fans.begin[a], fans.begin[b]
    while i < fans.begin[a + 1] and j < fans.begin[b + 1]:
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
def _is_lighter_flipped(
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

    c is left of a-b and d right of it, so the quadrilateral a-d-b-c is strictly convex if it turns
    left at b and at a as well. The noise of the four sides is the same before and after. Where
    units are equal, that of the diagonals decides: twice the noise of an edge is less than a unit.
    """
    if turn(points, d, b, c) <= 0.0 or turn(points, c, a, d) <= 0.0:
        return np.bool_(False)
    flipped = units_of(points, d, b, c, cost, units) + units_of(points, c, a, d, cost, units)
    if flipped == value:
        return noise(c, d, units.bits) < noise(a, b, units.bits)
    return flipped < value


@njit(nogil=True)
def _exclude(
    candidates: Candidates,
    value: np.ndarray,
    queue: np.ndarray,
    alive: np.ndarray,
    cost: Cost,
    units: Units,
) -> np.ndarray:
    """Return the excluded edges in their order; mark the triangles they take along in `alive`.

    Each edge e has a place (left, right) in the list of its pairs: triangles on its left, and for
    each of them those on its right. Invariant: no pair before that place keeps the edge. For a pair
    can be flipped to less weight or not once and for all, and a triangle that is gone stays gone.
    So a search never goes back, and the pair at which it stops is the reason why the edge is kept.
    When a triangle at the edge goes, it may be one of that pair, so the edge is looked at again
    (`_look_again`).
    """
    points, edges, side, triangles, _sides, start, items = candidates
    excluded = np.empty(len(queue), dtype=np.int32)
    # start[2 e], start[2 e + 1], start[2 e + 2]: begin of the left ones, of the right ones, end.
    at_left, at_right = start[0:-1:2].copy(), start[1::2].copy()
    # Diagonals in the queue or on the stack, so that none is there twice. Those excluded before the
    # call are in neither and are marked all the same: nothing puts them on the stack.
    waiting = side == 0
    again = np.empty(len(edges), dtype=np.int32)  # the stack; an edge is there once, so it has room
    head, height, found = 0, 0, 0
    while head < len(queue) or height > 0:
        if height > 0:
            height -= 1
            e = again[height]
        else:
            e = queue[head]
            head += 1
        if not waiting[e]:
            continue  # a side of the boundary: it has no pair that keeps it, and stays
        waiting[e] = False
        a, b = edges[e, 0], edges[e, 1]
        middle, end = start[2 * e + 1], start[2 * e + 2]
        left, right = at_left[e], at_right[e]
        kept = False
        while left < middle and not kept:
            t = items[left]
            # The corner that is neither a nor b.
            c = triangles[t, 0] + triangles[t, 1] + triangles[t, 2] - a - b
            while alive[t] and right < end:
                u = items[right]
                d = triangles[u, 0] + triangles[u, 1] + triangles[u, 2] - a - b
                total = value[t] + value[u]
                if alive[u] and not _is_lighter_flipped(points, a, b, c, d, total, cost, units):
                    kept = True
                    break
                right += 1
            if not kept:
                left += 1  # all pairs of t are done
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
                height = _look_again(candidates, t, e, at_left, waiting, again, height)
    return excluded[:found].copy()


@njit
def _look_again(
    candidates: Candidates,
    t: int,
    gone: int,
    at_left: np.ndarray,
    waiting: np.ndarray,
    again: np.ndarray,
    height: int,
) -> int:
    """Let the other sides of triangle t, which is gone, wait for a look; return the height."""
    for other in candidates.sides[t]:
        # Where the search for an edge's pair has come to its end, the edge is gone itself.
        open_still = at_left[other] < candidates.start[2 * other + 1]
        if other != gone and candidates.side[other] == 0 and open_still and not waiting[other]:
            waiting[other] = True
            again[height] = other
            height += 1
    return height
