"""Check a certificate of optimality: exact arithmetic, and nothing of the search that found it.

What is checked, from the polygon's boundary and the criterion alone:

1. The polygon's edges and empty triangles are enumerated here, from exact orientations: a pair of
   sites is an edge if the segment starts into the interior at both ends and meets no boundary edge;
   a triangle is three edges that run round no hole. Their weights are integers (see `Evidence`).
2. Each excluded edge, in the evidence's order: every pair of triangles of edges not yet excluded,
   one on each of its sides, makes a convex quadrilateral whose other diagonal weighs less. So no
   triangulation of least weight contains the edge (flipping would make it lighter).
3. With y the potential of an edge (its negative, run the other way), y(ab) + y(bc) + y(ca) + lift
   is at most the weight of abc, for every triangle of edges that are not excluded. Triangles are
   found from what the two ends of an edge see, one after the other: none are kept. Summed over a
   triangulation the potentials of diagonals cancel: what is left is the sum over the boundary plus
   lift times the number of triangles. That is the lower bound. Where the evidence branches, once
   with an edge and once without it, the lower of the two bounds holds.

Shared with the rest of the package are the definitions: a polygon's boundary, the sign of an
orientation and the criteria's features.
"""

from typing import Any, NamedTuple

import numpy as np

from triangulators.checking.evidence import Branch, Evidence, Leaf, Refused
from triangulators.checking.visibility import visible
from triangulators.compute.kernels import njit
from triangulators.compute.threads import shared_out
from triangulators.criteria.cost import Cost, cost_at
from triangulators.geometry.predicates import turn
from triangulators.polygon import Boundary

_FEW, _SLICES = 20_000, 16  # edges from which on they are shared out among threads; slices
_TOO_LARGE = 2**60  # weight of a triangle whose weight does not fit


def lower_bound(outline: Boundary, cost: Cost, evidence: Evidence) -> int:
    """Return the bound, in weights, that the evidence proves; raises `Refused` if it does not."""
    _check_units(outline, evidence)
    edges = _edges_of(outline)
    excluded = np.zeros(len(edges.ends), dtype=np.bool_)
    order = edges.find(evidence.edges[evidence.excluded])
    order = order[order >= 0]  # what is no edge needs no excluding
    if len(np.unique(order)) != len(order):
        raise Refused("an edge is excluded twice")
    if len(order):
        _check_excluded(edges, order, _terms(cost, evidence))
    excluded[order] = True
    given = _Given(edges, evidence, edges.find(evidence.edges), _terms(cost, evidence))
    return _bound(given, evidence.root, excluded, outline.expected_triangles)


def _check_excluded(edges: "_Edges", order: np.ndarray, terms: "_Terms") -> None:
    """Raise `Refused` unless each edge of `order` may be excluded after those before it."""
    turn_of = np.full(len(edges.ends), len(edges.ends), dtype=np.int64)
    turn_of[order] = np.arange(len(order))
    given = (edges.points, edges.ends, edges.ways, edges.holes)
    fans = _fans(edges.ends, len(edges.points))
    slices = _SLICES if len(order) > _FEW else 1

    def wrong_one(number: int) -> int:
        return int(_replay(*given, *fans, order[number::slices], turn_of, terms))

    # Each is checked by itself: which ones went before is known from their turns.
    wrong = [number for number in shared_out(wrong_one, slices) if number >= 0]
    if _TOO_LARGE in wrong:
        raise Refused("a weight is too large for exact arithmetic")
    if wrong:
        a, b = edges.ends[min(wrong, key=lambda e: turn_of[e])].tolist()
        raise Refused(f"the edge {a}-{b} is excluded, but may be part of an optimum")


