"""Potentials for the edges that local minimality excludes, so that a proof needs no exclusions.

Local minimality says that an edge is in no optimum (`local_minimality`), potentials say that no
triangulation weighs less than a bound (`program`). The second is the stronger: potentials of the
edges that are left always extend to those that were excluded. Compare A. Yousefi and N. E. Young,
"On a linear program for minimum-weight triangulation", 2014.

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

import numpy as np
from numba import njit

from triangulators.candidates import Candidates

_FAR = np.int64(2**60)  # no potential reaches it


def extend(
    candidates: Candidates, weights: np.ndarray, excluded: np.ndarray, potentials: np.ndarray
) -> np.ndarray | None:
    """Return potentials (e,) that also hold for triangles with excluded edges.

    weights (t,); excluded (k,): in their order; potentials (e,): those of excluded edges do not
    matter. None where one would be too large.
    """
    c = candidates
    found = potentials.copy()
    given = np.ones(len(c.edges), dtype=np.bool_)
    given[excluded] = False
    backwards = excluded[::-1].astype(np.int64)
    done = _extend(c.triangles, c.sides, c.start, c.items, weights, backwards, given, found)
    return found if done else None


@njit(cache=True, nogil=True)
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
        potentials[e] = min(max(0, low), high) if low <= high else (low + high) // 2
        if abs(potentials[e]) >= _FAR:
            return False
        given[e] = True
    return True
