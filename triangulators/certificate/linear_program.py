"""The linear program over triangles, in its dual form.

Sources: G. B. Dantzig, A. J. Hoffman and T. C. Hu, "Triangulations (tilings) and certain block
triangular matrices", 1985; A. Yousefi and N. E. Young, "On a linear program for minimum-weight
triangulation", 2014.

Choose triangles x >= 0 of least weight so that each diagonal has as many on its left as on its
right and each boundary edge has one. The dual has a potential y for each edge, counted negative
when the edge is run the other way:

    maximise    the sum of y over the boundary
    subject to  y(ab) + y(bc) + y(ca) <= weight(abc)   for each triangle abc.

Potentials of a spanning tree may be set to zero: adding p(b) - p(a) to each y(ab) changes no
sum round a triangle or a ring. Few of the constraints matter. The dual simplex method is given
more of them as they are found to be violated, and goes on from where it was.
"""

import math
from typing import Any, NamedTuple

import highspy
import numpy as np

from triangulators.certificate.candidates import Candidates
from triangulators.compute.kernels import njit
from triangulators.compute.arrays import join

_ALL = 3000  # triangles up to which all constraints are there from the beginning
_MOST_ADDED = 4000  # constraints added in a round
_TOTAL = 17  # the start's weights add up to 2^17 at most for the solver, whose tolerances are fixed
_FARTHEST = 2.0**20  # of a potential, for the solver: eight times the start's weights
_HEAVY = 2.0  # times the start: what a triangle that is not allowed weighs more

# Limits of steps are the same on any machine. Tolerances cost tightness alone: potentials are
# rounded, and the lift makes up for what is off.
_INTERIOR_POINT = {
    "solver": "ipm",
    "run_crossover": "off",
    "threads": 1,
    "ipm_iteration_limit": 300,
    "ipm_optimality_tolerance": 1e-12,
    "primal_feasibility_tolerance": 1e-10,
    "dual_feasibility_tolerance": 1e-10,
}
_SIMPLEX = {
    "simplex_iteration_limit": 300_000,  # in a round
    "presolve": "off",
    "primal_feasibility_tolerance": 1e-9,
    "dual_feasibility_tolerance": 1e-9,
}


class Solution(NamedTuple):
    """potentials (e,) float64 of each edge; share (t,): how much each triangle is chosen.

    bound: the dual's value; solved: whether the program was solved to the end.
    """

    potentials: np.ndarray
    share: np.ndarray
    bound: float
    solved: bool