class _Edges(NamedTuple):
    """Edges of a polygon: ends (e, 2), a < b, ascending; keys (e,) the same as numbers.

    ways (e,): 1 if a-b is boundary, -1 if b-a is, otherwise 0. holes (h, 4): sites of each hole,
    -1 where it has fewer.
    """

    points: np.ndarray
    ends: np.ndarray
    keys: np.ndarray
    ways: np.ndarray
    holes: np.ndarray

    def find(self, pairs: np.ndarray) -> np.ndarray:
        """Return the number of each pair (k, 2) among the edges, -1 where it is none."""
        pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        wanted = pairs.min(axis=1) * len(self.points) + pairs.max(axis=1)
        at = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        return np.where(self.keys[at] == wanted, at, -1)


class _Terms(NamedTuple):
    """What `_weight` makes weights of: the criterion, and how `Evidence` counts its costs."""

    cost: Cost
    scale: float
    factor: int
    bits: int


class _Given(NamedTuple):
    """Evidence about edges; at (k,): the numbers of its own edges."""

    edges: _Edges
    evidence: Evidence
    at: np.ndarray
    terms: _Terms


def _terms(cost: Cost, evidence: Evidence) -> _Terms:
    return _Terms(cost, evidence.scale, evidence.factor, evidence.bits)


def _check_units(outline: Boundary, evidence: Evidence) -> None:
    if not 0 <= evidence.bits <= 20 or evidence.scale <= 0.0:
        raise Refused("the units cannot be used")
    if evidence.factor <= 3 * (2**evidence.bits - 1) * outline.expected_triangles:
        raise Refused("the noise of a triangulation may exceed a unit")


def _edges_of(outline: Boundary) -> _Edges:
    points, n = outline.points, len(outline.points)
    diagonals = visible(points, outline.edges, outline.site)
    pairs = np.sort(np.concatenate((outline.edges, diagonals)).astype(np.int64), axis=1)
    ways = np.zeros(len(pairs), dtype=np.int8)
    ways[: len(outline.edges)] = np.where(outline.edges[:, 0] < outline.edges[:, 1], 1, -1)
    keys = pairs[:, 0] * n + pairs[:, 1]
    order = np.argsort(keys)
    rings = np.split(outline.site, outline.ends[:-1])
    holes = np.full((len(rings) - 1, 4), -1, dtype=np.int32)
    for row, ring in zip(holes, rings[1:], strict=True):
        few = np.unique(ring)[:4]
        row[: len(few)] = few
    return _Edges(points, pairs[order].astype(np.int32), keys[order], ways[order], holes)


def _bound(given: _Given, node: Leaf | Branch, out: np.ndarray, count: int) -> int:
    """Return the bound for triangulations of `count` triangles without the edges that are out."""
    edges = given.edges
    if isinstance(node, Branch):
        edge = int(edges.find(np.array([node.edge]))[0])
        if edge < 0 or edges.ways[edge] != 0:
            raise Refused(f"the evidence branches on {node.edge}, which is no diagonal")
        without, crossing = out.copy(), out.copy()
        without[edge] = True
        crossing |= _crossed(edges.points, edges.ends, *edges.ends[edge].tolist())
        return min(
            _bound(given, node.without, without, count),
            _bound(given, node.within, crossing, count),
        )
    potentials = np.asarray(node.potentials, dtype=np.int64)
    if len(potentials) != len(given.at):
        raise Refused("potentials and edges differ in number")
    if len(potentials) and max(int(potentials.max()), -int(potentials.min())) >= 2**60:
        raise Refused("a potential is too large for exact arithmetic")
    potential = np.zeros(len(edges.ends), dtype=np.int64)
    potential[given.at[given.at >= 0]] = potentials[given.at >= 0]
    _check_triangles(given, potential, node.lift, np.flatnonzero(~out))
    on = edges.ways != 0
    return int(sum((potential[on] * edges.ways[on]).tolist())) + node.lift * count


