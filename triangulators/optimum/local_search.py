"""Improve a triangulation by optimising pieces of it exactly.

A piece is a tree of neighbouring triangles, unfolded into a simple polygon (see `unfold`); its own
triangulation is one of those the exact method chooses from, so no step makes anything worse. With
the whole polygon as the piece, a tree crosses all but h of the diagonals that matter: the others
are the cuts between the holes and the outline, and other trees give other cuts.
"""

import numpy as np

from triangulators.criteria.cost import Cost, evaluate
from triangulators.geometry.half_edges import twins_of
from triangulators.geometry.unfold import fold_back, grow, unfold
from triangulators.optimum.best_way import optimum

PIECE = 200  # triangles in a window of a large polygon
_ROUNDS = 12  # sweeps of windows at most
_ENOUGH = 5e-3  # a sweep that gains less than this part of the cost is the last
_PATIENCE = 6  # cuts tried in a row without gain before giving up on better ones


class Patchwork:
    """A triangulation under improvement: triangles (m, 3) of points (n, 2), and twins."""

    def __init__(self, points: np.ndarray, triangles: np.ndarray, cost: Cost) -> None:
        self.points = points
        self.triangles = np.ascontiguousarray(triangles, dtype=np.int32).copy()
        self.twin = twins_of(self.triangles)
        self.cost = cost
        self._tree = np.zeros(self.twin.shape, dtype=np.bool_)

    def is_tree(self) -> bool:
        """Whether the triangles hang together as a tree: one simple polygon, nothing to cut."""
        return int(np.count_nonzero(self.twin >= 0)) == 2 * (len(self.triangles) - 1)

    def optimise_piece(
        self, root: int, most: int, *, depth_first: bool = False, turn: int = 0
    ) -> np.ndarray:
        """Replace a piece grown from `root` by its optimum; return the rows it consists of."""
        rows = np.empty(most, dtype=np.int32)
        size = grow(self.twin, root, most, depth_first, turn, self._tree, rows)
        rows = rows[:size]
        cycle, local, outline = unfold(self.triangles, self.twin, self._tree, root, size)
        self._tree[rows] = False
        if size > 1:
            better = optimum(self.points[cycle], local, self.cost)
            fold_back(self.triangles, self.twin, rows, cycle, outline, better)
        return rows

    def total(self) -> float:
        """Return the cost of the whole."""
        return evaluate(self.points, self.triangles, self.cost)


def search_cuts(points: np.ndarray, triangles: np.ndarray, cost: Cost, seed: int = 0) -> np.ndarray:
    """Improve a whole polygon with holes over several choices of cuts; return (m, 3)."""
    work = Patchwork(points, triangles, cost)
    size = len(triangles)
    if work.is_tree():
        work.optimise_piece(0, size)
        return work.triangles
    rng = np.random.default_rng(seed)
    best = work.total()
    idle = 0
    while idle < _PATIENCE:
        root, turn = int(rng.integers(size)), int(rng.integers(3))
        work.optimise_piece(root, size, depth_first=bool(idle % 2), turn=turn)
        total = work.total()
        idle = 0 if total < best - 1e-12 * abs(best) else idle + 1
        best = min(best, total)
    return work.triangles


def sweep_windows(
    points: np.ndarray, triangles: np.ndarray, cost: Cost, piece: int = PIECE, seed: int = 0
) -> np.ndarray:
    """Improve a large polygon by overlapping windows of at most `piece` triangles."""
    work = Patchwork(points, triangles, cost)
    rng = np.random.default_rng(seed)
    best = work.total()
    for _ in range(_ROUNDS):
        waiting = np.ones(len(triangles), dtype=np.bool_)
        for root in rng.permutation(len(triangles)).tolist():
            if waiting[root]:
                waiting[work.optimise_piece(root, piece)] = False
        total = work.total()
        if total >= best - _ENOUGH * abs(best):
            break
        best = total
    return work.triangles
