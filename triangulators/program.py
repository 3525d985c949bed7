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
sum round a triangle or a ring. Few of the constraints matter, so they are added as they are found
to be violated; the program is solved anew from where it was (HiGHS, dual simplex).
"""

from typing import NamedTuple

import highspy
import numpy as np
from numba import njit

from triangulators.candidates import Candidates
from triangulators.components import join

_ALL = 3000  # triangles up to which all constraints are there from the beginning
_MOST_STEPS = 300_000  # of the simplex method in a round: a limit that is the same on any machine
_MOST_ADDED = 4000  # constraints added in a round
_HEAVY = 2.0  # times the start: what a triangle that is not allowed weighs more


class Solution(NamedTuple):
    """potentials (e,) float64 of each edge; share (t,): how much each triangle is chosen.

    bound: the dual's value; solved: whether the program was solved to the end.
    """

    potentials: np.ndarray
    share: np.ndarray
    bound: float
    solved: bool


def solve(
    candidates: Candidates,
    weights: np.ndarray,
    allowed: np.ndarray,
    start: np.ndarray,
    seconds: float,
) -> Solution:
    """Solve the program over the `allowed` triangles (t,); weights: (t,) float64.

    start: numbers of triangles that are a triangulation; with them the program has a solution from
    the beginning. Where they are not allowed, they are made so heavy that no solution keeps them.
    """
    edges, triangles = candidates.edges, candidates.triangles
    signs = np.where(triangles < np.roll(triangles, -1, axis=1), 1.0, -1.0)
    inside = np.flatnonzero(allowed)
    weights = np.where(allowed, weights, weights + _HEAVY * np.abs(weights[start]).sum())
    free = _off_tree(len(candidates.points), edges, candidates.side, candidates.sides[start])
    model = highspy.Highs()
    model.setOptionValue("output_flag", False)
    model.setOptionValue("time_limit", seconds)
    model.setOptionValue("simplex_iteration_limit", _MOST_STEPS)
    model.setOptionValue("presolve", "off")
    model.setOptionValue("primal_feasibility_tolerance", 1e-9)
    model.setOptionValue("dual_feasibility_tolerance", 1e-9)
    count = len(edges)
    infinite = np.where(free, highspy.kHighsInf, 0.0)
    model.addVars(count, -infinite, infinite)
    model.changeColsCost(count, np.arange(count, dtype=np.int32), candidates.side.astype(float))
    model.changeObjectiveSense(highspy.ObjSense.kMaximize)
    there = np.zeros(len(triangles), dtype=np.bool_)
    fresh = np.union1d(
        start, inside if len(inside) <= _ALL else _light(candidates, weights, allowed)
    )
    rows = np.empty(0, dtype=np.int64)
    potentials = np.zeros(count)
    while len(fresh):
        there[fresh] = True
        rows = np.concatenate((rows, fresh))
        model.addRows(
            len(fresh),
            np.full(len(fresh), -highspy.kHighsInf),
            weights[fresh],
            3 * len(fresh),
            np.arange(0, 3 * len(fresh), 3, dtype=np.int32),
            candidates.sides[fresh].astype(np.int32).ravel(),
            signs[fresh].ravel(),
        )
        model.run()
        solved = model.getModelStatus() == highspy.HighsModelStatus.kOptimal
        if not solved:
            break
        potentials = np.array(model.getSolution().col_value)
        excess = (signs[inside] * potentials[candidates.sides[inside]]).sum(axis=1) - weights[
            inside
        ]
        violated = np.flatnonzero((excess > 1e-7) & ~there[inside])
        fresh = inside[violated]
        if len(fresh) > _MOST_ADDED:
            fresh = _worst_by_edge(candidates, fresh, excess[violated])
    share = np.zeros(len(triangles))
    if solved:
        share[rows] = np.abs(model.getSolution().row_dual)
    bound = float(np.dot(candidates.side, potentials))
    return Solution(potentials, share, bound, solved)


def _light(candidates: Candidates, weights: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """Return, for each edge and side, the two lightest allowed triangles."""
    inside = np.flatnonzero(allowed)
    return _per_edge(candidates, inside, weights[inside], 2)


def _worst_by_edge(candidates: Candidates, which: np.ndarray, excess: np.ndarray) -> np.ndarray:
    return _per_edge(candidates, which, -excess, 1)


def _per_edge(candidates: Candidates, which: np.ndarray, key: np.ndarray, most: int) -> np.ndarray:
    """Return those of `which` triangles that have one of the `most` least keys at some edge."""
    order = np.argsort(key, kind="stable")
    ahead = candidates.triangles < np.roll(candidates.triangles, -1, axis=1)
    places = 2 * candidates.sides + ahead
    taken = np.zeros(2 * len(candidates.edges), dtype=np.int32)
    return which[order[_take(places[which[order]], taken, most)]]


@njit(cache=True)
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


@njit(cache=True)
def _grow_tree(count: int, edges: np.ndarray, order: np.ndarray, free: np.ndarray) -> None:
    root = np.arange(count)
    for e in order:
        if join(root, edges[e, 0], edges[e, 1]):
            free[e] = False
