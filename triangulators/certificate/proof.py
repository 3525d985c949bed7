"""Find the triangulation of minimum cost, and a lower bound of every triangulation's cost.

Local minimality excludes most edges (`local_minimality`). If the uncrossed edges among those that
remain connect the polygon's rings, a dynamic program finds the optimum (`skeleton`), otherwise a
linear program does (`linear_program`). Vertices of triangles are sites (see `polygon.Boundary`).
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from triangulators.certificate.bridges import solve_by_bridges
from triangulators.certificate.candidates import Candidates, find_candidates
from triangulators.certificate.linear_program import LinearProgram
from triangulators.certificate.local_minimality import exclude_edges, extend_potentials
from triangulators.certificate.skeleton import solve_skeleton
from triangulators.checking.evidence import Evidence
from triangulators.checking.units import (
    Units,
    compute_exact_total,
    compute_weights,
    find_units,
    proves_optimality,
)
from triangulators.criteria.cost import Cost
from triangulators.initial import find_any_triangulation, find_best_initial
from triangulators.optimum.best_way import optimise_along_random_trees
from triangulators.optimum.visible_lists import INFEASIBLE_WEIGHT
from triangulators.polygon import Boundary

PROGRAM_TIMEOUT_S = 60.0  # time limit of a linear program; a polygon may need two programs
# Used if no time limit is given: these limits of size end a proof within seconds, but do not depend
# on the machine's speed as a time limit does.
_MAX_UNTIMED_ROWS = 100_000  # maximum number of constraints of a linear program
_MAX_UNTIMED_TRIPLES = 1_500_000  # maximum number of triples of mutually visible sites
MAX_TRIPLES = 8_000_000  # maximum number of such triples if there is a time limit; about 1 GB
_MAX_POTENTIAL = 2.0**59  # the checker adds three potentials below 2^60 in 64 bits


@dataclass(frozen=True)
class Proof:
    """The best triangulation found, and potentials that bound the cost of all others."""

    triangles: np.ndarray  # (m, 3)
    gap: float
    candidates: Candidates
    weights: np.ndarray  # (t,), of the candidate triangles
    units: Units
    excluded: np.ndarray  # (k,): edges in order of exclusion
    potentials: np.ndarray  # (e,): valid, with `lift`, for triangles without an excluded edge
    lift: int

    def make_evidence(self) -> Evidence:
        """Return unchecked evidence of the bound, with potentials also for the excluded edges.

        If such a potential would be too large for the checker, the evidence is of a weak bound.
        """
        potentials = extend_potentials(
            self.candidates, self.weights, self.excluded, self.potentials
        )
        lift = self.lift
        if potentials is None:
            potentials, lift = np.zeros_like(self.potentials), min(0, int(self.weights.min()))
        return Evidence(*self.units[:3], self.candidates.edges, potentials, lift)


class _Search:
    """Search for the triangulation of minimum weight, and a lower bound of all weights."""

    def __init__(self, candidates: Candidates, weights: np.ndarray, units: Units) -> None:
        self.candidates, self.weights, self.units = candidates, weights, units
        self.incumbent = np.empty(0, dtype=np.int64)
        self.min_weight = np.inf

    def update_incumbent(self, selection: np.ndarray) -> None:
        """Make a lighter `selection` (m,) the incumbent, unless an index is -1 (no candidate)."""
        if (selection < 0).any():
            return
        total = sum(self.weights[selection].tolist())
        if total < self.min_weight:
            self.incumbent, self.min_weight = selection, total

    def solve(self, alive: np.ndarray, cost: Cost, seconds: float) -> tuple[np.ndarray, int]:
        """Optimise over the candidates flagged in `alive` (t,); return potentials and a lift <= 0.

        The bound equals the optimum if the dynamic program applies, or if the linear program's
        solution is integral. `seconds`: see `prove`.
        """
        c = self.candidates
        optimum = solve_skeleton(c, alive, cost, self.units)
        if optimum is not None:
            self.update_incumbent(_find_candidate_indices(c, optimum[0]))
            return optimum[1], 0
        timed = 0.0 < seconds < np.inf
        uses_program = timed or (seconds > 0.0 and int(alive.sum()) <= _MAX_UNTIMED_ROWS)
        # Costs in units, the noise as a fraction: integer weights have more bits than doubles.
        cost_weights = self.weights / self.units.factor
        if uses_program:
            program = LinearProgram(c, cost_weights, alive, self.incumbent)
            dual = self._evaluate_solution(alive, *program.solve(seconds))
            if self._is_bound_tight(*dual):
                return dual
        else:
            dual = self._round_potentials(alive, np.zeros(len(c.edges)))
        # Not proven yet: local search may find a better incumbent, which the retry starts from.
        self.update_incumbent(
            _find_candidate_indices(
                c, optimise_along_random_trees(c.points, c.triangles[self.incumbent], cost)
            )
        )
        if uses_program and not self._is_bound_tight(*dual):
            program = LinearProgram(c, cost_weights, alive, self.incumbent)
            retry = self._evaluate_solution(alive, *program.solve(seconds, basic=True))
            dual = max(dual, retry, key=lambda pair: self.compute_bound(*pair))
        return dual

    def _evaluate_solution(
        self, alive: np.ndarray, potentials: np.ndarray, share: np.ndarray
    ) -> tuple[np.ndarray, int]:
        """Return a linear program's potentials as integers, and the lift; update the incumbent."""
        c = self.candidates
        selection = np.flatnonzero(share > 0.5)
        is_forward = c.triangles[selection] < np.roll(c.triangles[selection], -1, axis=1)
        signs = np.where(is_forward, 1, -1).ravel()
        # In a triangulation each boundary edge is a side of one triangle, and each diagonal of as
        # many triangles on the left as on the right.
        if np.array_equal(np.bincount(c.sides[selection].ravel(), signs, len(c.edges)), c.side):
            self.update_incumbent(selection)
        return self._round_potentials(alive, potentials)

    def _round_potentials(self, alive: np.ndarray, in_units: np.ndarray) -> tuple[np.ndarray, int]:
        """Return the potentials `in_units` (e,), converted to integer weights, and the lift."""
        c = self.candidates
        scaled = in_units * self.units.factor
        scaled *= min(1.0, _MAX_POTENTIAL / max(float(np.abs(scaled).max()), 1.0))
        potentials = np.rint(scaled).astype(np.int64)
        is_forward = c.triangles < np.roll(c.triangles, -1, axis=1)
        sums = np.where(is_forward, potentials[c.sides], -potentials[c.sides]).sum(axis=1)
        slack = (self.weights - sums)[alive]
        return potentials, min(int(slack.min()), 0) if len(slack) else 0

    def compute_bound(self, potentials: np.ndarray, lift: int) -> int:
        total: int = sum((potentials * self.candidates.side).tolist())
        return total + lift * len(self.incumbent)

    def _is_bound_tight(self, potentials: np.ndarray, lift: int) -> bool:
        factor = self.units.factor
        return self.compute_bound(potentials, lift) // factor >= self.min_weight // factor


