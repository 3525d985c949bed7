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

That an edge has no triangle whose other sides have potentials, on one side or both, does no harm:
nothing then bounds its potential there. Its other triangles come when their last side does, which
is an edge that was excluded earlier; so every triangle is looked at once, at its last side.
"""

from typing import Any

import numpy as np

from triangulators.certificate.candidates import Candidates
from triangulators.compute.kernels import njit

TOO_LARGE = 2**60  # for a potential
_FAR = np.int64(TOO_LARGE)


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


@njit
def _nearest_zero(low: np.int64, high: np.int64) -> Any:
    """Return what is nearest to zero of low to high; where nothing is, half-way."""
    return min(max(0, low), high) if low <= high else (low + high) // 2


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
        potentials[e] = _nearest_zero(low, high)
        if abs(potentials[e]) >= _FAR:
            return False
        given[e] = True
    return True
