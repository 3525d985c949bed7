"""Find an optimum and the evidence for it.

Local minimality excludes most edges. Where what is left connects the polygon's rings, a table
solves it (`skeleton`); otherwise the linear program does (`linear_program`), and where that is not
whole, branching.
"""

from typing import NamedTuple

import numpy as np

from triangulators.certificate.candidates import Candidates, candidates_of, how_many
from triangulators.certificate.extend_potentials import TOO_LARGE, extend, extend_thinned
from triangulators.certificate.integer_costs import weights_of
from triangulators.certificate.linear_program import Program, Solution
from triangulators.certificate.local_minimality import exclude, thin
from triangulators.certificate.sight import Fans, Sight, fans_of, sight_of
from triangulators.certificate.skeleton import Across, by_table, parts_of, ways_across
from triangulators.checking.evidence import Branch, Evidence, Leaf
from triangulators.checking.units import Units, units_for
from triangulators.criteria.cost import Cost
from triangulators.geometry.predicates import crossed
from triangulators.optimum.local_search import search_cuts
from triangulators.polygon import Boundary

# How much is tried. Where a limit is no time, the same is proven on any machine.
SECONDS = 60.0  # for the linear programs of one polygon
_WHOLE = 1e-4  # share of a triangle that is as good as none or all: programs are solved to 1e-9
_DEEPEST = 40  # branches below each other
_MOST_WORK = 10**8  # triangles in all tables of one polygon: a minute
_QUICK_WORK, _QUICK_ROWS = 10**7, 100_000  # the same, and rows of a program: some seconds
_QUICK = 1_500_000  # candidates of one polygon: excluding takes some seconds
_MOST = 10**9  # the same: looking at each takes some minutes
_LISTED = 8_000_000  # the same: beyond, edges are thinned before triangles are listed
_LEFT = 64_000_000  # the same, after thinning: they are 6 GB
_WORTH = 0.1  # share of edges to be excluded for thinning to be tried
_HEAVIEST = 2.0**59  # potential: the checker adds three of less than 2^60 in 64 bits
_ENDLESS = 2**60 - 1  # weight that no triangulation reaches, and the largest the checker takes


class Proof(NamedTuple):
    """The best triangulation found (m, 3), between sites, and evidence of a bound.

    gap: how far the one may be from the other, relative; 0 where it is proven optimal. `checker`
    has not looked at the evidence yet.
    """

    triangles: np.ndarray
    evidence: Evidence
    gap: float