def prove(
    outline: Boundary, triangles: np.ndarray, cost: Cost, seconds: float = PROGRAM_TIMEOUT_S
) -> Proof | None:
    """Improve a triangulation (m, 3), and bound its gap to the optimum.

    seconds: time limit of each linear program, whose bound is weak if the limit is reached;
    infinite: solve only programs of up to 100,000 triangles; 0: solve no linear program. None if
    more than eight million triples of sites see each other, 1.5 million without a time limit.
    """
    reduced = _find_reduced_candidates(outline, triangles, cost, seconds)
    return None if reduced is None else _prove_reduced(outline, triangles, cost, seconds, *reduced)


def minimise_cost(outline: Boundary, cost: Cost, seconds: float) -> tuple[np.ndarray, float] | None:
    """Return the best triangulation found (m, 3) and its gap, without evidence; see `prove`."""
    reduced = _find_reduced_candidates(outline, find_any_triangulation(outline), cost, seconds)
    if reduced is None:
        return None
    candidates, weights, units, _, alive = reduced
    if outline.has_plain_rings:
        selection = solve_by_bridges(
            candidates, outline.ring_offsets, alive, weights, INFEASIBLE_WEIGHT
        )
        if len(selection) > 0:
            triangles = candidates.triangles[selection]
            total: int = sum(weights[selection].tolist())
            return triangles, _compute_gap(outline, triangles, cost, units, total, total)
    proof = _prove_reduced(outline, find_best_initial(outline, cost), cost, seconds, *reduced)
    return proof.triangles, proof.gap


