"""Find the triangulation of minimum cost, and a lower bound of every triangulation's cost.

Local minimality excludes most edges (`local_minimality`). If the uncrossed edges among those that
remain connect the polygon's rings, a dynamic program finds the optimum (`skeleton`), otherwise a
linear program does. Vertices of triangles are sites (see `polygon.Boundary`).

The linear program, in dual form. Sources: G. B. Dantzig, A. J. Hoffman and T. C. Hu,
"Triangulations (tilings) and certain block triangular matrices", 1985; A. Yousefi and N. E. Young,
"On a linear program for minimum-weight triangulation", 2014.

Choose a share x >= 0 of each triangle, so that the shares on the left of each diagonal add up to
those on its right, and the shares at each boundary edge add up to 1; minimise the sum of x times
weight. An integral solution is a triangulation. The dual has a potential y for each edge, with the
opposite sign in the opposite direction:

    maximise    the sum of y over the boundary
    subject to  y(ab) + y(bc) + y(ca) <= weight(abc)   for each triangle abc.

Potentials of a spanning tree may be set to zero: adding p(b) - p(a) to each y(ab) does not change
the sum around a triangle or a ring.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import highspy
import numpy as np

from triangulators.certificate.bridges import solve_by_bridges
from triangulators.certificate.candidates import Candidates, find_candidates
from triangulators.certificate.local_minimality import exclude_edges, extend_potentials
from triangulators.certificate.skeleton import solve_skeleton
from triangulators.checking.evidence import (
    Evidence,
    Units,
    compute_exact_total,
    compute_weights,
    find_units,
    proves_optimality,
)
from triangulators.compute.kernels import merge_trees, njit
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
_LOG2_TOTAL = 17  # scales the initial solution to 2^17 or less: the solver has absolute tolerances
_MAX_SCALED_POTENTIAL = 2.0**20  # of a linear program: 8 to 16 times the initial weight
_PENALTY = 2.0  # of a triangle that is not allowed, relative to the initial weight

_OPTIONS: dict[str, Any] = {
    "output_flag": False,
    "solver": "ipm",
    "threads": 1,
    # Iteration limits, unlike time limits, give the same result on any machine.
    "ipm_iteration_limit": 300,
    "simplex_iteration_limit": 300_000,
    # Tolerances only weaken the bound: potentials are rounded, and the lift restores feasibility.
    "ipm_optimality_tolerance": 1e-12,
    "primal_feasibility_tolerance": 1e-10,
    "dual_feasibility_tolerance": 1e-10,
}


class LinearProgram:
    """The linear program over some candidate triangles of a polygon.

    Triangles of the initial solution `start` (m,) that are not `allowed` (t,) get a penalty.
    Without a bound some potentials become needlessly large; with a much larger bound the
    interior-point method does not converge.
    """

    def __init__(
        self, candidates: Candidates, weights: np.ndarray, allowed: np.ndarray, start: np.ndarray
    ) -> None:
        total = float(np.abs(weights[start]).sum())
        self.scale = 2.0 ** (_LOG2_TOTAL - math.ceil(math.log2(total))) if total > 0.0 else 1.0
        self.weights = np.where(allowed, weights, weights + _PENALTY * total) * self.scale
        self.candidates, self.start = candidates, start
        self.inside = np.flatnonzero(allowed)
        triangles = candidates.triangles
        self.signs = np.where(triangles < np.roll(triangles, -1, axis=1), 1.0, -1.0)
        # Edges with a potential to optimise: all except a spanning tree, whose potentials are 0.
        # The tree has edges of the boundary first, then edges of the initial solution.
        self.free = np.ones(len(candidates.edges), dtype=np.bool_)
        inner = np.unique(candidates.triangle_edges[start])
        order = np.concatenate((np.flatnonzero(candidates.side != 0), inner))
        _fix_spanning_tree(len(candidates.points), candidates.edges, order, self.free)

    def solve(self, seconds: float, *, basic: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Return the potentials (e,) of the edges, and the share (t,) of each triangle.

        Potentials have about twelve correct digits; all are zero if the solver did not finish
        within `seconds`. The interior-point method is many times faster than the simplex method,
        which follows it if `basic` is True: then more shares are 0 or 1, a triangulation.
        """
        model = highspy.Highs()
        crossover = {"run_crossover": "on" if basic else "off"}
        for name, value in (_OPTIONS | crossover | {"time_limit": seconds}).items():
            model.setOptionValue(name, value)
        edges, constraints = len(self.candidates.edges), np.union1d(self.start, self.inside)
        bounds = np.where(self.free, _MAX_SCALED_POTENTIAL, 0.0)
        model.addVars(edges, -bounds, bounds)
        ring = self.candidates.side.astype(float)
        model.changeColsCost(edges, np.arange(edges, dtype=np.int32), ring)
        model.changeObjectiveSense(highspy.ObjSense.kMaximize)
        model.addRows(
            len(constraints),
            np.full(len(constraints), -highspy.kHighsInf),
            self.weights[constraints],
            3 * len(constraints),
            np.arange(0, 3 * len(constraints), 3, dtype=np.int32),
            self.candidates.triangle_edges[constraints].astype(np.int32).ravel(),
            self.signs[constraints].ravel(),
        )
        model.run()
        # For an optimal solution that is not basic, HiGHS reports the status "unknown".
        solved = (highspy.HighsModelStatus.kOptimal, highspy.HighsModelStatus.kUnknown)
        potentials, share = np.zeros(edges), np.zeros(len(self.candidates.triangles))
        if model.getModelStatus() in solved:
            potentials = np.array(model.getSolution().col_value) / self.scale
            share[constraints] = np.abs(model.getSolution().row_dual)
        return potentials, share


