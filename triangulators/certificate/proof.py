"""Find an optimum and evidence of optimality.

Local minimality excludes most edges. If the remaining skeleton connects the polygon's rings, a
dynamic program solves the rest (`skeleton`), otherwise the linear program (`linear_program`).
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from triangulators.certificate.bridges import solve_by_bridges
from triangulators.certificate.candidates import Candidates, find_candidates
from triangulators.certificate.linear_program import Program
from triangulators.certificate.local_minimality import exclude, extend
from triangulators.certificate.skeleton import solve_skeleton
from triangulators.checking.evidence import Evidence
from triangulators.checking.units import Units, compute_weights, exact_total, find_units, is_proof
from triangulators.criteria.cost import Cost
from triangulators.initial import find_any_triangulation, find_best_initial
from triangulators.optimum.best_way import search_cuts
from triangulators.optimum.visible_lists import NOTHING
from triangulators.polygon import Boundary

PROGRAM_TIMEOUT_S = 60.0  # time limit of a linear program; a polygon may need two programs
# Used if no time limit is given: limits of size end a proof within seconds, with the same result on
# every machine.
_MAX_UNTIMED_ROWS = 100_000  # constraints of a linear program
_MAX_UNTIMED_TRIPLES = 1_500_000  # visible triples for exclusion

MAX_TRIPLES = 8_000_000  # visible triples of a polygon: about 1 GB
_MAX_POTENTIAL = 2.0**59  # the checker adds three potentials below 2^60 in 64 bits


@dataclass(frozen=True)
class Proof:
    """The best triangulation found (m, 3), and potentials that give a lower bound of every cost.

    gap: (cost - bound) / cost, 0 if proven optimal. weights (t,): of the candidates, in `units`.
    The potentials (e,) and the lift are valid for triangles without an edge in `excluded`.
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
        """Return unchecked evidence of the bound, extended to triangles with excluded edges.

        The bound is trivial if a potential would be too large.
        """
        potentials = extend(self.candidates, self.weights, self.excluded, self.potentials)
        lift = self.lift
        if potentials is None:
            potentials, lift = np.zeros_like(self.potentials), min(0, int(self.weights.min()))
        return Evidence(*self.units[:3], self.candidates.edges, potentials, lift)


class _Search:
    """Search for the best triangulation; `incumbent`: the best so far, as indices of candidates."""

    def __init__(self, candidates: Candidates, weights: np.ndarray, units: Units) -> None:
        self.candidates, self.weights, self.units = candidates, weights, units
        self.incumbent = np.empty(0, dtype=np.int64)
        self.min_weight = np.inf

    def update_incumbent(self, selection: np.ndarray) -> None:
        """Make a triangulation, given by candidate indices, the incumbent if lighter.

        Ignored if a triangle is not a candidate (-1), so that the weight is unknown.
        """
        if (selection < 0).any():
            return
        total = sum(self.weights[selection].tolist())
        if total < self.min_weight:
            self.incumbent, self.min_weight = selection, total

    def solve(self, alive: np.ndarray, cost: Cost, seconds: float) -> tuple[np.ndarray, int]:
        """Optimise over the triangles that are `alive` (t,); return potentials and a lift <= 0.

        The potentials give a lower bound of every triangulation that consists of these triangles.
        If the dynamic program applies, the bound equals the optimum. Otherwise the linear program's
        bound equals the optimum if the solution is integral, and leaves a gap if not. A linear
        program is solved if `seconds` is finite and positive, or infinite and the program small.
        """
        c = self.candidates
        optimum = solve_skeleton(c, alive, cost, self.units)
        if optimum is not None:
            self.update_incumbent(_find_candidate_indices(c, optimum[0]))
            return optimum[1], 0
        timed = 0.0 < seconds < np.inf
        uses_program = timed or (seconds > 0.0 and int(alive.sum()) <= _MAX_UNTIMED_ROWS)
        cost_weights = self.weights / self.units.factor  # in units, for the solver's doubles
        if uses_program:
            program = Program(c, cost_weights, alive, self.incumbent)
            dual = self._try_solution(alive, *program.solve(seconds))
            if self._is_bound_tight(*dual):
                return dual
        else:
            dual = self._round_potentials(alive, np.zeros(len(c.edges)))
        # Not proven yet: local search may find a better incumbent, also as an initial solution.
        self.update_incumbent(
            _find_candidate_indices(c, search_cuts(c.points, c.triangles[self.incumbent], cost))
        )
        if uses_program and not self._is_bound_tight(*dual):
            program = Program(c, cost_weights, alive, self.incumbent)
            retry = self._try_solution(alive, *program.solve(seconds, basic=True))
            dual = max(dual, retry, key=lambda pair: self.bound(*pair))
        return dual

    def _try_solution(
        self, alive: np.ndarray, potentials: np.ndarray, share: np.ndarray
    ) -> tuple[np.ndarray, int]:
        """Return a linear program's potentials as integers, and the lift; update the incumbent.

        The triangles with a share above 1/2 are a new incumbent if they are a lighter
        triangulation.
        """
        c = self.candidates
        selection = np.flatnonzero(share > 0.5)
        is_forward = c.triangles[selection] < np.roll(c.triangles[selection], -1, axis=1)
        signs = np.where(is_forward, 1, -1).ravel()
        # Each boundary edge is used once, each diagonal as often from the left as from the right.
        if np.array_equal(np.bincount(c.sides[selection].ravel(), signs, len(c.edges)), c.side):
            self.update_incumbent(selection)
        return self._round_potentials(alive, potentials)

    def _round_potentials(self, alive: np.ndarray, light: np.ndarray) -> tuple[np.ndarray, int]:
        """Return potentials in units, rounded to integer weights, and the lift.

        -lift is the largest amount by which a triangle's potentials exceed its weight, or 0.
        """
        c = self.candidates
        scaled = light * self.units.factor
        scaled *= min(1.0, _MAX_POTENTIAL / max(float(np.abs(scaled).max()), 1.0))
        potentials = np.rint(scaled).astype(np.int64)
        is_forward = c.triangles < np.roll(c.triangles, -1, axis=1)
        sums = np.where(is_forward, potentials[c.sides], -potentials[c.sides]).sum(axis=1)
        slack = (self.weights - sums)[alive]
        return potentials, min(int(slack.min()), 0) if len(slack) else 0

    def bound(self, potentials: np.ndarray, lift: int) -> int:
        """Return the lower bound, as a weight."""
        total: int = sum((potentials * self.candidates.side).tolist())
        return total + lift * len(self.incumbent)

    def _is_bound_tight(self, potentials: np.ndarray, lift: int) -> bool:
        """Whether no triangulation is better than the incumbent by a unit of cost."""
        factor = self.units.factor
        return self.bound(potentials, lift) // factor >= self.min_weight // factor