def _check_triangles(given: _Given, potential: np.ndarray, lift: int, left: np.ndarray) -> None:
    """Raise `Refused` unless every empty triangle of the edges that are left holds potentials."""
    edges = given.edges
    n = len(edges.points)
    starts = np.searchsorted(edges.keys[left], np.arange(n + 1, dtype=np.int64) * n)
    of_left = (edges.points, edges.ends[left], edges.ways[left], starts, edges.holes)
    least = max(min(lift, _TOO_LARGE), -_TOO_LARGE)
    held: tuple[Any, ...] = (*of_left, potential[left], least, given.terms)
    slices = _SLICES if len(left) > _FEW else 1

    def worst_of(number: int) -> list[int]:
        return list(_exceeded(*(*held, number, slices)).tolist())

    wrong = [each for each in shared_out(worst_of, slices) if each]
    if wrong and len(wrong[0]) == 1:
        raise Refused("a weight is too large for exact arithmetic")
    if wrong:
        raise Refused(f"the potentials exceed the weight of the triangle {wrong[0]}")


@njit
def _mixed(a: int, b: int, bits: int) -> np.int64:
    """The noise of an edge, as `Evidence` defines it."""
    x = np.uint64(min(a, b)) * np.uint64(0x9E3779B97F4A7C15)
    x += np.uint64(max(a, b)) * np.uint64(0xD1B54A32D192ED03)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    x ^= x >> np.uint64(31)
    return np.int64(x >> np.uint64(64 - bits)) if bits > 0 else np.int64(0)


@njit
def _weight(points: np.ndarray, i: int, j: int, k: int, terms: _Terms) -> np.int64:
    while i > j or i > k:
        i, j, k = j, k, i
    bits, scaled = terms.bits, cost_at(points, i, j, k, terms.cost) * terms.scale
    if not abs(scaled) * terms.factor < 2.0**59:
        return np.int64(_TOO_LARGE)
    units = np.int64(np.floor(scaled)) * terms.factor
    return units + _mixed(i, j, bits) + _mixed(j, k, bits) + _mixed(k, i, bits)


