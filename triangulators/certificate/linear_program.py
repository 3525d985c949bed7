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
sum round a triangle or a ring.
"""

import math
from typing import Any

import highspy
import numpy as np

from triangulators.certificate.candidates import Candidates
from triangulators.compute.kernels import njit
from triangulators.compute.operations import join

_TOTAL = 17  # the start's weights add up to 2^17 at most for the solver, whose tolerances are fixed
_FARTHEST = 2.0**20  # of a potential, for the solver: 8 to 16 times the start's weights
_HEAVY = 2.0  # times the start: what a triangle that is not allowed weighs more

_OPTIONS: dict[str, Any] = {
    "output_flag": False,
    "solver": "ipm",
    "threads": 1,
    # Limits of steps are the same on any machine.
    "ipm_iteration_limit": 300,
    "simplex_iteration_limit": 300_000,
    # Tolerances cost tightness alone: potentials are rounded, and the lift makes up for the rest.
    "ipm_optimality_tolerance": 1e-12,
    "primal_feasibility_tolerance": 1e-10,
    "dual_feasibility_tolerance": 1e-10,
}


class Program:
    """A polygon's linear program over the `allowed` triangles (t,); weights: (t,) float64.

    start: numbers of triangles that are a triangulation; with them the program has a solution from
    the beginning. Where they are not allowed, they are made so heavy that no solution keeps them.
    Potentials are at most 8 to 16 times what the start weighs: without a bound some get much larger
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
        # All edges but those of a spanning tree of the boundary's and the start's.
        self.free = np.ones(len(candidates.edges), dtype=np.bool_)
        inner = np.unique(candidates.sides[start])
        order = np.concatenate((np.flatnonzero(candidates.side != 0), inner))
        _grow_tree(len(candidates.points), candidates.edges, order, self.free)

    def solve(self, seconds: float, *, at_a_corner: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Return potentials (e,) of the edges, and how much each triangle is chosen, (t,).

        Solved by the interior-point method of HiGHS; the potentials have about twelve digits. All
        are zero where it was not solved to the end.

        It is many times faster than the simplex method where there are tens of thousands of
        constraints, as many of them are met with equality. at_a_corner: go on from there to a
        solution at a corner of what is allowed, by the simplex method; that takes much longer, and
        the triangles chosen are a triangulation more often.
        """
        model = highspy.Highs()
        crossover = {"run_crossover": "on" if at_a_corner else "off"}
        for name, value in (_OPTIONS | crossover | {"time_limit": seconds}).items():
            model.setOptionValue(name, value)
        edges, rows = len(self.candidates.edges), np.union1d(self.start, self.inside)
        most = np.where(self.free, _FARTHEST, 0.0)
        model.addVars(edges, -most, most)
        ring = self.candidates.side.astype(float)
        model.changeColsCost(edges, np.arange(edges, dtype=np.int32), ring)
        model.changeObjectiveSense(highspy.ObjSense.kMaximize)
        model.addRows(
            len(rows),
            np.full(len(rows), -highspy.kHighsInf),
            self.weights[rows],
            3 * len(rows),
            np.arange(0, 3 * len(rows), 3, dtype=np.int32),
            self.candidates.sides[rows].astype(np.int32).ravel(),
            self.signs[rows].ravel(),
        )
        model.run()
        # HiGHS calls it unknown whether a solution is optimal that is not at a corner.
        ends = (highspy.HighsModelStatus.kOptimal, highspy.HighsModelStatus.kUnknown)
        potentials, share = np.zeros(edges), np.zeros(len(self.candidates.triangles))
        if model.getModelStatus() in ends:
            potentials = np.array(model.getSolution().col_value) / self.scale
            share[rows] = np.abs(model.getSolution().row_dual)
        return potentials, share


@njit
def _grow_tree(count: int, edges: np.ndarray, order: np.ndarray, free: np.ndarray) -> None:
    root = np.arange(count)
    for e in order:
        if join(root, edges[e, 0], edges[e, 1]):
            free[e] = False
