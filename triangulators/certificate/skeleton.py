"""Solve by a table what local minimality leaves, where its skeleton is connected.

A diagonal that remains, and that no other remaining edge crosses, belongs to the skeleton (see
`local_minimality`): it is in every optimum. With holes, cut the polygon along diagonals of the
skeleton that connect the boundary's rings. If they connect all, what is cut has no holes any more,
and the table over all sub-polygons needs only the remaining triangles.

The sub-polygon on the far side of a diagonal, seen from a side of the boundary that is the root,
costs

    far(h) = the least weight(t) + far(g1) + far(g2) over the triangles t beyond h,

where g1 and g2 lead out of t, and nothing is beyond a side of the boundary or a cut. The table is
its own proof: the costs, as potentials of the edges, are a solution of the linear program's dual
(see `linear_program`), for `far(h) - far(g1) - far(g2) <= weight(t)` is what each triangle asks
for, and their sum over the boundary is what is beyond the root. They are integers: nothing is
rounded.
"""

from typing import NamedTuple

import numpy as np

from triangulators.certificate.candidates import Candidates
from triangulators.compute.grouping import grouped
from triangulators.compute.kernels import njit
from triangulators.compute.union_find import join, root_of
from triangulators.geometry.predicates import cross, turn

_NOTHING = np.int64(2**60 - 1)  # cost where no triangles fit; thrice that is still an int64


class Table(NamedTuple):
    """Triangles (m,) of an optimum, by their numbers, and potentials (e,) int64 of the edges."""

    chosen: np.ndarray
    potentials: np.ndarray


class _Beyond(NamedTuple):
    """What is known of what is beyond each half-edge: the least, far (2 e,), and its choice (2 e,).

    Half-edge 2 e runs edge e from its lower end to its higher, 2 e + 1 the other way; what is
    beyond is on its left, and the choice is the triangle there, -1 where no triangles fill what is
    beyond: far is about `_NOTHING` then, less where weights are negative. state (2 e,): 1 while
    what is beyond is worked out, 2 where it is known; seen (t,): triangles that were tried.
    """

    far: np.ndarray
    choice: np.ndarray
    state: np.ndarray
    seen: np.ndarray


def cuts_of(candidates: Candidates, alive: np.ndarray) -> np.ndarray | None:
    """Return which edges (e,) to cut along: diagonals of the skeleton that connect all rings.

    alive (t,): the triangles that remain. None where the skeleton leaves rings apart.
    """
    c = candidates
    left = c.side != 0
    left[c.sides[alive]] = True
    cut = np.zeros(len(c.edges), dtype=np.bool_)
    parts = _connect(c.points, c.edges, c.side, left, cut, np.arange(len(c.points)))
    return cut if parts == 1 else None


def by_table(
    candidates: Candidates, weights: np.ndarray, alive: np.ndarray, cut: np.ndarray
) -> Table | None:
    """Return an optimum of the triangles that are `alive`, where `cut` leaves one part.

    weights, alive (t,): of the triangles. None where the table fails, or they are no triangulation.

    Three steps. `_fill` from a root works out the least beyond each half-edge that leads away from
    it. `_trace` follows the choices and so finds the optimum, and lays out the ring. `_fill_rest`
    goes on with triangles that the root does not lead to, whose inequalities are asked for as well.
    A potential is what is beyond the half-edge from the lower end less what is beyond its twin.
    """
    c = candidates
    root = int(np.flatnonzero(c.side != 0)[0])
    half = 2 * root + int(c.side[root] < 0)
    far, choice = np.zeros(2 * len(c.edges), np.int64), np.full(2 * len(c.edges), -1, np.int32)
    beyond = _Beyond(far, choice, np.zeros(len(far), np.int8), np.zeros(len(c.triangles), np.bool_))
    if not _fill(half, c, weights, alive, cut, beyond):
        return None
    if beyond.choice[half] < 0:
        return None
    chosen, places = _trace(c.triangles, c.sides, c.side, cut, beyond.choice, half)
    if not _fill_rest(chosen, places, c, weights, alive, cut, beyond):
        return None
    return Table(chosen, beyond.far[::2] - beyond.far[1::2])


