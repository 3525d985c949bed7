"""Find an optimum and the evidence for it: exclusion, then the linear program, then branching."""

from typing import NamedTuple

import numpy as np

from triangulators.candidates import Candidates, candidates_of
from triangulators.certificate import Branch, Evidence, Leaf
from triangulators.cost import Cost
from triangulators.local_minimality import exclude
from triangulators.polygon import Boundary
from triangulators.predicates import turn
from triangulators.program import Solution, solve
from triangulators.units import Units, costs_of, units_for, weights_of

SECONDS = 60.0  # for the linear programs of one polygon
_WHOLE = 1e-6


class Proof(NamedTuple):
    """The best triangulation found (m, 3), between sites, and evidence of a bound."""

    triangles: np.ndarray
    evidence: Evidence


class _Search:
    """Branch and bound over one polygon's candidates."""

    def __init__(
        self, candidates: Candidates, weights: np.ndarray, units: Units, seconds: float
    ) -> None:
        self.candidates, self.weights, self.units = candidates, weights, units
        self.seconds = seconds
        self.light = weights / units.factor
        self.best = np.empty(0, dtype=np.int64)
        self.least = np.inf

    def offer(self, chosen: np.ndarray) -> None:
        """Keep a triangulation, given by the numbers of its triangles, if it is the best."""
        total = sum(self.weights[chosen].tolist())
        if total < self.least:
            self.best, self.least = chosen, total

    def node(self, allowed: np.ndarray, depth: int) -> Leaf | Branch:
        """Return evidence for the triangulations made of `allowed` triangles."""
        found = solve(self.candidates, self.light, allowed, self.best, self.seconds)
        if found.solved:
            whole = found.share > 1.0 - _WHOLE
            split = (found.share > _WHOLE) & ~whole
            if not split.any() and whole.any():
                self.offer(np.flatnonzero(whole))
            elif found.bound < self.least / self.units.factor - _WHOLE and depth < 40:
                return self._branch(allowed, found, depth)
        return self._leaf(allowed, found)

    def _branch(self, allowed: np.ndarray, found: Solution, depth: int) -> Branch:
        """Branch on the diagonal that is most nearly half chosen."""
        c = self.candidates
        chosen = np.zeros(len(c.edges))
        np.add.at(chosen, c.sides.ravel(), np.repeat(found.share, 3) / 2.0)  # from both sides
        chosen[c.side != 0] = 0.0
        edge = int(np.argmin(np.abs(chosen - 0.5)))
        a, b = c.edges[edge].tolist()
        without = allowed & ~(c.sides == edge).any(axis=1)
        crossing = np.array([_cross(c.points, a, b, *pair) for pair in c.edges.tolist()])
        within = allowed & ~crossing[c.sides].any(axis=1)
        return Branch((a, b), self.node(without, depth + 1), self.node(within, depth + 1))

    def _leaf(self, allowed: np.ndarray, found: Solution) -> Leaf:
        """Round potentials to integers; the lift makes up for what that breaks."""
        c = self.candidates
        potentials = np.rint(found.potentials * self.units.factor).astype(np.int64)
        ahead = c.triangles < np.roll(c.triangles, -1, axis=1)
        around = np.where(ahead, potentials[c.sides], -potentials[c.sides]).sum(axis=1)
        slack = (self.weights - around)[allowed]
        return Leaf(potentials, min(int(slack.min()), 0) if len(slack) else 0)


def prove(
    outline: Boundary, triangles: np.ndarray, cost: Cost, seconds: float = SECONDS
) -> Proof | None:
    """Improve a triangulation (m, 3), between sites, and find evidence of how good it is.

    seconds: for each linear program; one that is not solved in time gives a weak bound. None if
    the polygon has too many candidates.
    """
    candidates = candidates_of(outline, triangles)
    if candidates is None:
        return None
    costs = costs_of(candidates.points, candidates.triangles, *cost[:4])
    start = _numbers(candidates, triangles)
    largest, total = float(np.abs(costs).max()), float(np.abs(costs[start].sum()))
    units = units_for(candidates.points, cost, largest, total, outline.expected_triangles)
    weights = weights_of(candidates.points, candidates.triangles, *cost[:4], *units[:3])
    excluded, alive = exclude(candidates, weights, cost, units)
    search = _Search(candidates, weights, units, seconds)
    search.offer(start)
    root = search.node(alive, 0)
    evidence = Evidence(*units[:3], candidates.edges, excluded, root)
    return Proof(candidates.triangles[search.best], evidence)


def _numbers(candidates: Candidates, triangles: np.ndarray) -> np.ndarray:
    """Return the number of each triangle among the candidates."""
    n = len(candidates.points)
    keys = _keys(candidates.triangles, n)
    order = np.argsort(keys)
    return order[np.searchsorted(keys[order], _keys(triangles, n))]


def _keys(triangles: np.ndarray, n: int) -> np.ndarray:
    low, middle, high = np.sort(triangles.astype(np.int64), axis=1).T
    return (low * n + middle) * n + high


def _cross(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    if {a, b} & {c, d}:
        return False
    return turn(points, a, b, c) * turn(points, a, b, d) < 0.0 and (
        turn(points, c, d, a) * turn(points, c, d, b) < 0.0
    )