@njit
def _fans(ends: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (start, other, over): site v sees `other[start[v]:start[v + 1]]` along edges `over`.

    The sites are ascending.
    """
    start = np.zeros(n + 2, dtype=np.int64)
    for e in range(len(ends)):
        for v in ends[e]:
            start[v + 2] += 1
    start = start.cumsum()
    other, over = np.empty(2 * len(ends), dtype=np.int32), np.empty(2 * len(ends), dtype=np.int32)
    for end in (1, 0):  # first the lower ones of each site
        for e in range(len(ends)):
            v = ends[e, end]
            other[start[v + 1]], over[start[v + 1]] = ends[e, 1 - end], e
            start[v + 1] += 1
    return start[:-1].copy(), other, over


@njit
def _third_corners(
    points: np.ndarray,
    ways: np.ndarray,
    start: np.ndarray,
    other: np.ndarray,
    over: np.ndarray,
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
    found = 0
    p, q = start[a], start[b]
    while p < start[a + 1] and q < start[b + 1]:
        c = other[p]
        if c < other[q]:
            p += 1
        elif c > other[q]:
            q += 1
        else:
            from_b, to_a = over[q], over[p]
            wrong = (1 if b > c else -1) * ways[from_b] > 0 or (1 if c > a else -1) * ways[to_a] > 0
            there = turn_of[from_b] >= now and turn_of[to_a] >= now
            if there and not wrong and turn(points, a, b, c) > 0.0:
                corners[found] = c
                found += 1
            p += 1
            q += 1
    return found


@njit(nogil=True)
def _replay(
    points: np.ndarray,
    ends: np.ndarray,
    ways: np.ndarray,
    holes: np.ndarray,
    start: np.ndarray,
    other: np.ndarray,
    over: np.ndarray,
    which: np.ndarray,
    turn_of: np.ndarray,
    terms: _Terms,
) -> int:
    """Return the first edge of `which` that must not be excluded in its turn, or -1.

    turn_of (e,): those that are excluded before it have a lower turn. `_TOO_LARGE` where a weight
    is.
    """
    left, right = np.empty(len(points), dtype=np.int32), np.empty(len(points), dtype=np.int32)
    lefts, rights = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    for e in which:
        if ways[e] != 0:
            return e
        a, b = ends[e, 0], ends[e, 1]
        now = turn_of[e]
        on_left = _third_corners(points, ways, start, other, over, turn_of, now, a, b, left)
        on_right = _third_corners(points, ways, start, other, over, turn_of, now, b, a, right)
        for p in range(on_left):
            lefts[p] = _weight(points, a, b, left[p], terms)
        for q in range(on_right):
            rights[q] = _weight(points, b, a, right[q], terms)
        for p in range(on_left):
            for q in range(on_right):
                c, d = left[p], right[q]
                lighter = False
                if turn(points, c, d, b) > 0.0 and turn(points, d, c, a) > 0.0:
                    one, two = _weight(points, c, d, b, terms), _weight(points, d, c, a, terms)
                    if max(one, two, lefts[p], rights[q]) >= _TOO_LARGE:
                        return _TOO_LARGE
                    lighter = one + two < lefts[p] + rights[q]
                if (
                    not lighter
                    and not _around_hole(points, holes, a, b, c, 1)
                    and not _around_hole(points, holes, b, a, d, 1)
                ):
                    return e
    return -1


@njit
def _crossed(points: np.ndarray, edges: np.ndarray, a: int, b: int) -> np.ndarray:
    """Return which edges cross a-b."""
    result = np.zeros(len(edges), dtype=np.bool_)
    for e in range(len(edges)):
        c, d = edges[e, 0], edges[e, 1]
        if c != a and c != b and d != a and d != b:
            result[e] = (turn(points, a, b, c) > 0.0) != (turn(points, a, b, d) > 0.0) and (
                turn(points, c, d, a) > 0.0
            ) != (turn(points, c, d, b) > 0.0)
    return result


@njit(nogil=True)
def _exceeded(
    points: np.ndarray,
    ends: np.ndarray,
    ways: np.ndarray,
    starts: np.ndarray,
    samples: np.ndarray,
    potential: np.ndarray,
    lift: int,
    terms: _Terms,
    number: int,
    slices: int,
) -> np.ndarray:
    """Return an empty triangle whose weight the potentials exceed by more than -lift.

    Triangles are found by merging the sorted lists of what the ends of an edge see, from every
    `slices`-th edge on. An empty array if there is none, one of length 1 where a weight is too
    large.
    """
    for e in range(number, len(ends), slices):
        a, b = ends[e, 0], ends[e, 1]
        p, q = e + 1, starts[b]
        while p < starts[a + 1] and q < starts[b + 1]:
            if ends[p, 1] < ends[q, 1]:
                p += 1
            elif ends[p, 1] > ends[q, 1]:
                q += 1
            else:
                c = ends[p, 1]
                run = 1 if turn(points, a, b, c) > 0.0 else -1
                wrong = ways[e] == -run or ways[q] == -run or ways[p] == run
                if not wrong and not _around_hole(points, samples, a, b, c, run):
                    i, j, k = (a, b, c) if run > 0 else (a, c, b)
                    weight = _weight(points, i, j, k, terms)
                    if weight >= _TOO_LARGE:
                        return np.zeros(1, dtype=np.int32)
                    # Counter-clockwise a-b-c runs a to b, b to c and c to a.
                    around = run * (potential[e] + potential[q] - potential[p])
                    if weight - around < lift:
                        return np.array((i, j, k), dtype=np.int32)
                p += 1
                q += 1
    return np.empty(0, dtype=np.int32)


@njit
def _around_hole(points: np.ndarray, samples: np.ndarray, a: int, b: int, c: int, run: int) -> bool:
    """Whether a triangle of edges runs round a hole: all sites of one are inside or corners."""
    for hole in range(len(samples)):
        for v in samples[hole]:
            if v < 0 or v == a or v == b or v == c:  # noqa: SIM109 - for Numba
                continue
            inside = (
                run * turn(points, a, b, v) > 0.0
                and run * turn(points, b, c, v) > 0.0
                and run * turn(points, c, a, v) > 0.0
            )
            if inside:
                return True
            break
    return False