_Reduced: TypeAlias = tuple[Candidates, np.ndarray, Units, np.ndarray, np.ndarray]
"""Candidates, weights (t,), units of weights, excluded edges (k,), flags (t,) of the remaining
triangles: those without an excluded edge."""


def _find_reduced_candidates(
    outline: Boundary, triangles: np.ndarray, cost: Cost, seconds: float
) -> _Reduced | None:
    """Return candidates after excluding edges, or None if there are too many visible triples."""
    units = find_units(outline, triangles, cost)
    max_triples = MAX_TRIPLES if 0.0 < seconds < np.inf else _MAX_UNTIMED_TRIPLES
    candidates = find_candidates(outline, triangles, max_triples)
    if candidates is None:
        return None
    weights = compute_weights(outline.points, candidates.triangles, cost, units)
    excluded, alive = exclude_edges(candidates, weights, cost, units)
    return candidates, weights, units, excluded, alive


def _prove_reduced(
    outline: Boundary,
    triangles: np.ndarray,
    cost: Cost,
    seconds: float,
    candidates: Candidates,
    weights: np.ndarray,
    units: Units,
    excluded: np.ndarray,
    alive: np.ndarray,
) -> Proof:
    """Improve a triangulation (m, 3), bound its gap; the last five arguments are a `_Reduced`."""
    search = _Search(candidates, weights, units)
    search.update_incumbent(_find_candidate_indices(candidates, triangles))
    potentials, lift = search.solve(alive, cost, seconds)
    total, bound = int(search.min_weight), search.compute_bound(potentials, lift)
    triangles = candidates.triangles[search.incumbent]
    gap = _compute_gap(outline, triangles, cost, units, total, bound)
    return Proof(triangles, gap, candidates, weights, units, excluded, potentials, lift)


def _compute_gap(
    outline: Boundary, triangles: np.ndarray, cost: Cost, units: Units, total: int, bound: int
) -> float:
    """Return the relative gap of a triangulation (m, 3) to the optimum; 0 if proven optimal."""
    exact, factor = compute_exact_total(outline, triangles, cost, units), units.factor
    if proves_optimality(exact, bound // factor, len(triangles), units):
        return 0.0
    return max(total - bound, factor) / max(abs(total), 1)


def _find_candidate_indices(candidates: Candidates, triangles: np.ndarray) -> np.ndarray:
    """Return the index (m,) of each triangle (m, 3) among the candidates, -1 if absent."""
    n = len(candidates.points)
    keys = _make_keys(candidates.triangles, n)
    order = np.argsort(keys)
    sought = _make_keys(triangles, n)
    nearest = order[np.minimum(np.searchsorted(keys[order], sought), len(order) - 1)]
    return np.where(keys[nearest] == sought, nearest, -1)


def _make_keys(triangles: np.ndarray, n: int) -> np.ndarray:
    """Return an integer (m,) for each triangle's set of vertices below n, in any order."""
    low, middle, high = np.sort(triangles.astype(np.int64), axis=1).T
    keys: np.ndarray = (low * n + middle) * n + high
    return keys
