"""The method of the paper (Kryvda and Sulema): list every triangulation, take the best.

Mode `paper` is the paper's recursion over cuts (`Recursion`); as the paper's program did, it drops
a vertex that has become straight, so its results are not all conforming. Mode `conforming` lists
all valid triangulations, each once, by a recursion over the apexes of one side: without dropping,
the paper's recursion gives the same and removes duplicates.
"""

from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from typing import Literal

import numpy as np
import shapely

from triangulators import criteria
from triangulators.criteria.cost import cheapest, cost_of
from triangulators.errors import SkippedError
from triangulators.geometry.predicates import orient
from triangulators.initial import Cycle, cycle_of
from triangulators.methods.counting import count_of_cycle
from triangulators.polygon import (
    Boundary,
    boundary_area,
    checked_boundary,
    vertices,
)
from triangulators.polygon_arrays import polygon_of_rings

Mode = Literal["conforming", "paper"]
MOST = 1_000_000  # triangulations; beyond, `optimal` finds the best without listing any
MOST_PAPER = 20_000  # the recursion over all cuts keeps a set for every remaining polygon
Triangle = tuple[int, int, int]
Triangulation = frozenset[Triangle]
Corners = tuple[int, ...]


def enumerate_triangulations(
    polygon: shapely.Polygon, mode: Mode = "conforming"
) -> np.ndarray | list[np.ndarray]:
    """Return all triangulations of a polygon without holes, none twice.

    Mode `conforming`: one array (count, n - 2, 3) int32. Mode `paper`: a list of arrays (m, 3), as
    dropped vertices leave fewer triangles. Raises `InvalidPolygonError`, and `SkippedError` for
    holes and for more than 10^6 triangulations (20,000 in mode `paper`).
    """
    outline = checked_boundary(polygon)
    ring = cycle_of(outline, "exhaustive")
    if mode == "conforming":
        return np.asarray(ring.cycle[_all(ring)])
    if mode != "paper":
        raise ValueError(f"mode is 'conforming' or 'paper', not {mode!r}")
    _refuse(ring, MOST_PAPER)
    found = Recursion(outline.points, drop_straight=True).all(ring.cycle.tolist())
    return [np.array(sorted(triangles), dtype=np.int32) for triangles in sorted(map(sorted, found))]


def _refuse(ring: Cycle, most: int) -> None:
    if count_of_cycle(ring, most) > most:
        raise SkippedError(
            f"exhaustive: the polygon has more than {most} triangulations;"
            " 'optimal' finds the best without listing them"
        )


def _all(ring: Cycle) -> np.ndarray:
    """Return all triangulations of a cycle, (count, n - 2, 3) positions in it."""
    _refuse(ring, MOST)
    n = len(ring.cycle)
    lists: list[dict[int, np.ndarray]] = [{} for _ in range(n)]  # lists[j][i]: of corners i..j
    for i in range(n - 1, -1, -1):
        row: dict[int, np.ndarray] = {}
        for j in ring.target[ring.start[i] : ring.start[i + 1]].tolist():
            if j == i + 1:
                row[j] = np.empty((1, 0, 3), dtype=np.int16)
                continue
            parts = [_join(row[k], right, (i, k, j)) for k, right in lists[j].items() if k in row]
            row[j] = np.concatenate(parts) if parts else np.empty((0, j - i - 1, 3), np.int16)
        for j, found in row.items():
            lists[j][i] = found
    return lists[n - 1][0].astype(np.int32)


def _join(left: np.ndarray, right: np.ndarray, triangle: Triangle) -> np.ndarray:
    """Return every pair of a left and a right part with the triangle between them."""
    count = len(left) * len(right)
    between = np.broadcast_to(np.array(triangle, dtype=np.int16), (count, 1, 3))
    return np.concatenate(
        (np.repeat(left, len(right), axis=0), between, np.tile(right, (len(left), 1, 1))), axis=1
    )


def triangulate(
    outline: Boundary,
    *,
    criterion: criteria.Criterion | str | Callable[..., float] = "overdraw",
    **parameters: object,
) -> np.ndarray:
    """Return the best of all triangulations; raises `SkippedError` for holes and for too many."""
    ring = cycle_of(outline, "exhaustive")
    found = criteria.find(criterion, **parameters)
    cost = cost_of(found, boundary_area(outline), outline.expected_triangles)
    everything = _all(ring)
    return np.asarray(ring.cycle[everything[cheapest(ring.points, everything, cost)]])


