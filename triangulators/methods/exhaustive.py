"""All triangulations of a polygon without holes: their number, a random one, and their list.

The method of the paper (Kryvda and Sulema) lists all triangulations and returns the best. Mode
`paper` is the paper's recursion; it drops vertices that are collinear after a cut, so some results
have T-junctions. Mode `conforming` lists every conforming triangulation once.

Counting is the dynamic program of `optimum.visible_lists`, with sums and products instead of minima
and sums. Source of random triangulations: P. Epstein and J.-R. Sack, "Generating triangulations at
random", 1994.
"""

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Literal

import numpy as np
import shapely

from triangulators import criteria
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import find_cheapest, make_cost
from triangulators.criteria.criterion import CriterionLike
from triangulators.errors import SkippedError
from triangulators.geometry.predicates import orient
from triangulators.initial import Cycle, make_cycle, require_few_vertices
from triangulators.polygon import Boundary, boundary_area, checked_boundary, vertices
from triangulators.polygon_arrays import polygon_of_rings

Mode = Literal["conforming", "paper"]
MAX_RANDOM_VERTICES = 2000  # for `draw_triangulation`, which stores a matrix of all vertex pairs
MAX_TRIANGULATIONS = 1_000_000  # maximum number in mode `conforming`
MAX_PAPER_TRIANGULATIONS = 20_000  # in mode `paper`, which stores a set per remaining polygon
Triangle = tuple[int, int, int]
Triangulation = frozenset[Triangle]
Corners = tuple[int, ...]


def count_triangulations(polygon: shapely.Polygon, max_count: int | None = None) -> int:
    """Return the exact number of triangulations of a polygon without holes."""
    return count_triangulations_of_cycle(make_cycle(checked_boundary(polygon), "count"), max_count)


def count_triangulations_of_cycle(ring: Cycle, max_count: int | None = None) -> int:
    """Return the exact number of triangulations of a cycle, or a lower bound above `max_count`."""
    n = len(ring.cycle)
    above = [ring.target[ring.start[i] : ring.start[i + 1]].tolist() for i in range(n)]
    # ways[j][k]: number of triangulations of the sub-polygon k..j
    ways: list[dict[int, int]] = [{} for _ in range(n)]
    for i in range(n - 1, -1, -1):
        row: dict[int, int] = {}
        for j in above[i]:
            total = 1 if j == i + 1 else 0
            for k, after in ways[j].items():
                before = row.get(k)
                if before is not None:
                    total += before * after
            row[j] = total
            if max_count is not None and total > max_count:
                return total
        for j, total in row.items():
            ways[j][i] = total
    return row[n - 1]