@njit(nogil=True)
def _join_rings(points: np.ndarray, edges: np.ndarray, side: np.ndarray, parent: np.ndarray) -> int:
    """Join the sites of each ring in `parent` (n,), 0..n - 1; return how many rings there are."""
    on_boundary = np.zeros(len(points), dtype=np.bool_)  # where rings touch, points have no site
    for e in range(len(edges)):
        if side[e] != 0:
            on_boundary[edges[e, 0]] = on_boundary[edges[e, 1]] = True
    rings = on_boundary.sum()
    for e in range(len(edges)):
        if side[e] != 0:
            rings -= join(parent, edges[e, 0], edges[e, 1])
    return rings


@njit(nogil=True)
def _connect(
    points: np.ndarray,
    edges: np.ndarray,
    side: np.ndarray,
    left: np.ndarray,
    cut: np.ndarray,
    parent: np.ndarray,
) -> int:
    """Mark in `cut` diagonals that connect rings and are not crossed; return how many parts remain.

    parent (n,): 0..n - 1, a forest in which sites of one part have one root.
    """
    parts = _join_rings(points, edges, side, parent)
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


@njit(nogil=True)
def _fill(
    root: int,
    candidates: Candidates,
    weights: np.ndarray,
    alive: np.ndarray,
    cut: np.ndarray,
    beyond: _Beyond,
) -> bool:
    """Fill `beyond` for each half-edge that leads away from `root`; False if they form a circle.

    A search in depth, with a stack in place of recursion. Where it is full, it fails, too: a
    half-edge may be on it twice, put there by two triangles before it was looked at. Each half-edge
    is looked at twice: once (state 0) to put what its triangles lead out to on the stack, and
    again, when it is on top once more and all of that is known, to take the least. Invariant: all
    in state 2 have their final `far`; those in state 1 are on the stack, each put there by one
    below it. To meet a half-edge in state 1 would be a circle, which a polygon without holes does
    not have. Every triangle is tried from each of its sides at most, so the time goes by their
    number.
    """
    _points, _edges, side, triangles, sides, start, items = candidates
    far, choice, state, seen = beyond
    waiting = np.empty(len(far), dtype=np.int64)
    waiting[0] = root
    height = 1
    while height > 0:
        h = waiting[height - 1]
        if state[h] == 2:
            height -= 1
            continue
        before = height
        best, which = _NOTHING, -1
        for place in range(start[h], start[h + 1]):
            t = items[place]
            if not alive[t]:
                continue
            seen[t] = True
            # Of a triangle some of whose sides are not known yet, the total is not used: `height`
            # has grown then, and the half-edge is looked at again.
            total, filled = weights[t], True
            for k in range(3):
                out = _way_out(triangles, sides, side, cut, t, k, h)
                if out < 0:
                    continue
                if state[out] == 2:
                    total += far[out]
                    filled &= choice[out] >= 0
                elif state[out] == 1 or state[h] == 1 or height == len(waiting):
                    return False
                else:
                    waiting[height] = out
                    height += 1
            if height == before and total < best:
                best, which = total, t if filled else -1
        if height == before:
            far[h], choice[h], state[h] = best, which, 2
            height -= 1
        else:
            state[h] = 1
    return True


@njit
def _way_out(
    triangles: np.ndarray,
    sides: np.ndarray,
    side: np.ndarray,
    cut: np.ndarray,
    t: int,
    k: int,
    h: int,
) -> int:
    """Return the half-edge that leads out of triangle t over side k, if it is entered by h.

    -1 where k is the side of h itself, or nothing is beyond it.
    """
    e = sides[t, k]
    if e == h // 2 or side[e] != 0 or cut[e]:
        return -1
    # The triangle runs along its own half-edge; the twin, run the other way, has what is beyond.
    return 2 * e + (triangles[t, k] < triangles[t, (k + 1) % 3])


