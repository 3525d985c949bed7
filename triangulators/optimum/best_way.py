"""The optimum of one polygon, by whichever table is the fastest there; of pieces, beyond tables.

full_table     boxes and edges, without visibility: small rings, and those where most corners see
               each other
visible_lists  any cost, over the pairs of corners that see each other
cut_holes      small polygons with few holes, all ways to cut them into one ring

Where no table is for the whole polygon, a triangulation of it is improved by optimising pieces of
it exactly. A piece is a tree of neighbouring triangles, unfolded into a simple polygon (see
`unfold`); its own triangulation is one of those the exact method chooses from, so no step makes
anything worse. With the whole polygon as the piece, a tree crosses all but h of the diagonals that
matter: the others are the cuts between the holes and the outline, and other trees give other cuts.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.criteria import Criterion
from triangulators.criteria.cost import Cost, plain_cost, total_cost
from triangulators.errors import TriangulationError
from triangulators.geometry.half_edges import twins_of
from triangulators.geometry.predicates import grid_unit
from triangulators.geometry.unfold import fold_back, grow, unfold
from triangulators.geometry.visibility import visible_pairs
from triangulators.optimum.cut_holes import by_cuts
from triangulators.optimum.full_table import SMALL, by_full_table
from triangulators.optimum.visible_lists import by_lists
from triangulators.polygon import Boundary

TABLE_ONLY = 128  # corners; up to here looking for visible pairs costs more than it saves
_SPARSE_TO_DENSE = 2.0  # measured: time of one apex tried, by visible pairs against by ring

PIECE = 200  # triangles in a window of a large polygon
_ROUNDS = 12  # sweeps of windows at most
_ENOUGH = 5e-3  # a sweep that gains less than this part of the cost is the last
_PATIENCE = 6  # cuts tried in a row without gain before giving up on better ones


def optimum(points: np.ndarray, triangles: np.ndarray, cost: Cost) -> np.ndarray:
    """Return the triangulation (n - 2, 3) of least cost of a simple polygon.

    points: (n, 2), a counter-clockwise cycle, in which a point may be met several times;
    triangles: (n - 2, 3), some triangulation of it, positions in the cycle. Raises
    `TriangulationError` if there is none.

    Exact for all doubles: orientations and visibility are decided by exact predicates.
    """
    n = len(points)
    if cost["is_box"] and n <= TABLE_ONLY:
        found = _by_ring(points, cost["box"])
        if found is not None:
            return found
    start, target = visible_pairs(points, triangles, twins_of(triangles), n * n)
    if cost["is_box"]:
        tried = _apexes_tried(n, target)
        everything = len(target) == n * (n - 1) // 2
        if tried * _SPARSE_TO_DENSE > n**3 / 6.0 and (everything or grid_unit(points) > 0.0):
            found = _by_ring(points, cost["box"])
            if found is not None:
                return found
    found = by_lists(points, start, target, cost)
    if len(found) != n - 2:
        raise TriangulationError(f"no triangulation of {n} corners found")
    return found


@njit(nogil=True)
def _apexes_tried(n: int, target: np.ndarray) -> float:
    """Return how many apexes lists try: half the square of each one's length.

    `np.bincount` would copy all pairs to int64, as much memory as a third of the lists.
    """
    seen_from_above = np.zeros(n)
    for j in target:
        seen_from_above[j] += 1.0
    return np.sum(seen_from_above * seen_from_above) / 2.0


def quick_optimum(
    outline: Boundary, criterion: Criterion, sign: float, limit: int
) -> np.ndarray | None:
    """Return the optimum (m, 3) of a small polygon, in `order.walk`'s order, or None.

    None where it is not small, has more vertices than `limit` or rings that touch, or where the
    criterion is not made of boxes and edges alone: then `optimum` and what is around it do it.
    """
    points = outline.points
    if len(points) > min(limit, SMALL) or not (outline.simple or outline.holes):
        return None
    cost = plain_cost(criterion, sign)
    if cost is None or not cost["is_box"]:
        return None
    triangles = np.empty((len(points) + 2 * outline.holes - 2, 3), dtype=np.int32)
    if outline.holes:
        found = by_cuts(points, outline.ring_offsets, cost["box"], triangles)
    else:
        found = by_full_table(points, cost["box"], triangles) < np.inf
    return triangles if found else None


def _by_ring(points: np.ndarray, box: np.ndarray) -> np.ndarray | None:
    triangles = np.empty((len(points) - 2, 3), dtype=np.int32)
    return triangles if by_full_table(points, box, triangles) < np.inf else None


class Patchwork:
    """A triangulation under improvement: triangles (m, 3) of points (n, 2), and twins."""

    def __init__(self, points: np.ndarray, triangles: np.ndarray, cost: Cost) -> None:
        self.points = points
        self.triangles = np.ascontiguousarray(triangles, dtype=np.int32).copy()
        self.twin = twins_of(self.triangles)
        self.cost = cost
        self._tree = np.zeros(self.twin.shape, dtype=np.bool_)

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
        return total_cost(self.points, self.triangles, self.cost)


def search_cuts(points: np.ndarray, triangles: np.ndarray, cost: Cost, seed: int = 0) -> np.ndarray:
    """Improve a whole polygon with holes over several choices of cuts; return (m, 3)."""
    work = Patchwork(points, triangles, cost)
    size = len(triangles)
    # Where the triangles hang together as a tree it is one simple polygon: nothing to cut.
    if np.count_nonzero(work.twin >= 0) == 2 * (size - 1):
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
