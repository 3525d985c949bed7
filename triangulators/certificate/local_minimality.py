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

An edge with t triangles on its left and u on its right takes at most t * u flips to try, and up to
t + u more, each the first of another look.

Potentials for what is excluded, so that a proof needs no exclusions. Potentials say that no
triangulation weighs less than a bound (`linear_program`), which is the stronger: those of the edges
that are left always extend to those that were excluded (`extend`). Compare A. Yousefi and N. E.
Young, "On a linear program for minimum-weight triangulation", 2014.

Take the excluded edges in reverse, the last one first. Let a-b be the next, and let the triangles
at it whose other sides have potentials be abc on its left and bad on its right. Its potential y
must satisfy

    y(ab) <= weight(abc) - y(bc) - y(ca)     and     -y(ab) <= weight(bad) - y(ad) - y(db),

which can be done if each such pair weighs at least y(bc) + y(ca) + y(ad) + y(db). It does, for when
a-b was excluded the pair could be flipped to less weight:

    weight(abc) + weight(bad) > weight(dbc) + weight(cad)
                             >= y(db) + y(bc) + y(cd)  +  y(ca) + y(ad) + y(dc),

and y(cd) + y(dc) = 0. (c-d was not excluded before a-b: abc and bad were alive then, too, and would
have been the lighter pair. So cad and dbc hold already.) No potential of the boundary changes, and
so neither does the bound. With a lift, which is at most 0, dbc and cad may exceed their weights by
-lift each; y(ab) is half-way then, so that abc and bad exceed theirs by no more.

That an edge has no triangle whose other sides have potentials, on one side or both, does no harm:
nothing then bounds its potential there. Its other triangles come when their last side does, which
is an edge that was excluded earlier; so every triangle counts once, at its last side.
"""

import numpy as np

from triangulators.certificate.candidates import Candidates
from triangulators.checking.units import TOO_LARGE, Units, noise, units_of
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost
from triangulators.geometry.predicates import turn

_FAR = np.int64(TOO_LARGE)  # too large for a potential


def exclude(
    candidates: Candidates, weights: np.ndarray, cost: Cost, units: Units
) -> tuple[np.ndarray, np.ndarray]:
    """Return (excluded edges in their order, which triangles (t,) are left).

    weights (t,): of the triangles, as `units` makes them.
    """
    points, edges = candidates.points, candidates.edges
    spans = np.abs(points[edges[:, 0]] - points[edges[:, 1]]).sum(axis=1)
    queue = np.argsort(-spans, kind="stable")  # a long one takes many triangles along
    alive = np.ones(len(candidates.triangles), dtype=np.bool_)
    return _exclude(candidates, weights // units.factor, queue, alive, cost, units), alive


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

    value (t,): what each triangle costs in units, without noise; queue (e,): all edges. A pair, a
    living triangle on either side, keeps the edge unless it is lighter flipped. What has no living
    triangle on one side has no pair, and goes.

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
    # Diagonals in the queue or on the stack, so that none is there twice.
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
                height = _look_again(candidates, t, at_left, waiting, again, height)
    return excluded[:found].copy()


@njit
def _look_again(
    candidates: Candidates,
    t: int,
    at_left: np.ndarray,
    waiting: np.ndarray,
    again: np.ndarray,
    height: int,
) -> int:
    """Let the other sides of triangle t, which is gone, wait for a look; return the height."""
    for other in candidates.sides[t]:
        # Where the search for an edge's pair has come to its end, the edge is gone itself.
        open_still = at_left[other] < candidates.start[2 * other + 1]
        if candidates.side[other] == 0 and open_still and not waiting[other]:
            waiting[other] = True
            again[height] = other
            height += 1
    return height


def extend(
    candidates: Candidates,
    weights: np.ndarray,
    excluded: np.ndarray,
    potentials: np.ndarray,
) -> np.ndarray | None:
    """Return potentials (e,) that also hold for triangles with excluded edges.

    weights (t,); excluded (k,): in their order; potentials (e,): those of excluded edges do not
    matter. None where one would be too large.
    """
    found = potentials.copy()
    given = np.ones(len(found), dtype=np.bool_)
    given[excluded] = False
    backwards = excluded[::-1].astype(np.int64)
    return found if _extend(candidates, weights, backwards, given, found) else None


@njit(nogil=True)
def _extend(
    candidates: Candidates,
    weights: np.ndarray,
    backwards: np.ndarray,
    given: np.ndarray,
    potentials: np.ndarray,
) -> bool:
    """Fill `potentials` of the edges `backwards` and mark them in `given` (e,); False if one fails.

    Invariant: the inequality holds, up to the lift, for every triangle whose sides are all given.
    """
    triangles, sides, start = candidates.triangles, candidates.sides, candidates.start
    for e in backwards:
        low, high = -_FAR, _FAR
        # The triangles left of a-b come first and run along it; those on its right run against it,
        # so that they ask for at most `room` of -y(ab).
        for place in range(start[2 * e], start[2 * e + 2]):
            t = candidates.items[place]
            left = place < start[2 * e + 1]
            room, whole = weights[t], True
            for k in range(3):
                side = sides[t, k]
                if side == e:
                    continue
                whole = whole and given[side]
                ahead = triangles[t, k] < triangles[t, (k + 1) % 3]
                room -= potentials[side] if ahead else -potentials[side]
            if whole and left:
                high = min(high, room)
            elif whole:
                low = max(low, -room)
        # What is nearest to zero of low to high; where nothing is, half-way.
        potentials[e] = min(max(0, low), high) if low <= high else (low + high) // 2
        if abs(potentials[e]) >= _FAR:
            return False
        given[e] = True
    return True
