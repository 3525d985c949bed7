"""Find an optimum and the evidence for it.

Local minimality excludes most edges. Where what is left connects the polygon's rings, a table
solves it (`skeleton`); otherwise the linear program does (`linear_program`).
"""

from dataclasses import dataclass

import numpy as np

from triangulators.certificate.candidates import Candidates, candidates_of
from triangulators.certificate.linear_program import Program
from triangulators.certificate.local_minimality import exclude, extend
from triangulators.certificate.skeleton import by_table
from triangulators.checking.evidence import Evidence
from triangulators.checking.units import Units, exact_total, is_proof, units_for, weights_of
from triangulators.criteria.cost import Cost
from triangulators.optimum.best_way import search_cuts
from triangulators.polygon import Boundary

# How much is tried. Where a limit is no time, the same is proven on any machine.
SECONDS = 60.0  # for a linear program, of which a polygon may need two
_QUICK_ROWS = 100_000  # rows of a program without a limit of time: some seconds
_QUICK = 1_500_000  # candidates, the same: excluding takes some seconds
MOST = 8_000_000  # candidates of one polygon: they are 1 GB
_HEAVIEST = 2.0**59  # potential: the checker adds three of less than 2^60 in 64 bits


@dataclass(frozen=True)
class Proof:
    """The best triangulation found, (m, 3) between sites, and potentials that bound all others.

    gap: how far the one may be from the bound, relative; 0 where it is proven optimal. The
    potentials (e,) and the lift hold for triangles of edges that were not `excluded`.
    """

    triangles: np.ndarray
    gap: float
    candidates: Candidates
    weights: np.ndarray
    units: Units
    excluded: np.ndarray
    potentials: np.ndarray
    lift: int

    def evidence(self) -> Evidence:
        """Return evidence of the bound for all triangles, those of excluded edges included.

        What `checker` has not looked at yet. It bounds next to nothing where a potential would be
        too large.
        """
        found = extend(self.candidates, self.weights, self.excluded, self.potentials)
        lift = self.lift
        if found is None:
            found, lift = np.zeros_like(self.potentials), min(0, int(self.weights.min()))
        return Evidence(*self.units[:3], self.candidates.edges, found, lift)


class _Search:
    """Look for the best triangulation of some candidates; `best` has its triangles' numbers."""

    def __init__(self, candidates: Candidates, weights: np.ndarray, units: Units) -> None:
        self.candidates, self.weights, self.units = candidates, weights, units
        self.best = np.empty(0, dtype=np.int64)
        self.least = np.inf

    def offer(self, chosen: np.ndarray) -> None:
        """Keep a triangulation, given by the numbers of its triangles, if it is the best.

        Not one with a triangle that is no candidate: none should be, but its weight is not known.
        """
        if (chosen < 0).any():
            return
        total = sum(self.weights[chosen].tolist())
        if total < self.least:
            self.best, self.least = chosen, total

    def solve(self, alive: np.ndarray, cost: Cost, seconds: float) -> tuple[np.ndarray, int]:
        """Offer an optimum of the triangles that are `alive` (t,); return potentials and a lift.

        They hold for those triangles and bound any triangulation of them from below; the lift is at
        most 0. By the table they meet the optimum. Where it is not for this polygon, the linear
        program's do if no triangle is chosen in part, and otherwise leave a gap. A program is
        solved where `seconds` are a limit, or where they are infinite and it is small.
        """
        c = self.candidates
        table = by_table(c, alive, cost, self.units)
        if table is not None:
            self.offer(_numbers(c, table[0]))
            return table[1], 0
        timed = 0.0 < seconds < np.inf
        asked = timed or (seconds > 0.0 and int(alive.sum()) <= _QUICK_ROWS)
        light = self.weights / self.units.factor  # in units, for the solver's doubles
        if asked:
            program = Program(c, light, alive, self.best)
            found = self._tried(alive, *program.solve(seconds))
            if self._is_met(*found):
                return found
        else:
            found = self._rounded(alive, np.zeros(len(c.edges)))
        # Nothing is proven yet. A better triangulation may be what is missing, or a better start.
        self.offer(_numbers(c, search_cuts(c.points, c.triangles[self.best], cost)))
        if asked and not self._is_met(*found):
            program = Program(c, light, alive, self.best)
            again = self._tried(alive, *program.solve(seconds, at_a_corner=True))
            found = max(found, again, key=lambda each: self.bound(*each))
        return found

    def _tried(
        self, alive: np.ndarray, potentials: np.ndarray, share: np.ndarray
    ) -> tuple[np.ndarray, int]:
        """Offer a program's triangles that are chosen by more than half, if they fit together."""
        c = self.candidates
        chosen = np.flatnonzero(share > 0.5)
        ahead = c.triangles[chosen] < np.roll(c.triangles[chosen], -1, axis=1)
        ways = np.where(ahead, 1, -1).ravel()
        # Each side of the boundary once, each diagonal as often from the left as from the right.
        if np.array_equal(np.bincount(c.sides[chosen].ravel(), ways, len(c.edges)), c.side):
            self.offer(chosen)
        return self._rounded(alive, potentials)

    def _rounded(self, alive: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, int]:
        """Round potentials to whole numbers; the lift makes up for what that breaks."""
        c = self.candidates
        heavy = light * self.units.factor
        heavy *= min(1.0, _HEAVIEST / max(float(np.abs(heavy).max()), 1.0))
        potentials = np.rint(heavy).astype(np.int64)
        ahead = c.triangles < np.roll(c.triangles, -1, axis=1)
        around = np.where(ahead, potentials[c.sides], -potentials[c.sides]).sum(axis=1)
        slack = (self.weights - around)[alive]
        return potentials, min(int(slack.min()), 0) if len(slack) else 0

    def bound(self, potentials: np.ndarray, lift: int) -> int:
        total: int = sum((potentials * self.candidates.side).tolist())
        return total + lift * len(self.best)

    def _is_met(self, potentials: np.ndarray, lift: int) -> bool:
        """Whether the bound meets the best: nothing is better by a unit."""
        factor = self.units.factor
        return self.bound(potentials, lift) // factor >= self.least // factor


def prove(
    outline: Boundary, triangles: np.ndarray, cost: Cost, seconds: float = SECONDS
) -> Proof | None:
    """Improve a triangulation (m, 3), between sites, and find how good it is.

    The evidence is about the triangulation given, and counts in its units. seconds: for each linear
    program; one that is not solved in time gives a weak bound. Where they are infinite, programs of
    more than 100,000 triangles are not tried; where they are 0 none is, which gives a weak bound,
    too. None if more than eight million triples of vertices see each other (1.5 million where
    seconds are 0 or infinite).
    """
    units = units_for(outline, triangles, cost)
    most = MOST if 0.0 < seconds < np.inf else _QUICK
    candidates = candidates_of(outline, triangles, most)
    if candidates is None:
        return None
    weights = weights_of(outline.points, candidates.triangles, cost, units)
    excluded, alive = exclude(candidates, weights, cost, units)
    search = _Search(candidates, weights, units)
    search.offer(_numbers(candidates, triangles))
    potentials, lift = search.solve(alive, cost, seconds)
    total, factor, bound = int(search.least), units.factor, search.bound(potentials, lift)
    found = candidates.triangles[search.best]
    proven = is_proof(exact_total(outline, found, cost, units), bound // factor, len(found), units)
    gap = 0.0 if proven else max(total - bound, factor) / max(abs(total), 1)
    return Proof(found, gap, candidates, weights, units, excluded, potentials, lift)


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
    keys: np.ndarray = (low * n + middle) * n + high
    return keys