class _Search:
    """Branch and bound over one polygon's candidates."""

    def __init__(self, posed: "_Posed", cost: Cost, seconds: float) -> None:
        self.candidates, self.weights, self.units = posed.candidates, posed.weights, posed.units
        self.posed, self.cost, self.seconds = posed, cost, seconds
        # Without a time limit, work is limited to what takes seconds on any machine.
        self.timed = _is_timed(seconds)
        self.light = posed.weights / posed.units.factor
        self.best = np.empty(0, dtype=np.int64)
        self.least = np.inf

    def offer(self, chosen: np.ndarray) -> None:
        """Keep a triangulation, given by the numbers of its triangles, if it is the best."""
        total = sum(self.weights[chosen].tolist())
        if total < self.least:
            self.best, self.least = chosen, total

    def node(self, allowed: np.ndarray, depth: int) -> Leaf | Branch:
        """Return evidence for the triangulations made of `allowed` triangles."""
        parts = parts_of(self.candidates, allowed)
        if parts.number == 1:
            table = by_table(self.candidates, self.weights, allowed, parts.cut)
            if table is not None:
                if len(table.chosen):
                    self.offer(table.chosen)
                return self._leaf(table.potentials, 0)
        rows = int(allowed.sum())
        program = None
        if self.seconds > 0.0 and (self.timed or rows <= _QUICK_ROWS):
            program = Program(self.candidates, self.light, allowed, self.best)
        found = program.by_interior_point(self.seconds) if program else None
        leaf = self._tried(allowed, found)
        if self._is_proof(leaf):
            return leaf
        if depth == 0:
            self._search()
        if parts.number == 2:
            across = ways_across(self.candidates, allowed, parts.of)
            most = _MOST_WORK if self.timed else _QUICK_WORK
            if across is not None and len(across.ways) * rows <= most:
                return self._each_way(allowed, across, depth)
        if program is None or found is None:
            return leaf
        if not self._splits(found):
            found = program.by_simplex(self.seconds)
            leaf = self._tried(allowed, found)
        if depth < _DEEPEST and not self._is_proof(leaf) and self._splits(found):
            return self._branch(allowed, found, depth)
        return leaf

    def _tried(self, allowed: np.ndarray, found: Solution | None) -> Leaf:
        """Offer a program's solution; return the leaf that its potentials make."""
        if found is None:
            return self._rounded(allowed, np.zeros(len(self.candidates.edges)))
        if found.solved:
            self._offer_rounded(found.share)
        return self._rounded(allowed, found.potentials)

    def _splits(self, found: Solution) -> bool:
        """Whether a solution has triangles that are chosen in part, and could be improved on."""
        split = (found.share > _WHOLE) & (found.share < 1.0 - _WHOLE)
        better = found.bound < self.least / self.units.factor - _WHOLE
        return found.solved and better and bool(split.any())

    def _offer_rounded(self, share: np.ndarray) -> None:
        """Offer the triangles that are chosen by more than half, if they are a triangulation."""
        c = self.candidates
        chosen = np.flatnonzero(share > 0.5)
        ahead = c.triangles[chosen] < np.roll(c.triangles[chosen], -1, axis=1)
        ways = np.where(ahead, 1, -1).ravel()
        # Each side of the boundary once, each diagonal as often from the left as from the right.
        if np.array_equal(np.bincount(c.sides[chosen].ravel(), ways, len(c.edges)), c.side):
            self.offer(chosen)

    def _is_proof(self, leaf: Leaf) -> bool:
        """Whether a leaf shows that nothing is better than the best by a unit."""
        of_kept = leaf.potentials[self.posed.kept]
        on = self.candidates.side != 0
        around = sum((of_kept[on] * self.candidates.side[on]).tolist())
        bound = int(around) + leaf.lift * len(self.best)
        return bound // self.units.factor >= self.least // self.units.factor

    def _search(self) -> None:
        """Improve the best by the local search, as a start that the linear program goes on from."""
        c = self.candidates
        found = _numbers(c, search_cuts(c.points, c.triangles[self.best], self.cost))
        if (found >= 0).all():  # otherwise it has edges that are in no optimum
            self.offer(found)

    def _each_way(self, allowed: np.ndarray, across: Across, depth: int) -> Leaf | Branch:
        """Take each way to the other part as given; there must be one."""
        c = self.candidates
        found = []
        for edge in across.ways.tolist():
            a, b = c.edges[edge].tolist()
            within = allowed & ~crossed(c.points, c.edges, a, b)[c.sides].any(axis=1)
            found.append(((a, b), self.node(within, depth + 1)))
            allowed = allowed & ~(c.sides == edge).any(axis=1)
        # No triangle is left at this side of the boundary: its potential may be what it likes.
        potentials = np.zeros(len(c.edges), dtype=np.int64)
        potentials[across.edge] = int(c.side[across.edge]) * _ENDLESS
        node: Leaf | Branch = self._leaf(potentials, 0)
        for pair, within_it in reversed(found):
            node = Branch(pair, node, within_it)
        return node

    def _branch(self, allowed: np.ndarray, found: Solution, depth: int) -> Branch:
        """Branch on the diagonal that is most nearly half chosen."""
        c = self.candidates
        chosen = np.zeros(len(c.edges))
        np.add.at(chosen, c.sides.ravel(), np.repeat(found.share, 3) / 2.0)  # from both sides
        chosen[c.side != 0] = 0.0
        edge = int(np.argmin(np.abs(chosen - 0.5)))
        a, b = c.edges[edge].tolist()
        without = allowed & ~(c.sides == edge).any(axis=1)
        within = allowed & ~crossed(c.points, c.edges, a, b)[c.sides].any(axis=1)
        return Branch((a, b), self.node(without, depth + 1), self.node(within, depth + 1))

    def _rounded(self, allowed: np.ndarray, light: np.ndarray) -> Leaf:
        """Round potentials to integers; the lift makes up for what that breaks.

        Where no triangulation is left, a program's potentials may grow without end. A part of them
        is as good: nothing asks for more than a share of each triangle's weight.
        """
        c = self.candidates
        heavy = light * self.units.factor
        heavy *= min(1.0, _HEAVIEST / max(float(np.abs(heavy).max()), 1.0))
        potentials = np.rint(heavy).astype(np.int64)
        ahead = c.triangles < np.roll(c.triangles, -1, axis=1)
        around = np.where(ahead, potentials[c.sides], -potentials[c.sides]).sum(axis=1)
        slack = (self.weights - around)[allowed]
        return self._leaf(potentials, min(int(slack.min()), 0) if len(slack) else 0)

    def _leaf(self, potentials: np.ndarray, lift: int) -> Leaf:
        of_all = np.zeros(self.posed.edges, dtype=np.int64)
        of_all[self.posed.kept] = potentials
        return Leaf(of_all, lift)