@njit
def compute_log_counts(start: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the logarithms (n, n) of the numbers of triangulations of the sub-polygons i..j.

    They are at [j, i], minus infinity for pairs that are not visible. The numbers would overflow;
    in a sum, terms are divided by the largest, whose logarithm is `top`. Vertex i descends: row[k]
    is the logarithm for the sub-polygon i..k. Takes n^3 / 6 steps.
    """
    n = len(start) - 1
    row = np.full(n, -np.inf)
    counts = np.full((n, n), -np.inf)
    for i in range(n - 1, -1, -1):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            count = 0.0
            if j > i + 1:
                top = -np.inf
                for k in range(i + 1, j):
                    top = max(top, row[k] + counts[j, k])
                count = top
                if top > -np.inf:
                    total = 0.0
                    for k in range(i + 1, j):
                        total += np.exp(row[k] + counts[j, k] - top)
                    count = top + np.log(total)
            row[j] = counts[j, i] = count
        for p in range(start[i], start[i + 1]):
            row[target[p]] = -np.inf
    return counts


@njit
def _draw_from_counts(counts: np.ndarray, chances: np.ndarray) -> np.ndarray:
    """Return a random triangulation (n - 2, 3) of a cycle; chances (n - 2,): uniform in [0, 1).

    Of the W(i, j) triangulations of the sub-polygon i..j, W(i, k) W(k, j) have the apex k. These
    fractions are subtracted from a chance; the first k that makes it negative is the apex, or the
    last possible k if rounding leaves a remainder.
    """
    n = len(counts)
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    waiting = [(0, n - 1)]
    size = 0
    while len(waiting) > 0:
        i, j = waiting.pop()
        if j - i < 2:
            continue
        remaining = chances[size]
        apex = -1
        for k in range(i + 1, j):
            share = counts[k, i] + counts[j, k] - counts[j, i]
            if share > -np.inf:
                apex = k
                remaining -= np.exp(share)
                if remaining < 0.0:
                    break
        triangles[size, 0], triangles[size, 1], triangles[size, 2] = i, apex, j
        size += 1
        waiting.append((i, apex))
        waiting.append((apex, j))
    return triangles


def draw_triangulation(outline: Boundary, *, seed: int = 0) -> np.ndarray:
    """Return a random triangulation (n - 2, 3), all being equally likely, from a seed."""
    require_few_vertices(outline, "random", MAX_RANDOM_VERTICES)
    ring = make_cycle(outline, "random")
    counts = compute_log_counts(ring.start, ring.target)
    chances = np.random.default_rng(seed).random(max(len(ring.cycle) - 2, 0))
    return np.asarray(ring.cycle[_draw_from_counts(counts, chances)])


def enumerate_triangulations(
    polygon: shapely.Polygon, mode: Mode = "conforming"
) -> np.ndarray | list[np.ndarray]:
    """Return all triangulations (count, n - 2, 3), or in mode `paper` a list of arrays (m, 3)."""
    outline = checked_boundary(polygon)
    ring = make_cycle(outline, "exhaustive")
    if mode == "conforming":
        return np.asarray(ring.cycle[_list_triangulations(ring)])
    _check_triangulation_count(ring, MAX_PAPER_TRIANGULATIONS)
    results = Recursion(outline.points, drop_straight=True).list_triangulations(ring.cycle.tolist())
    ordered = sorted(map(sorted, results))
    return [np.array(triangles, dtype=np.int32) for triangles in ordered]


def _check_triangulation_count(ring: Cycle, max_count: int) -> None:
    if count_triangulations_of_cycle(ring, max_count) > max_count:
        raise SkippedError(
            f"exhaustive: more than {max_count} triangulations; use 'optimal', which lists none"
        )


def _list_triangulations(ring: Cycle) -> np.ndarray:
    """Return all triangulations of a cycle, (count, n - 2, 3), as positions in the cycle."""
    _check_triangulation_count(ring, MAX_TRIANGULATIONS)
    n = len(ring.cycle)
    # lists[j][i]: the triangulations of sub-polygon i..j.
    lists: list[dict[int, np.ndarray]] = [{} for _ in range(n)]
    for i in range(n - 1, -1, -1):
        row: dict[int, np.ndarray] = {}
        for j in ring.target[ring.start[i] : ring.start[i + 1]].tolist():
            if j == i + 1:
                row[j] = np.empty((1, 0, 3), dtype=np.int16)
                continue
            parts = [
                _combine_triangulations(row[k], right, (i, k, j))
                for k, right in lists[j].items()
                if k in row
            ]
            row[j] = np.concatenate(parts) if parts else np.empty((0, j - i - 1, 3), np.int16)
        for j, part in row.items():
            lists[j][i] = part
    return lists[n - 1][0].astype(np.int32)


def _combine_triangulations(
    before: np.ndarray, after: np.ndarray, triangle: Triangle
) -> np.ndarray:
    count = len(before) * len(after)
    between = np.broadcast_to(np.array(triangle, dtype=np.int16), (count, 1, 3))
    return np.concatenate(
        (np.repeat(before, len(after), axis=0), between, np.tile(after, (len(before), 1, 1))),
        axis=1,
    )


def triangulate(
    outline: Boundary, *, criterion: CriterionLike = "overdraw", **parameters: object
) -> np.ndarray:
    """Return the triangulation (n - 2, 3) with the minimum of a criterion, by listing all."""
    ring = make_cycle(outline, "exhaustive")
    resolved = criteria.find(criterion, **parameters)
    cost = make_cost(resolved, boundary_area(outline), outline.expected_triangles)
    listed = _list_triangulations(ring)
    return np.asarray(ring.cycle[listed[find_cheapest(ring.points, listed, cost)]])


def triangulate_listed(outline: Boundary, *, k: int = 0) -> np.ndarray:
    """Return triangulation k (m, 3) of mode `paper`, by ascending overdraw, then shape; cached."""
    listed = _list_by_overdraw_and_shape(polygon_of_rings(outline.points, outline.ring_offsets).wkb)
    if not 0 <= k < len(listed):
        raise SkippedError(f"listed: k={k} is out of range; give k from 0 to {len(listed) - 1}")
    return listed[k].copy()


@lru_cache(maxsize=8)
def _list_by_overdraw_and_shape(wkb: bytes) -> list[np.ndarray]:
    polygon = shapely.from_wkb(wkb)
    points = vertices(polygon)

    def order(triangles: np.ndarray) -> tuple[float, float]:
        sums = criteria.predict(points, triangles)
        # Rounded, so that sums that differ by rounding errors only are ties.
        return round(sums["overdraw"], 9), round(sums["shape"], 9)

    return sorted(enumerate_triangulations(polygon, "paper"), key=order)


class Recursion:
    """The triangulations of polygons whose vertices are in `points`, by cutting ears.

    From each edge three cuts are tried: the triangle of this and the next edge (firstPart in the
    paper), that of the two edges before (secondPart), and both (thirdPart); then the rest is cut.
    drop_straight: drop a vertex that a cut has made collinear; the results then do not conform.
    """

    def __init__(self, points: np.ndarray, *, drop_straight: bool) -> None:
        rows = points.tolist()
        self._drop_straight = drop_straight
        # Cached, because the same triples and the same remaining polygons occur many times.
        self._orientation = cache(lambda a, b, c: orient(*rows[a], *rows[b], *rows[c]))
        self._triangulations = cache(self._list_by_cuts)

    def list_triangulations(self, cycle: Sequence[int]) -> set[Triangulation]:
        """Return the distinct triangulations of a counter-clockwise cycle of points."""
        return self._triangulations(_rotate_to_lowest(list(cycle)))

    def _list_by_cuts(self, cycle: Corners) -> set[Triangulation]:
        results: set[Triangulation] = set()
        if len(cycle) == 3:
            if self._orientation(*cycle) > 0.0:
                a, b, c = cycle
                results.add(frozenset({(a, b, c)}))
        else:
            n = len(cycle)
            for start in range(n):
                first, second = cycle[(start + 1) % n], cycle[start - 1]
                for ears in ((first,), (second,), (first, second)):
                    results |= self._cut_ears(cycle, ears)
        return results

    def _cut_ears(self, cycle: Corners, ears: tuple[int, ...]) -> set[Triangulation]:
        ears_cut: set[Triangle] = set()
        for vertex in ears:
            if len(cycle) == 3 or vertex not in cycle:
                return set()
            at = cycle.index(vertex)
            ear = (cycle[at - 1], vertex, cycle[(at + 1) % len(cycle)])
            if not self._is_inside(ear, cycle):
                return set()
            a, b, c = _rotate_to_lowest(list(ear))
            ears_cut.add((a, b, c))
            cycle = self._remove_vertex(cycle, at)
        return {
            frozenset(rest_triangles | ears_cut) for rest_triangles in self._triangulations(cycle)
        }

    def _is_inside(self, ear: Triangle, cycle: Corners) -> bool:
        a, b, c = ear
        return self._orientation(a, b, c) > 0.0 and all(
            min(self._orientation(a, b, v), self._orientation(b, c, v), self._orientation(c, a, v))
            < 0.0
            for v in cycle
            if v not in ear
        )

    def _remove_vertex(self, cycle: Corners, at: int) -> Corners:
        remaining = [*cycle[at + 1 :], *cycle[:at]]
        if self._drop_straight:
            # Only the neighbours of the cut vertex, the ends of `remaining`, may have become
            # collinear.
            while len(remaining) > 3 and self._orientation(remaining[-1], *remaining[:2]) == 0.0:
                remaining.pop(0)
            while len(remaining) > 3 and self._orientation(*remaining[-2:], remaining[0]) == 0.0:
                remaining.pop()
        return _rotate_to_lowest(remaining)


def _rotate_to_lowest(cycle: list[int]) -> Corners:
    start = cycle.index(min(cycle))
    return (*cycle[start:], *cycle[:start])
