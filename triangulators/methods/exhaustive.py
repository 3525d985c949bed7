"""The method of the paper (Kryvda and Sulema): list every triangulation, take the best.

Mode `paper` is the paper's recursion over cuts (see `paper`); as the paper's program did, it drops
a vertex that has become straight, so its results are not all conforming. Mode `conforming` lists
all valid triangulations, each once, by a recursion over the apexes of one side: without dropping,
the paper's recursion gives the same and removes duplicates.
"""

from collections.abc import Callable
from typing import Literal

import numpy as np
import shapely

from triangulators import criteria
from triangulators.criteria.cost import cheapest, cost_of
from triangulators.errors import Skipped, TriangulationError
from triangulators.methods.count_triangulations import count_of_cycle, count_triangulations
from triangulators.methods.ear_recursion import Recursion
from triangulators.polygon import Boundary, boundary, boundary_area, check, remembered
from triangulators.starting.starts import Cycle, cycle_of

Mode = Literal["conforming", "paper"]
MOST = 1_000_000  # triangulations; beyond, `optimal` finds the best without listing any
MOST_PAPER = 20_000  # the recursion over all cuts keeps a set for every remaining polygon
Triangle = tuple[int, int, int]

__all__ = ["count_triangulations", "enumerate_triangulations", "tabulate"]


def enumerate_triangulations(
    polygon: shapely.Polygon, mode: Mode = "conforming"
) -> np.ndarray | list[np.ndarray]:
    """Return all triangulations of a polygon without holes, none twice.

    Mode `conforming`: one array (count, n - 2, 3) int32. Mode `paper`: a list of arrays (m, 3), as
    dropped vertices leave fewer triangles. Raises `InvalidPolygon`, `Skipped` for holes, and
    `TriangulationError`, naming the count, if there are more than 10^6 (20,000 in mode `paper`).
    """
    check(polygon)
    outline = boundary(polygon)
    ring = cycle_of(outline, "exhaustive")
    if mode == "conforming":
        return ring.cycle[_all(ring)]
    if mode != "paper":
        raise ValueError(f"mode is 'conforming' or 'paper', not {mode!r}")
    return _paper(outline, ring)


def _paper(outline: Boundary, ring: Cycle) -> list[np.ndarray]:
    _refuse(count_of_cycle(ring), MOST_PAPER)
    found = Recursion(outline.points, drop_straight=True).all(ring.cycle.tolist())
    return [np.array(sorted(triangles), dtype=np.int32) for triangles in sorted(map(sorted, found))]


def _refuse(count: int, most: int) -> None:
    if count > most:
        digits = str(count)
        named = digits if count < 10**15 else f"about {digits[0]}.{digits[1:3]}e{len(digits) - 1}"
        raise TriangulationError(
            f"exhaustive: the polygon has {named} triangulations, more than {most};"
            " use 'optimal', which finds the best without listing them"
        )


def _all(ring: Cycle) -> np.ndarray:
    """Return all triangulations of a cycle, (count, n - 2, 3) positions in it."""
    _refuse(count_of_cycle(ring), MOST)
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


def tabulate(polygon: shapely.Polygon, mode: Mode = "conforming") -> dict[str, np.ndarray]:
    """Return one row a triangulation, as columns of equal length.

    Columns: those of `criteria.predict`, `conforming` (bool) and `diagonals` (text: "0-2 2-5", the
    edges between triangles, by their vertices).
    """
    outline = boundary(polygon)
    found = enumerate_triangulations(polygon, mode)
    rows = [criteria.predict(outline.points, triangles) for triangles in found]
    columns = {key: np.array([row[key] for row in rows]) for key in rows[0]}
    sides = {frozenset(edge) for edge in outline.edges.tolist()}
    columns["diagonals"] = np.array([_diagonals(triangles, sides) for triangles in found])
    columns["conforming"] = columns["triangles"] == outline.expected_triangles
    return columns


def _diagonals(triangles: np.ndarray, sides: set[frozenset[int]]) -> str:
    edges = {frozenset(pair) for a, b, c in triangles.tolist() for pair in ((a, b), (b, c), (c, a))}
    return " ".join(f"{a}-{b}" for a, b in sorted(map(sorted, edges - sides)))


def triangulate(
    outline: Boundary,
    *,
    criterion: criteria.Criterion | str | Callable[..., float] = "overdraw",
    **parameters: object,
) -> np.ndarray:
    """Return the best of all triangulations; raises `Skipped` for holes and for too many."""
    ring = cycle_of(outline, "exhaustive")
    if count_of_cycle(ring, MOST) > MOST:
        raise Skipped(
            f"exhaustive: the polygon has more than {MOST} triangulations;"
            " 'optimal' finds the best without listing them"
        )
    found = criteria.find(criterion, **parameters)
    cost = cost_of(found, boundary_area(outline), outline.expected_triangles)
    everything = _all(ring)
    return ring.cycle[everything[cheapest(ring.points, everything, cost)]]


def triangulate_listed(outline: Boundary, *, k: int = 0) -> np.ndarray:
    """Return the k-th of all triangulations (m, 3), in ascending order of A and then of D.

    Mode `paper`: those with T-junctions are among them. The lists of the last polygons are kept.
    Raises `Skipped` for holes, for more than 20,000, and where the list ends before k.
    """
    everything = _listed(outline)
    if not 0 <= k < len(everything):
        raise Skipped(f"listed: the list ends at number {len(everything) - 1}, before {k}")
    return everything[k].copy()


@remembered(8)
def _listed(outline: Boundary) -> list[np.ndarray]:
    ring = cycle_of(outline, "listed")
    if count_of_cycle(ring, MOST_PAPER) > MOST_PAPER:
        raise Skipped(f"listed: the polygon has more than {MOST_PAPER} triangulations")
    found = _paper(outline, ring)
    return sorted(found, key=lambda triangles: _order(outline.points, triangles))


def _order(points: np.ndarray, triangles: np.ndarray) -> tuple[float, float]:
    """Return what listed triangulations are sorted by: A and D, rounded so that equal ones tie."""
    sums = criteria.predict(points, triangles)
    return round(sums["overdraw"], 9), round(sums["shape"], 9)