def prove(
    outline: Boundary, triangles: np.ndarray, cost: Cost, seconds: float = SECONDS
) -> Proof | None:
    """Improve a triangulation (m, 3), between sites, and find evidence of how good it is.

    The evidence is about the triangulation given, and counts in its units. seconds: for each linear
    program; one that is not solved in time gives a weak bound. Where they are infinite, programs of
    more than 100,000 triangles are not tried; where they are 0 none is, which gives a weak bound,
    too. None if the polygon has too many candidates, or costs that 64 bits cannot hold.
    """
    units = units_for(outline, triangles, cost)
    sight = sight_of(outline, triangles)
    most = _MOST if _is_timed(seconds) else _QUICK
    room = how_many(sight, most)
    if room > most or units.wide:
        return None
    posed = _posed(sight, triangles, cost, units, room)
    if posed is None:
        return None
    candidates = posed.candidates
    excluded, alive = exclude(candidates, posed.weights, cost, units, posed.out)
    search = _Search(posed, cost, seconds)
    search.offer(_numbers(candidates, triangles))
    root = search.node(alive, 0)
    evidence = _evidence(posed, sight, excluded, root, cost)
    total, factor = int(search.least), units.factor
    bound = _bound(sight.side, root, outline.expected_triangles)
    # Where costs are rounded, an optimum may seem to cost a unit more for each of its triangles.
    rounded = 0 if units.exact else outline.expected_triangles - 1
    equal = (bound // factor) + rounded >= total // factor and (units.exact or units.real)
    gap = 0.0 if equal else max(total - bound, factor) / max(abs(total), 1)
    return Proof(candidates.triangles[search.best], evidence, gap)


def _evidence(
    posed: "_Posed", sight: Sight, excluded: np.ndarray, root: Leaf | Branch, cost: Cost
) -> Evidence:
    """Return evidence in which, if possible, potentials stand in for exclusions."""
    if isinstance(root, Leaf):
        of_kept = root.potentials[posed.kept]
        kept = extend(posed.candidates, posed.weights, excluded, of_kept, posed.out)
        potentials = np.zeros(len(sight.edges), dtype=np.int64)
        if kept is not None:
            potentials[posed.kept] = kept
            if posed.fans is not None:
                extend_thinned(sight, posed.fans, posed.thinned, potentials, cost, posed.units)
            if np.abs(potentials).max() < TOO_LARGE:
                leaf = Leaf(potentials, root.lift)
                return Evidence(*posed.units[:3], sight.edges, excluded[:0], leaf)
    order = np.concatenate((posed.thinned, posed.kept[excluded]))
    return Evidence(*posed.units[:3], sight.edges, order, root)


class _Posed(NamedTuple):
    """What is searched: candidates with their weights (t,), among `edges` edges of the polygon.

    kept (e,): the candidates' edges, by their numbers in the polygon; thinned (k,): edges that are
    excluded before, in that order, by `fans`, if any; out (e,): those of them that the start needs
    and that are kept.
    """

    candidates: Candidates
    weights: np.ndarray
    units: Units
    edges: int
    kept: np.ndarray
    thinned: np.ndarray
    out: np.ndarray
    fans: Fans | None


def _posed(sight: Sight, start: np.ndarray, cost: Cost, units: Units, room: int) -> _Posed | None:
    """Return candidates with weights; where there are many, edges are thinned before.

    room: what `how_many` says. None where thinning leaves too many, or does not pay.
    """
    points = sight.points
    out, fans = np.zeros(len(sight.edges), dtype=np.bool_), None
    thinned, kept = np.empty(0, dtype=np.int32), np.arange(len(sight.edges))
    if room > _LISTED:
        fans = fans_of(sight)
        found = thin(sight, fans, cost, units, _WORTH)
        if found is None:
            return None
        thinned = found
        out[thinned] = True
        kept = np.flatnonzero(~out | _has_edges(sight.edges, start, len(points)))
        room = how_many(sight, _LEFT, kept)
        if room > _LEFT:
            return None
    candidates = candidates_of(sight, room, kept)
    weights = weights_of(points, candidates.triangles, cost, units)
    return _Posed(candidates, weights, units, len(sight.edges), kept, thinned, out[kept], fans)


def _has_edges(edges: np.ndarray, triangles: np.ndarray, n: int) -> np.ndarray:
    """Return which edges (e,) are sides of triangles (m, 3)."""
    sides = np.sort(np.stack((triangles, np.roll(triangles, -1, axis=1)), axis=-1), axis=-1)
    sides = sides.reshape(-1, 2).astype(np.int64)
    keys = edges[:, 0].astype(np.int64) * n + edges[:, 1]
    return np.isin(keys, sides[:, 0] * n + sides[:, 1])


def _is_timed(seconds: float) -> bool:
    return 0.0 < seconds < np.inf


def _bound(side: np.ndarray, node: Leaf | Branch, count: int) -> int:
    """Return the bound that evidence gives a triangulation of `count` triangles, in weights."""
    if isinstance(node, Branch):
        return min(_bound(side, case, count) for case in (node.without, node.within))
    return sum((node.potentials * side).tolist()) + node.lift * count


def _numbers(candidates: Candidates, triangles: np.ndarray) -> np.ndarray:
    """Return the number of each triangle among the candidates, -1 where it is none."""
    n = len(candidates.points)
    keys = _keys(candidates.triangles, n)
    order = np.argsort(keys)
    wanted = _keys(triangles, n)
    at = order[np.minimum(np.searchsorted(keys[order], wanted), len(order) - 1)]
    return np.where(keys[at] == wanted, at, -1)


def _keys(triangles: np.ndarray, n: int) -> np.ndarray:
    low, middle, high = np.sort(triangles.astype(np.int64), axis=1).T
    return (low * n + middle) * n + high
