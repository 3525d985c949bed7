"""Choose the fastest exact solver for one polygon; local search for polygons without one.

full_table     box and edge costs of small rings, or of rings where most vertices see each other
visible_lists  any cost of one ring, over the pairs of vertices that see each other; with `any_cost`
cut_holes      box and edge costs of small polygons with few holes, over all ways to cut them open

Local search optimises pieces of a triangulation exactly: trees of adjacent triangles, unfolded into
simple polygons (see `half_edges`). No step increases the cost. If the piece is the complete
polygon, the diagonals that the tree does not cross cut the holes open; other trees give other cuts.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.criteria import Criterion
from triangulators.criteria.cost import Cost, compute_total_cost, find_plain_cost
from triangulators.errors import TriangulationError
from triangulators.geometry.half_edges import (
    find_twins,
    grow_tree,
    replace_tree_triangles,
    unfold_tree,
)
from triangulators.geometry.predicates import find_grid_unit
from triangulators.geometry.visibility import find_visible_pairs
from triangulators.optimum.cut_holes import solve_by_cuts
from triangulators.optimum.full_table import MAX_SMALL_VERTICES, solve_by_full_table
from triangulators.optimum.visible_lists import solve_visible_pairs
from triangulators.polygon import Boundary

# Up to this number of vertices, finding visible pairs takes longer than the sparse program saves.
MAX_DENSE_VERTICES = 128
_SPARSE_TO_DENSE = 2.0  # measured time per apex of the sparse program, relative to the dense one
MAX_PIECE_TRIANGLES = 200  # maximum number of triangles in a piece of a large polygon
_MAX_SWEEPS = 12  # maximum number of sweeps; a sweep optimises pieces that cover all triangles
_MIN_GAIN = 5e-3  # a sweep that saves less than this share of the cost is the last
_PATIENCE = 6  # consecutive trees without a gain after which `optimise_along_random_trees` stops


def find_optimum(points: np.ndarray, triangles: np.ndarray, cost: Cost) -> np.ndarray:
    """Return the optimum (n - 2, 3) of a counter-clockwise cycle (n, 2), from any triangulation."""
    n = len(points)
    if cost["is_box"] and n <= MAX_DENSE_VERTICES:
        optimal = solve_by_full_table(points, cost["box"])
        if optimal is not None:
            return optimal
    start, target = find_visible_pairs(points, triangles, find_twins(triangles))
    if cost["is_box"]:
        is_convex = len(target) == n * (n - 1) // 2
        is_dense = _count_apexes(n, target) * _SPARSE_TO_DENSE > n**3 / 6.0
        if is_dense and (is_convex or find_grid_unit(points) > 0.0):
            optimal = solve_by_full_table(points, cost["box"])
            if optimal is not None:
                return optimal
    optimal = solve_visible_pairs(points, start, target, cost)
    if len(optimal) != n - 2:
        raise TriangulationError(f"no triangulation of {n} vertices found")
    return optimal


@njit(nogil=True)
def _count_apexes(n: int, target: np.ndarray) -> float:
    # Half the sum of the lists' squared lengths. `np.bincount` would copy all pairs to int64.
    seen_from_above = np.zeros(n)
    for j in target:
        seen_from_above[j] += 1.0
    return np.sum(seen_from_above * seen_from_above) / 2.0


def find_optimum_of_small_polygon(
    outline: Boundary, criterion: Criterion, sign: float, limit: int
) -> np.ndarray | None:
    """Return the optimum (m, 3) of a small polygon, or None if the polygon is unsupported."""
    points = outline.points
    if len(points) > min(limit, MAX_SMALL_VERTICES) or not (outline.simple or outline.holes):
        return None
    cost = find_plain_cost(criterion, sign)
    if cost is None or not cost["is_box"]:
        return None
    if not outline.holes:
        return solve_by_full_table(points, cost["box"])
    triangles = np.empty((len(points) + 2 * outline.holes - 2, 3), dtype=np.int32)
    is_solved = solve_by_cuts(points, outline.ring_offsets, cost["box"], triangles)
    return triangles if is_solved else None


class Patchwork:
    """A triangulation to optimise piece by piece, in place; the given triangles are copied."""

    def __init__(self, points: np.ndarray, triangles: np.ndarray, cost: Cost) -> None:
        self.points = points
        self.triangles = np.ascontiguousarray(triangles, dtype=np.int32).copy()
        self.twin = find_twins(self.triangles)
        self.cost = cost
        self._tree = np.zeros(self.twin.shape, dtype=np.bool_)
        self._visited = np.zeros(len(self.twin), dtype=np.bool_)
        self._position_of = np.full(self.twin.size, -1, dtype=np.int32)

    def optimise_piece(
        self, root: int, max_size: int, *, depth_first: bool = False, first_edge: int = 0
    ) -> np.ndarray:
        """Replace a tree of adjacent triangles by its optimum; return their indices (k,)."""
        rows = np.empty(max_size, dtype=np.int32)
        marks = (self._visited, self._visited)
        size = grow_tree(self.twin, root, depth_first, first_edge, self._tree, rows, *marks, 0)
        rows = rows[:size]
        cycle, local, outline = unfold_tree(self.triangles, self.twin, self._tree, root, size)
        self._tree[rows] = False
        if size > 1:
            better = find_optimum(self.points[cycle], local, self.cost)
            replace_tree_triangles(
                self.triangles, self.twin, rows, cycle, outline, better, self._position_of
            )
        return rows

    def compute_cost(self) -> float:
        """Return the cost of all triangles."""
        return compute_total_cost(self.points, self.triangles, self.cost)


def optimise_along_random_trees(
    points: np.ndarray, triangles: np.ndarray, cost: Cost, seed: int = 0
) -> np.ndarray:
    """Optimise a polygon with holes, opened along random trees; return the triangles (m, 3)."""
    work = Patchwork(points, triangles, cost)
    size = len(triangles)
    # If the dual graph is a tree, the triangles are a simple polygon, and one piece is the optimum.
    if np.count_nonzero(work.twin >= 0) == 2 * (size - 1):
        work.optimise_piece(0, size)
        return work.triangles
    rng = np.random.default_rng(seed)
    best = work.compute_cost()
    failures = 0
    while failures < _PATIENCE:
        root, first_edge = int(rng.integers(size)), int(rng.integers(3))
        work.optimise_piece(root, size, depth_first=bool(failures % 2), first_edge=first_edge)
        total = work.compute_cost()
        failures = 0 if total < best - 1e-12 * abs(best) else failures + 1
        best = min(best, total)
    return work.triangles


def sweep_pieces(
    points: np.ndarray, triangles: np.ndarray, cost: Cost, limit: int, seed: int
) -> np.ndarray:
    """Optimise overlapping trees of `limit` triangles, at most 200; return all triangles (m, 3)."""
    work = Patchwork(points, triangles, cost)
    rng = np.random.default_rng(seed)
    best = work.compute_cost()
    for _ in range(_MAX_SWEEPS):
        waiting = np.ones(len(triangles), dtype=np.bool_)
        for root in rng.permutation(len(triangles)).tolist():
            if waiting[root]:
                waiting[work.optimise_piece(root, min(MAX_PIECE_TRIANGLES, limit))] = False
        total = work.compute_cost()
        if total >= best - _MIN_GAIN * abs(best):
            break
        best = total
    return work.triangles