def triangulate_listed(outline: Boundary, *, k: int = 0) -> np.ndarray:
    """Return the k-th of all triangulations (m, 3), in ascending order of A and then of D.

    Mode `paper`: those with T-junctions are among them. The lists of the last polygons are kept.
    Raises `SkippedError` for holes, for more than 20,000, and where the list ends before k.
    """
    everything = _listed(polygon_of_rings(outline.points, outline.ring_offsets).wkb)
    if not 0 <= k < len(everything):
        raise SkippedError(f"listed: the list ends at number {len(everything) - 1}, before {k}")
    return everything[k].copy()


@lru_cache(maxsize=8)
def _listed(wkb: bytes) -> list[np.ndarray]:
    polygon = shapely.from_wkb(wkb)
    points = vertices(polygon)

    def order(triangles: np.ndarray) -> tuple[float, float]:
        sums = criteria.predict(points, triangles)
        return round(sums["overdraw"], 9), round(sums["shape"], 9)  # so that equal ones tie

    return sorted(enumerate_triangulations(polygon, "paper"), key=order)


class Recursion:
    """All triangulations of the polygons over one set of points, found by cutting ears.

    From each starting vector of the remaining polygon three cuts are tried: the triangle of the
    start and the next vector (the paper's firstPart), that of the previous vector and the one
    before (secondPart), and both (thirdPart). A cut is allowed if its triangle lies inside; what is
    left is treated in the same way until one triangle remains. The set of distinct results is kept.

    points: (n, 2). drop_straight: drop a vertex that a cut has made straight, as the paper's
    program did; triangulations that passed it by are then not conforming.
    """

    def __init__(self, points: np.ndarray, *, drop_straight: bool) -> None:
        rows = points.tolist()
        self._drop_straight = drop_straight
        # Both are asked for the same in many of the remaining polygons.
        self._turn = cache(lambda a, b, c: orient(*rows[a], *rows[b], *rows[c]))
        self._of = cache(self._all_of)

    def all(self, cycle: Sequence[int]) -> set[Triangulation]:
        """Return the distinct triangulations of a counter-clockwise cycle of points."""
        return self._of(_least_first(list(cycle)))

    def _all_of(self, corners: Corners) -> set[Triangulation]:
        found: set[Triangulation] = set()
        if len(corners) == 3:
            if self._turn(*corners) > 0.0:
                a, b, c = corners
                found.add(frozenset({(a, b, c)}))
        else:
            n = len(corners)
            for start in range(n):
                first, second = corners[(start + 1) % n], corners[start - 1]
                for ears in ((first,), (second,), (first, second)):
                    found |= self._after(corners, ears)
        return found

    def _after(self, corners: Corners, ears: tuple[int, ...]) -> set[Triangulation]:
        """Return the triangulations that begin by cutting these vertices off, in turn."""
        cut: set[Triangle] = set()
        for vertex in ears:
            if len(corners) == 3 or vertex not in corners:
                return set()
            at = corners.index(vertex)
            ear = (corners[at - 1], vertex, corners[(at + 1) % len(corners)])
            if not self._is_inside(ear, corners):
                return set()
            a, b, c = _least_first(list(ear))
            cut.add((a, b, c))
            corners = self._without(corners, at)
        return {frozenset(others | cut) for others in self._of(corners)}

    def _is_inside(self, ear: Triangle, corners: Corners) -> bool:
        """Whether a triangle turns left and no other corner lies in it or on its edges."""
        a, b, c = ear
        return self._turn(a, b, c) > 0.0 and all(
            min(self._turn(a, b, v), self._turn(b, c, v), self._turn(c, a, v)) < 0.0
            for v in corners
            if v not in ear
        )

    def _without(self, corners: Corners, at: int) -> Corners:
        rest = [*corners[at + 1 :], *corners[:at]]
        if self._drop_straight:
            # Only the neighbours of what was cut off can have become straight: the ends of `rest`.
            while len(rest) > 3 and self._turn(rest[-1], rest[0], rest[1]) == 0.0:
                rest.pop(0)
            while len(rest) > 3 and self._turn(rest[-2], rest[-1], rest[0]) == 0.0:
                rest.pop()
        return _least_first(rest)


def _least_first(corners: list[int]) -> Corners:
    """Turn a cycle so that it starts with its least index."""
    least = corners.index(min(corners))
    return (*corners[least:], *corners[:least])
