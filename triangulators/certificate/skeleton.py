"""Solve by a table what local minimality leaves, where its skeleton is connected.

A diagonal that remains, and that no other remaining edge crosses, belongs to the skeleton (see
`local_minimality`): it is in every optimum. With holes, cut the polygon along diagonals of the
skeleton that connect the boundary's rings. If they connect all, what is cut is one ring, in which a
site at which cuts end has several places:

    outline 0 1 2 3, hole 4 5 6, cut along 2-4:     ring 0 1 2 4 6 5 4 2 3

The edges that remain are its pairs of places that may be joined. None crosses a cut, so each lies
in one of the angles at either end, which says its places. Every triangle of remaining edges has its
three sides among them: it is empty, and a cut inside it would have to leave it across a side. So
`far_costs` over these pairs gives the optimum, and potentials that keep the inequality of every
remaining triangle, whether any triangulation has it or not.
"""

import numpy as np

from triangulators.certificate.candidates import Candidates
from triangulators.checking.units import Units
from triangulators.compute.kernels import njit
from triangulators.compute.operations import grouped, join, root_of
from triangulators.criteria.cost import Cost
from triangulators.geometry.predicates import cross, turn
from triangulators.optimum.visible_lists import NOTHING, far_costs


def by_table(
    candidates: Candidates, alive: np.ndarray, cost: Cost, units: Units
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return an optimum (m, 3) of the triangles that are `alive` (t,), and potentials (e,) int64.

    None where diagonals of the skeleton leave rings apart, or where there is no triangulation.
    """
    c = candidates
    left = c.side != 0  # the edges that remain
    left[c.sides[alive]] = True
    cut = np.zeros(len(c.edges), dtype=np.bool_)
    if _connect(c.points, c.edges, c.side, left, cut) > 1:
        return None
    ring, inner = _ring_of(c, cut), left & ~cut & (c.side == 0)
    first, last = _places(c, inner, ring)
    if (first < 0).any() or (last < 0).any():
        return None
    n, inner = len(ring), np.flatnonzero(inner)
    # Sides of the ring are pairs as well; their edges' potentials are 0, but for the closing one's.
    low = np.concatenate((np.minimum(first, last), np.arange(n - 1), [0]))
    high = np.concatenate((np.maximum(first, last), np.arange(1, n), [n - 1]))
    order = np.lexsort((high, low))
    start = np.searchsorted(low[order], np.arange(n + 1))
    far, triangles = far_costs(start, high[order].astype(np.int32), c.points, ring, cost, units)
    by_pair = np.empty_like(far)
    by_pair[order] = far
    if by_pair[-1] >= NOTHING or len(triangles) == 0:
        return None
    potentials = np.zeros(len(c.edges), dtype=np.int64)
    # An edge is named from its lower site; -far is the potential run from the earlier place.
    potentials[inner] = np.where(first < last, -by_pair[: len(inner)], by_pair[: len(inner)])
    closing = np.flatnonzero(c.side)[0]
    potentials[closing] = c.side[closing] * by_pair[-1]
    return ring[triangles], potentials


@njit(nogil=True)
def _connect(
    points: np.ndarray, edges: np.ndarray, side: np.ndarray, left: np.ndarray, cut: np.ndarray
) -> int:
    """Mark in `cut` diagonals that connect rings and are not crossed; return how many parts remain.

    left (e,): the edges that remain. Sites of one part have one root in `parent`.
    """
    parent = np.arange(len(points))
    on_boundary = np.zeros(len(points), dtype=np.bool_)  # where rings touch, points have no site
    parts = 0
    for e in range(len(edges)):
        if side[e] != 0:
            for v in edges[e]:
                parts += not on_boundary[v]
                on_boundary[v] = True
            parts -= join(parent, edges[e, 0], edges[e, 1])
    # Only diagonals between parts can connect them, and only edges whose boxes meet can cross.
    low = np.empty(len(edges))
    widest = 0.0
    for e in range(len(edges)):
        x, other = points[edges[e, 0], 0], points[edges[e, 1], 0]
        low[e] = min(x, other)
        if left[e]:
            widest = max(widest, abs(x - other))
    order = np.argsort(low)
    for place in range(len(order)):
        if parts == 1:
            break
        e = order[place]
        if not left[e] or side[e] != 0:
            continue
        a, b = edges[e, 0], edges[e, 1]
        apart = root_of(parent, a) != root_of(parent, b)
        if apart and not _is_crossed(points, edges, left, order, low, place, widest):
            cut[e] = True
            parts -= join(parent, a, b)
    return parts


@njit(nogil=True)
def _is_crossed(
    points: np.ndarray,
    edges: np.ndarray,
    left: np.ndarray,
    order: np.ndarray,
    low: np.ndarray,
    place: int,
    widest: float,
) -> bool:
    """Whether an edge that is left crosses edge `order[place]`; they are in the order of `low`."""
    e = order[place]
    a, b = edges[e, 0], edges[e, 1]
    right = max(points[a, 0], points[b, 0])
    for step in (-1, 1):
        at = place + step
        while 0 <= at < len(order):
            f = order[at]
            at += step
            if (step > 0 and low[f] >= right) or (step < 0 and low[f] + widest <= low[e]):
                break
            if left[f] and cross(points, a, b, edges[f, 0], edges[f, 1]):
                return True
    return False


@njit
def _between(points: np.ndarray, before: int, at: int, after: int, other: int) -> bool:
    """Whether a corner's angle, from `after` counter-clockwise to `before`, has `other` inside."""
    out, back = turn(points, at, after, other) > 0.0, turn(points, before, at, other) > 0.0
    if turn(points, before, at, after) > 0.0:
        return out and back
    return out or back


@njit(nogil=True)
def _ring_of(candidates: Candidates, cut: np.ndarray) -> np.ndarray:
    """Return the sites of the polygon as it is cut, counter-clockwise, each as often as it is met.

    The last one leads to the first along the first side of the boundary. The ring goes along the
    boundary's sides in their direction and along each cut in both; what follows side u-v is the
    first that leaves v, clockwise from u on: nothing of the polygon lies between them.
    """
    points, edges, side = candidates.points, candidates.edges, candidates.side
    count = 2 * cut.sum() + (side != 0).sum()
    leaving = np.empty((count, 2), dtype=np.int32)  # sides of the ring
    n = 0
    for e in range(len(edges)):
        if side[e] > 0 or cut[e]:
            leaving[n, 0], leaving[n, 1] = edges[e, 0], edges[e, 1]
            n += 1
        if side[e] < 0 or cut[e]:
            leaving[n, 0], leaving[n, 1] = edges[e, 1], edges[e, 0]
            n += 1
    start, items = grouped(leaving[:, 0].copy(), len(points))
    root = 0
    while side[root] == 0:
        root += 1
    u, v = edges[root, 0], edges[root, 1]
    if side[root] < 0:
        u, v = v, u
    ring = np.empty(count, dtype=np.int32)
    for place in range(count):
        ring[place] = v
        following = -1
        for at in range(start[v], start[v + 1]):
            w = leaving[items[at], 1]
            if w != u and (following < 0 or _between(points, u, v, following, w)):
                following = w
        u, v = v, following
    return ring


@njit(nogil=True)
def _places(
    candidates: Candidates, wanted: np.ndarray, ring: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the places in the ring of the lower and of the higher ends of the edges `wanted` (e,).

    -1 where an end has no place.
    """
    points, edges, n = candidates.points, candidates.edges, len(ring)
    start, items = grouped(ring, len(points))
    found = np.full((wanted.sum(), 2), -1, dtype=np.int64)
    row = 0
    for e in range(len(edges)):
        if wanted[e]:
            for end in range(2):
                at, other = edges[e, end], edges[e, 1 - end]
                for item in range(start[at], start[at + 1]):
                    place = items[item]
                    before, after = ring[place - 1], ring[(place + 1) % n]
                    if _between(points, before, at, after, other):
                        found[row, end] = place
            row += 1
    return found[:, 0], found[:, 1]
