"""Potentials for the edges that local minimality excludes, so that a proof needs no exclusions.

Local minimality says that an edge is in no optimum (`local_minimality`), potentials say that no
triangulation weighs less than a bound (`linear_program`). The second is the stronger: potentials of
the edges that are left always extend to those that were excluded. Compare A. Yousefi and N. E.
Young, "On a linear program for minimum-weight triangulation", 2014.

Take the excluded edges in reverse, the last one first. Let a-b be the next, and let the triangles
at it whose other sides have potentials be abc on its left and bad on its right. Its potential y
must satisfy

    y(ab) <= weight(abc) - y(bc) - y(ca)     and     -y(ab) <= weight(bad) - y(ad) - y(db),

which can be done if each such pair weighs at least y(bc) + y(ca) + y(ad) + y(db). It does, for when
a-b was excluded the pair could be flipped to less weight:

    weight(abc) + weight(bad) > weight(dbc) + weight(cad)
                             >= y(db) + y(bc) + y(cd)  +  y(ca) + y(ad) + y(dc),

and y(cd) + y(dc) = 0. (c-d was not excluded before a-b: then abc and bad would have been the
lighter pair.) No potential of the boundary changes, and so neither does the bound. With a lift,
which every triangle may exceed its weight by, half of what is missing goes to either side.
"""

from typing import Any

import numpy as np

from triangulators.certificate.candidates import Candidates, holds_ring
from triangulators.certificate.local_minimality import seen_by_both
from triangulators.certificate.sight import Fans, Sight
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost
from triangulators.criteria.integer_costs import Units, weight
from triangulators.geometry.predicates import turn

TOO_LARGE = 2**60  # for a potential
_FAR = np.int64(TOO_LARGE)


def extend(
    candidates: Candidates,
    weights: np.ndarray,
    excluded: np.ndarray,
    potentials: np.ndarray,
    out: np.ndarray,
) -> np.ndarray | None:
    """Return potentials (e,) that also hold for triangles with excluded edges.

    weights (t,); excluded (k,): in their order; potentials (e,): those of excluded edges do not
    matter; out (e,): edges that were excluded before. None where one would be too large.
    """
    c = candidates
    found = potentials.copy()
    given = ~out
    given[excluded] = False
    backwards = excluded[::-1].astype(np.int64)
    done = _extend(c.triangles, c.sides, c.start, c.items, weights, backwards, given, found)
    return found if done else None


def extend_thinned(
    sight: Sight,
    fans: Fans,
    thinned: np.ndarray,
    potentials: np.ndarray,
    cost: Cost,
    units: Units,
) -> None:
    """Give the edges that `thin` excluded, in their order, potentials (e,), in place.

    Their triangles are worked out anew from what the two ends see, as `thin` does it.
    """
    given = np.ones(len(sight.edges), dtype=np.bool_)
    given[thinned] = False
    backwards = thinned[::-1].astype(np.int64)
    _extend_thinned(*sight, *fans, *(backwards, given, potentials), cost, units)


@njit
def _between(low: np.int64, high: np.int64) -> Any:
    """Return what is nearest to zero of low to high; where nothing is, half-way."""
    return min(max(0, low), high) if low <= high else (low + high) // 2


@njit(nogil=True)
def _extend(
    triangles: np.ndarray,
    sides: np.ndarray,
    start: np.ndarray,
    items: np.ndarray,
    weights: np.ndarray,
    backwards: np.ndarray,
    given: np.ndarray,
    potentials: np.ndarray,
) -> bool:
    for e in backwards:
        low, high = -_FAR, _FAR
        for place in range(start[2 * e], start[2 * e + 2]):
            t = items[place]
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
        potentials[e] = _between(low, high)
        if abs(potentials[e]) >= _FAR:
            return False
        given[e] = True
    return True


@njit(nogil=True)
def _extend_thinned(
    points: np.ndarray,
    edges: np.ndarray,
    side: np.ndarray,
    rings: np.ndarray,
    begin: np.ndarray,
    near: np.ndarray,
    by: np.ndarray,
    backwards: np.ndarray,
    given: np.ndarray,
    potentials: np.ndarray,
    cost: Cost,
    units: Units,
) -> None:
    both = np.empty((len(points), 2), dtype=np.int64)
    for e in backwards:
        a, b = edges[e, 0], edges[e, 1]
        low, high = -_FAR, _FAR
        for k in range(seen_by_both(begin, near, a, b, both)):
            c, p, q = near[both[k, 0]], by[both[k, 0]], by[both[k, 1]]
            if not (given[p] and given[q]):
                continue
            # On the left of a-b the triangle runs b to c and c to a, otherwise the other way.
            way = 1 if turn(points, a, b, c) > 0.0 else -1
            from_b, to_a = (way if b < c else -way), (way if c < a else -way)
            if side[q] == -from_b or side[p] == -to_a or holds_ring(points, rings, a, b, c, way):
                continue
            i, j, m = (a, b, c) if way > 0 else (a, c, b)
            room = weight(points, i, j, m, cost, units)
            room -= from_b * potentials[q] + to_a * potentials[p]
            if way > 0:
                high = min(high, room)
            else:
                low = max(low, -room)
        potentials[e] = _between(low, high)
        given[e] = True