def prove(
    outline: Boundary, triangles: np.ndarray, cost: Cost, seconds: float = PROGRAM_TIMEOUT_S
) -> Proof | None:
    """Improve a triangulation (m, 3) whose vertices are sites, and bound its gap to the optimum.

    The units are those of claims about the given triangulation. seconds: time limit of each
    linear program, which gives a weak bound when reached; infinite: solve programs of up to 100,000
    triangles only; 0: solve none. Return None if more than eight million triples of vertices see
    each other (1.5 million if seconds is 0 or infinite).
    """
    reduced = _exclude_edges(outline, triangles, cost, seconds)
    return None if reduced is None else _prove_reduced(outline, triangles, cost, seconds, *reduced)


def minimise(outline: Boundary, cost: Cost, seconds: float) -> tuple[np.ndarray, float] | None:
    """Return the triangles (m, 3) and the gap of `prove`, or None as `prove` does.

    If `solve_by_bridges` finds the optimum, potentials and linear programs are not needed.
    """
    reduced = _exclude_edges(outline, find_any_triangulation(outline), cost, seconds)
    if reduced is None:
        return None
    candidates, weights, units, _, alive = reduced
    if outline.has_plain_rings:
        selection = solve_by_bridges(candidates, outline.ring_offsets, alive, weights, NOTHING)
        if len(selection) > 0:
            triangles = candidates.triangles[selection]
            total: int = sum(weights[selection].tolist())
            return triangles, _find_gap(outline, triangles, cost, units, total, total)
    proof = _prove_reduced(outline, find_best_initial(outline, cost), cost, seconds, *reduced)
    return proof.triangles, proof.gap


_Reduced: TypeAlias = tuple[Candidates, np.ndarray, Units, np.ndarray, np.ndarray]
"""Candidates, their weights, the units, the excluded edges, flags of the remaining triangles."""


def _exclude_edges(
    outline: Boundary, triangles: np.ndarray, cost: Cost, seconds: float
) -> _Reduced | None:
    """Return a polygon's candidates after exclusion, or None; see `prove` for limits."""
    units = find_units(outline, triangles, cost)
    max_triples = MAX_TRIPLES if 0.0 < seconds < np.inf else _MAX_UNTIMED_TRIPLES
    candidates = find_candidates(outline, triangles, max_triples)
    if candidates is None:
        return None
    weights = compute_weights(outline.points, candidates.triangles, cost, units)
    excluded, alive = exclude(candidates, weights, cost, units)
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
    search = _Search(candidates, weights, units)
    search.update_incumbent(_find_candidate_indices(candidates, triangles))
    potentials, lift = search.solve(alive, cost, seconds)
    total, bound = int(search.min_weight), search.bound(potentials, lift)
    triangles = candidates.triangles[search.incumbent]
    gap = _find_gap(outline, triangles, cost, units, total, bound)
    return Proof(triangles, gap, candidates, weights, units, excluded, potentials, lift)


def _find_gap(
    outline: Boundary, triangles: np.ndarray, cost: Cost, units: Units, total: int, bound: int
) -> float:
    """Return the relative gap of triangles (m, 3) of weight `total` to a lower bound `bound`."""
    exact, factor = exact_total(outline, triangles, cost, units), units.factor
    if is_proof(exact, bound // factor, len(triangles), units):
        return 0.0
    return max(total - bound, factor) / max(abs(total), 1)


def _find_candidate_indices(candidates: Candidates, triangles: np.ndarray) -> np.ndarray:
    """Return the candidate index of each triangle, -1 for other triangles."""
    n = len(candidates.points)
    keys = _make_keys(candidates.triangles, n)
    order = np.argsort(keys)
    sought = _make_keys(triangles, n)
    nearest = order[np.minimum(np.searchsorted(keys[order], sought), len(order) - 1)]
    return np.where(keys[nearest] == sought, nearest, -1)


def _make_keys(triangles: np.ndarray, n: int) -> np.ndarray:
    low, middle, high = np.sort(triangles.astype(np.int64), axis=1).T
    keys: np.ndarray = (low * n + middle) * n + high
    return keys