class Program:
    """A polygon's linear program over the `allowed` triangles (t,); weights: (t,) float64.

    start: numbers of triangles that are a triangulation; with them the program has a solution from
    the beginning. Where they are not allowed, they are made so heavy that no solution keeps them.
    Potentials are at most eight times what the start weighs: without a bound some get much larger
    than is needed, and with one that is far away the interior point does not arrive.
    """

    def __init__(
        self,
        candidates: Candidates,
        weights: np.ndarray,
        allowed: np.ndarray,
        start: np.ndarray,
    ) -> None:
        total = float(np.abs(weights[start]).sum())
        self.scale = 2.0 ** (_TOTAL - math.ceil(math.log2(total))) if total > 0.0 else 1.0
        self.weights = np.where(allowed, weights, weights + _HEAVY * total) * self.scale
        self.candidates, self.start = candidates, start
        self.inside = np.flatnonzero(allowed)
        triangles = candidates.triangles
        self.signs = np.where(triangles < np.roll(triangles, -1, axis=1), 1.0, -1.0)
        inner = candidates.sides[start]
        self.free = _off_tree(len(candidates.points), candidates.edges, candidates.side, inner)

    def by_interior_point(self, seconds: float) -> Solution:
        """Solve with all constraints at once, by the interior-point method of HiGHS.

        It is many times faster than the simplex method where there are tens of thousands, as many
        of them are met with equality. The potentials are accurate to about twelve digits.
        """
        model = self._model(seconds, _INTERIOR_POINT)
        rows = np.union1d(self.start, self.inside)
        self._add(model, rows)
        model.run()
        # HiGHS calls it unknown whether a solution is optimal that is not at a corner.
        ends = (highspy.HighsModelStatus.kOptimal, highspy.HighsModelStatus.kUnknown)
        if model.getModelStatus() not in ends:
            return self._solution(np.zeros(len(self.free)))
        return self._solution(np.array(model.getSolution().col_value), model, rows)

    def by_simplex(self, seconds: float) -> Solution:
        """Solve with few constraints first; those that are violated are added until none is."""
        model = self._model(seconds, _SIMPLEX)
        c, inside = self.candidates, self.inside
        there = np.zeros(len(c.triangles), dtype=np.bool_)
        few = inside if len(inside) <= _ALL else _per_edge(c, inside, self.weights[inside], 2)
        fresh = np.union1d(self.start, few)
        rows = np.empty(0, dtype=np.int64)
        potentials = np.zeros(len(c.edges))
        while len(fresh):
            there[fresh] = True
            rows = np.concatenate((rows, fresh))
            self._add(model, fresh)
            model.run()
            if model.getModelStatus() != highspy.HighsModelStatus.kOptimal:
                return self._solution(potentials)
            potentials = np.array(model.getSolution().col_value)
            around = (self.signs[inside] * potentials[c.sides[inside]]).sum(axis=1)
            excess = around - self.weights[inside]
            violated = np.flatnonzero((excess > 1e-7) & ~there[inside])
            fresh = inside[violated]
            if len(fresh) > _MOST_ADDED:
                fresh = _per_edge(c, fresh, -excess[violated], 1)
        return self._solution(np.array(model.getSolution().col_value), model, rows)

    def _model(self, seconds: float, options: dict[str, Any]) -> highspy.Highs:
        model = highspy.Highs()
        for name, value in {"output_flag": False, "time_limit": seconds, **options}.items():
            model.setOptionValue(name, value)
        count = len(self.candidates.edges)
        most = np.where(self.free, _FARTHEST, 0.0)
        model.addVars(count, -most, most)
        side = self.candidates.side.astype(float)
        model.changeColsCost(count, np.arange(count, dtype=np.int32), side)
        model.changeObjectiveSense(highspy.ObjSense.kMaximize)
        return model

    def _add(self, model: highspy.Highs, rows: np.ndarray) -> None:
        count = len(rows)
        model.addRows(
            count,
            np.full(count, -highspy.kHighsInf),
            self.weights[rows],
            3 * count,
            np.arange(0, 3 * count, 3, dtype=np.int32),
            self.candidates.sides[rows].astype(np.int32).ravel(),
            self.signs[rows].ravel(),
        )

    def _solution(
        self, potentials: np.ndarray, model: highspy.Highs | None = None, rows: Any = ()
    ) -> Solution:
        """Return what was found in the polygon's units; model: None if it was not solved."""
        share = np.zeros(len(self.candidates.triangles))
        if model is not None:
            share[rows] = np.abs(model.getSolution().row_dual)
        bound = float(np.dot(self.candidates.side, potentials))
        return Solution(potentials / self.scale, share, bound / self.scale, model is not None)


def _per_edge(candidates: Candidates, which: np.ndarray, key: np.ndarray, most: int) -> np.ndarray:
    """Return those of `which` triangles that have one of the `most` least keys at some edge."""
    order = np.argsort(key, kind="stable")
    ahead = candidates.triangles < np.roll(candidates.triangles, -1, axis=1)
    places = 2 * candidates.sides + ahead
    taken = np.zeros(2 * len(candidates.edges), dtype=np.int32)
    return which[order[_take(places[which[order]], taken, most)]]


@njit
def _take(places: np.ndarray, taken: np.ndarray, most: int) -> np.ndarray:
    wanted = np.zeros(len(places), dtype=np.bool_)
    for row in range(len(places)):
        for k in range(3):
            if taken[places[row, k]] < most:
                taken[places[row, k]] += 1
                wanted[row] = True
    return wanted


def _off_tree(count: int, edges: np.ndarray, side: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """Return which edges are off a spanning tree of boundary edges and those of `inner`."""
    free = np.ones(len(edges), dtype=np.bool_)
    order = np.concatenate((np.flatnonzero(side != 0), np.unique(inner)))
    _grow_tree(count, edges, order, free)
    return free


@njit
def _grow_tree(count: int, edges: np.ndarray, order: np.ndarray, free: np.ndarray) -> None:
    root = np.arange(count)
    for e in order:
        if join(root, edges[e, 0], edges[e, 1]):
            free[e] = False