@njit
def _trace(
    triangles: np.ndarray,
    sides: np.ndarray,
    side: np.ndarray,
    cut: np.ndarray,
    choice: np.ndarray,
    root: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangles chosen beyond `root`, and a place in the ring for each corner (m, 3).

    The ring is the boundary of the polygon as it is cut, counter-clockwise from the root; a site
    at which cuts end is in several places. Beyond a half-edge from p to q is the ring from q to p.
    """
    chosen = np.empty(len(triangles), dtype=np.int64)
    places = np.empty((len(triangles), 3), dtype=np.int32)
    waiting = np.empty(len(choice), dtype=np.int64)
    waiting[0] = root
    found, height = 0, 1
    while height > 0:
        height -= 1
        h = waiting[height]
        t = choice[h]
        chosen[found] = t
        found += 1
        for k in range(3):
            out = _way_out(triangles, sides, side, cut, t, k, h)
            if out >= 0:
                waiting[height] = out
                height += 1
    # The ring is walked in another pass: from the first corner of the root, sides in their order.
    row = np.empty(len(triangles), dtype=np.int64)
    for m in range(found):
        row[chosen[m]] = m
    place = 0
    waiting[0] = root
    step = np.zeros(len(choice), dtype=np.int8)
    height = 1
    while height > 0:
        h = waiting[height - 1]
        t = choice[h]
        m = row[t]
        first = 0
        while sides[t, first] != h // 2:
            first += 1
        # Side `first` runs from p to q: q, then what is beyond q-r, r, beyond r-p, p.
        k = (first + 1 + step[h]) % 3
        places[m, k] = place
        if step[h] == 2:
            height -= 1
            continue
        step[h] += 1
        out = _way_out(triangles, sides, side, cut, t, k, h)
        if out >= 0:
            waiting[height] = out
            height += 1
        else:
            place += 1
    return chosen[:found].copy(), places[:found].copy()


@njit(nogil=True)
def _fill_rest(
    chosen: np.ndarray,
    places: np.ndarray,
    candidates: Candidates,
    weights: np.ndarray,
    alive: np.ndarray,
    cut: np.ndarray,
    beyond: _Beyond,
) -> bool:
    """Fill the table for triangles that the root does not lead to, which need potentials, too.

    The inequality is asked for each remaining triangle, also for one that is in no triangulation by
    remaining ones: `_fill` from the root may never come to it. It holds once `far` is known for the
    half-edges out of two sides, and is the least over the triangles beyond the third.

    Which side is the third, the one that the root is behind? The ring is walked counter-clockwise
    from the root, and beyond a half-edge from p to q is the ring from q to p. Counter-clockwise
    a triangle has two sides that go on in the ring, from an earlier place to a later, and one that
    goes back: between the ends of that one the ring passes the root. So its first end is the later
    one, and the half-edge into the triangle over it, `out ^ 1`, is where `_fill` begins. A site at
    which cuts end is in the ring several times; `_place` says which place sees the other end. The
    optimum lays the ring out; all beyond its diagonals is filled already.

    Invariant: all remaining triangles before t were tried, so that their inequality holds. `_fill`
    takes what is known as it is, so all calls together try each triangle from each side once; a
    place takes as many steps as corners of the layout meet there.
    """
    points, _edges, side, triangles, sides, _start, _items = candidates
    begin, at = grouped(triangles[chosen].ravel(), len(points))
    for t in range(len(triangles)):
        if not alive[t] or beyond.seen[t]:
            continue
        for k in range(3):
            out = _way_out(triangles, sides, side, cut, t, k, -2)  # -2 // 2 is no edge: all three
            if out < 0 or beyond.state[out] == 2:
                continue  # nothing is beyond this side, or what is beyond is known: not the root
            a, b = triangles[t, k], triangles[t, (k + 1) % 3]  # `out` runs b to a
            first = _place(points, triangles, chosen, places, begin, at, a, b)
            last = _place(points, triangles, chosen, places, begin, at, b, a)
            if first > last >= 0:
                if not _fill(out ^ 1, candidates, weights, alive, cut, beyond):
                    return False
                break
        if not beyond.seen[t]:
            return False
    return True


@njit
def _place(
    points: np.ndarray,
    triangles: np.ndarray,
    chosen: np.ndarray,
    places: np.ndarray,
    begin: np.ndarray,
    at: np.ndarray,
    a: int,
    b: int,
) -> int:
    """Return the place in the ring of site `a` from which b is seen; -1 if there is none.

    begin, at: `at[begin[a]:begin[a + 1]]` are 3 m + k of the corners k of rows m that are at a.
    """
    for item in range(begin[a], begin[a + 1]):
        m, k = at[item] // 3, at[item] % 3
        t = chosen[m]
        p, q = triangles[t, (k + 1) % 3], triangles[t, (k + 2) % 3]
        if turn(points, a, p, b) > 0.0 and turn(points, a, b, q) > 0.0:
            return places[m, k]
    return -1