@njit
def _fix_spanning_tree(count: int, edges: np.ndarray, order: np.ndarray, free: np.ndarray) -> None:
    """Clear `free` (e,) for edges (e, 2) of a spanning tree of `count` points, tried in `order`."""
    root = np.arange(count)
    for e in order:
        if merge_trees(root, edges[e, 0], edges[e, 1]):
            free[e] = False


@dataclass(frozen=True)
class Proof:
    """The best triangulation found, and potentials that bound the cost of all others."""

    triangles: np.ndarray  # (m, 3)
    gap: float
    search: "_Search"
    potentials: np.ndarray  # (e,): valid, with `lift`, for triangles without an excluded edge
    lift: int

    def make_evidence(self) -> Evidence:
        """Return unchecked evidence of the bound, with potentials also for the excluded edges.

        If such a potential would be too large for the checker, the evidence is of a weak bound.
        """
        candidates, weights = self.search.candidates, self.search.weights
        potentials = extend_potentials(candidates, weights, self.search.excluded, self.potentials)
        lift = self.lift
        if potentials is None:
            potentials, lift = np.zeros_like(self.potentials), min(0, int(weights.min()))
        return Evidence(*self.search.units[:3], candidates.edges, potentials, lift)


@dataclass
class _Search:
    """Search for the triangulation of minimum weight, and a lower bound of all weights."""

    outline: Boundary
    cost: Cost
    units: Units
    candidates: Candidates
    weights: np.ndarray  # (t,), of the candidate triangles
    excluded: np.ndarray  # (k,): edges in order of exclusion
    alive: np.ndarray  # (t,): flags of the triangles without an excluded edge
    incumbent: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    min_weight: float = math.inf

    def update_incumbent(self, selection: np.ndarray) -> None:
        """Make a lighter `selection` (m,) the incumbent, unless an index is -1 (no candidate)."""
        if (selection < 0).any():
            return
        total = sum(self.weights[selection].tolist())
        if total < self.min_weight:
            self.incumbent, self.min_weight = selection, total

    def prove(self, triangles: np.ndarray, seconds: float) -> Proof:
        """Improve a triangulation (m, 3), and bound its gap to the optimum."""
        c = self.candidates
        self.update_incumbent(_find_candidate_indices(c, triangles))
        potentials, lift = self.solve(seconds)
        gap = self.compute_gap(self.compute_bound(potentials, lift))
        return Proof(c.triangles[self.incumbent], gap, self, potentials, lift)

    def solve(self, seconds: float) -> tuple[np.ndarray, int]:
        """Optimise over the remaining candidates; return potentials and a lift <= 0.

        The bound equals the optimum if the dynamic program applies, or if the linear program's
        solution is integral.
        """
        c = self.candidates
        optimum = solve_skeleton(c, self.alive, self.cost, self.units)
        if optimum is not None:
            self.update_incumbent(_find_candidate_indices(c, optimum[0]))
            return optimum[1], 0
        timed = 0.0 < seconds < np.inf
        uses_program = timed or (seconds > 0.0 and int(self.alive.sum()) <= _MAX_UNTIMED_ROWS)
        # Costs in units, the noise as a fraction: integer weights have more bits than doubles.
        cost_weights = self.weights / self.units.factor
        if uses_program:
            program = LinearProgram(c, cost_weights, self.alive, self.incumbent)
            dual = self._evaluate_solution(*program.solve(seconds))
            if self._is_bound_tight(*dual):
                return dual
        else:
            dual = self._round_potentials(np.zeros(len(c.edges)))
        # Not proven yet: local search may find a better incumbent, which the retry starts from.
        better = optimise_along_random_trees(c.points, c.triangles[self.incumbent], self.cost)
        self.update_incumbent(_find_candidate_indices(c, better))
        if uses_program and not self._is_bound_tight(*dual):
            program = LinearProgram(c, cost_weights, self.alive, self.incumbent)
            retry = self._evaluate_solution(*program.solve(seconds, basic=True))
            dual = max(dual, retry, key=lambda pair: self.compute_bound(*pair))
        return dual

    def _evaluate_solution(
        self, potentials: np.ndarray, share: np.ndarray
    ) -> tuple[np.ndarray, int]:
        """Return a linear program's potentials as integers, and the lift; update the incumbent."""
        c = self.candidates
        selection = np.flatnonzero(share > 0.5)
        is_forward = c.triangles[selection] < np.roll(c.triangles[selection], -1, axis=1)
        signs = np.where(is_forward, 1, -1).ravel()
        # In a triangulation each boundary edge is a side of one triangle, and each diagonal of as
        # many triangles on the left as on the right.
        if np.array_equal(
            np.bincount(c.triangle_edges[selection].ravel(), signs, len(c.edges)), c.side
        ):
            self.update_incumbent(selection)
        return self._round_potentials(potentials)

    def _round_potentials(self, in_units: np.ndarray) -> tuple[np.ndarray, int]:
        """Return the potentials `in_units` (e,), converted to integer weights, and the lift."""
        c = self.candidates
        scaled = in_units * self.units.factor
        scaled *= min(1.0, _MAX_POTENTIAL / max(float(np.abs(scaled).max()), 1.0))
        potentials = np.rint(scaled).astype(np.int64)
        is_forward = c.triangles < np.roll(c.triangles, -1, axis=1)
        sums = np.where(
            is_forward, potentials[c.triangle_edges], -potentials[c.triangle_edges]
        ).sum(axis=1)
        slack = (self.weights - sums)[self.alive]
        return potentials, min(int(slack.min()), 0) if len(slack) else 0

    def compute_bound(self, potentials: np.ndarray, lift: int) -> int:
        total: int = sum((potentials * self.candidates.side).tolist())
        return total + lift * len(self.incumbent)

    def _is_bound_tight(self, potentials: np.ndarray, lift: int) -> bool:
        factor = self.units.factor
        return self.compute_bound(potentials, lift) // factor >= self.min_weight // factor

    def compute_gap(self, bound: int) -> float:
        """Return the incumbent's relative gap to the optimum; 0 if proven optimal by a bound."""
        triangles, units = self.candidates.triangles[self.incumbent], self.units
        exact = compute_exact_total(self.outline, triangles, self.cost, units)
        if proves_optimality(exact, bound // units.factor, len(triangles), units):
            return 0.0
        total = int(self.min_weight)
        return max(total - bound, units.factor) / max(abs(total), 1)


def prove(
    outline: Boundary, triangles: np.ndarray, cost: Cost, seconds: float = PROGRAM_TIMEOUT_S
) -> Proof | None:
    """Improve a triangulation (m, 3), and bound its gap to the optimum.

    seconds: time limit of each linear program, whose bound is weak if the limit is reached;
    infinite: solve only programs of up to 100,000 triangles; 0: solve no linear program. None if
    more than eight million triples of sites see each other, 1.5 million without a time limit.
    """
    search = _make_search(outline, triangles, cost, seconds)
    return None if search is None else search.prove(triangles, seconds)


def minimise_cost(outline: Boundary, cost: Cost, seconds: float) -> tuple[np.ndarray, float] | None:
    """Return the best triangulation found (m, 3) and its gap, without evidence; see `prove`."""
    search = _make_search(outline, find_any_triangulation(outline), cost, seconds)
    if search is None:
        return None
    if outline.has_plain_rings:
        candidates, weights = search.candidates, search.weights
        selection = solve_by_bridges(
            candidates, outline.ring_offsets, search.alive, weights, INFEASIBLE_WEIGHT
        )
        if len(selection) > 0:
            search.update_incumbent(selection)
            return candidates.triangles[selection], search.compute_gap(int(search.min_weight))
    proof = search.prove(find_best_initial(outline, cost), seconds)
    return proof.triangles, proof.gap


def _make_search(
    outline: Boundary, triangles: np.ndarray, cost: Cost, seconds: float
) -> _Search | None:
    """Return a search after excluding edges, or None if there are too many visible triples."""
    units = find_units(outline, triangles, cost)
    max_triples = MAX_TRIPLES if 0.0 < seconds < np.inf else _MAX_UNTIMED_TRIPLES
    candidates = find_candidates(outline, triangles, max_triples)
    if candidates is None:
        return None
    weights = compute_weights(outline.points, candidates.triangles, cost, units)
    excluded, alive = exclude_edges(candidates, weights, cost, units)
    return _Search(outline, cost, units, candidates, weights, excluded, alive)


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
