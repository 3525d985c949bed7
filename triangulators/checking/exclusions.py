"""Check that edges may be excluded, in the order in which the evidence excludes them.

A triangle remains if none of its sides was excluded before. An edge may be excluded if each pair of
remaining triangles, one on each side of it, makes a strictly convex quadrilateral whose other
diagonal weighs less: no triangulation of least weight contains the edge then, as flipping it would
make a lighter one. A pair that is not strictly convex cannot be flipped, so it blocks the exclusion
whatever it weighs.

`turn_of`, the place of each edge in the order (the number of edges where it is never excluded),
says what remained when an edge went, so each edge can be checked by itself, in any thread. Nothing
is kept between edges: one whose ends see p and q sites, with t and u triangles, takes 2 (p + q)
steps to find them, t + u weights, and for each of t * u pairs two turns and two weights.

Exclusions are replayed only where a proof branches; elsewhere potentials stand in for them.
"""

import numpy as np

from triangulators.checking.edges import Edges, around_hole
from triangulators.checking.evidence import Refused
from triangulators.checking.units import Units
from triangulators.checking.weights import TOO_LARGE, weight_of
from triangulators.compute.kernels import njit
from triangulators.compute.threads import shared_out
from triangulators.criteria.cost import Cost
from triangulators.geometry.predicates import turn

_FEW, _SLICES = 20_000, 16  # edges from which on they are shared out among threads; slices

Fans = tuple[np.ndarray, np.ndarray, np.ndarray]


def check_excluded(edges: Edges, order: np.ndarray, cost: Cost, units: Units) -> None:
    """Raise `Refused` unless each edge of `order` may be excluded after those before it."""
    turn_of = np.full(len(edges.ends), len(edges.ends), dtype=np.int64)
    turn_of[order] = np.arange(len(order))
    fans = _fans(edges.ends, len(edges.points))
    slices = _SLICES if len(order) > _FEW else 1

    def wrong_one(number: int) -> int:
        return int(_replay(edges, fans, order[number::slices], turn_of, cost, units))

    # Each is checked by itself: which ones went before is known from their turns.
    wrong = [number for number in shared_out(wrong_one, slices) if number >= 0]
    if TOO_LARGE in wrong:
        raise Refused("a weight is too large for exact arithmetic")
    if wrong:
        a, b = edges.ends[min(wrong, key=lambda e: turn_of[e])].tolist()
        raise Refused(f"the edge {a}-{b} is excluded, but may be part of an optimum")


def _fans(ends: np.ndarray, n: int) -> Fans:
    """Return (start, other, over): site v sees `other[start[v]:start[v + 1]]` along edges `over`.

    The sites are ascending: edges ascend, and those to lower sites come before those to higher.
    All higher ends are sorted first, then all lower ones: `% len(ends)` makes an edge of both.
    """
    sites = ends[:, ::-1].T.ravel()
    order = np.argsort(sites, kind="stable")
    start = np.searchsorted(sites[order], np.arange(n + 1))
    return start, ends.T.ravel()[order], (order % len(ends)).astype(np.int32)


@njit
def _third_corners(
    edges: Edges,
    fans: Fans,
    turn_of: np.ndarray,
    now: int,
    a: int,
    b: int,
    corners: np.ndarray,
) -> int:
    """Write c of each triangle a-b-c, counter-clockwise, to `corners`; return how many there are.

    Triangles of edges whose turn to be excluded is not before `now`. Those round a hole are among
    them.
    """
    start, other, over = fans
    found = 0
    p, q = start[a], start[b]
    while p < start[a + 1] and q < start[b + 1]:
        c = other[p]
        if c < other[q]:
            p += 1
        elif c > other[q]:
            q += 1
        else:
            there = turn_of[over[q]] >= now and turn_of[over[p]] >= now
            if there and turn(edges.points, a, b, c) > 0.0:
                corners[found] = c
                found += 1
            p += 1
            q += 1
    return found


@njit(nogil=True)
def _replay(
    edges: Edges,
    fans: Fans,
    which: np.ndarray,
    turn_of: np.ndarray,
    cost: Cost,
    units: Units,
) -> int:
    """Return the first edge of `which` that must not be excluded in its turn, or -1.

    turn_of (e,): those that are excluded before it have a lower turn. `TOO_LARGE` where a weight
    is.
    """
    points = edges.points
    left, right = np.empty(len(points), dtype=np.int32), np.empty(len(points), dtype=np.int32)
    lefts, rights = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    for e in which:
        if edges.ways[e] != 0:
            return e  # a side of the boundary is in every triangulation
        a, b = edges.ends[e, 0], edges.ends[e, 1]
        now = turn_of[e]
        # On the right of a-b is what is on the left of b-a.
        on_left = _third_corners(edges, fans, turn_of, now, a, b, left)
        on_right = _third_corners(edges, fans, turn_of, now, b, a, right)
        for p in range(on_left):
            lefts[p] = weight_of(points, a, b, left[p], cost, units)
        for q in range(on_right):
            rights[q] = weight_of(points, b, a, right[q], cost, units)
        # Invariant: each pair looked at could be flipped to less weight, or one of its triangles
        # runs round a hole and is in no triangulation.
        for p in range(on_left):
            for q in range(on_right):
                c, d = left[p], right[q]
                lighter = False
                # The quadrilateral a-d-b-c is strictly convex if c-d passes b on one side and a on
                # the other. Both must be asked: with one of them a quadrilateral that is concave
                # at the other end would be "flipped" to triangles that overlap.
                if turn(points, c, d, b) > 0.0 and turn(points, d, c, a) > 0.0:
                    one = weight_of(points, c, d, b, cost, units)
                    two = weight_of(points, d, c, a, cost, units)
                    if max(one, two, lefts[p], rights[q]) >= TOO_LARGE:
                        return TOO_LARGE
                    lighter = one + two < lefts[p] + rights[q]
                if (
                    not lighter
                    and not around_hole(points, edges.holes, a, b, c)
                    and not around_hole(points, edges.holes, b, a, d)
                ):
                    return e
    return -1
