"""The linear program over the triangles of all triangulations, in dual form.

Sources: G. B. Dantzig, A. J. Hoffman and T. C. Hu, "Triangulations (tilings) and certain block
triangular matrices", 1985; A. Yousefi and N. E. Young, "On a linear program for minimum-weight
triangulation", 2014.

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
from typing import Any

import highspy
import numpy as np

from triangulators.certificate.candidates import Candidates
from triangulators.compute.kernels import merge_trees, njit

_LOG2_TOTAL = 17  # scales the initial solution to 2^17 or less: the solver has absolute tolerances
_MAX_POTENTIAL = 2.0**20  # bound of scaled potentials: 8 to 16 times the initial weight
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
        inner = np.unique(candidates.sides[start])
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
        bounds = np.where(self.free, _MAX_POTENTIAL, 0.0)
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
            self.candidates.sides[constraints].astype(np.int32).ravel(),
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
