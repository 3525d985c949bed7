"""How many triangulations a simple polygon has, and one of them drawn at random.

The recurrence of the optimum with sums and products for minima and sums. Drawn is the apex over a
pair of corners, in proportion to the triangulations that it leaves, so that each is equally likely.
Source: P. Epstein and J.-R. Sack, "Generating triangulations at random", 1994.
"""

import numpy as np
import shapely

from triangulators.compute.kernels import njit
from triangulators.errors import SkippedError
from triangulators.initial import Cycle, cycle_of
from triangulators.polygon import Boundary, checked_boundary

LIMIT = 2000  # corners of one drawn at random, as a table of all pairs is kept


def count_triangulations(polygon: shapely.Polygon, most: int | None = None) -> int:
    """Return the exact number of triangulations of a polygon without holes.

    most: where there are more, that there are is all that is found out; see `count_of_cycle`.
    Raises `InvalidPolygonError`, and `SkippedError` for holes.
    """
    return count_of_cycle(cycle_of(checked_boundary(polygon), "count"), most)


def count_of_cycle(ring: Cycle, most: int | None = None) -> int:
    """Return the exact number of triangulations of a `Cycle`.

    most: stop at the first part of the polygon that has more, and return how many that has: the
    polygon has no fewer, as every triangulation of a part is one of the whole when completed.
    """
    n = len(ring.cycle)
    above = [ring.target[ring.start[i] : ring.start[i + 1]].tolist() for i in range(n)]
    ways: list[dict[int, int]] = [{} for _ in range(n)]  # ways[j][k]: of the corners k..j
    for i in range(n - 1, -1, -1):
        row: dict[int, int] = {}
        for j in above[i]:
            total = 1 if j == i + 1 else 0
            for k, right in ways[j].items():
                left = row.get(k)
                if left is not None:
                    total += left * right
            row[j] = total
            if most is not None and total > most:
                return total
        for j, total in row.items():
            ways[j][i] = total
    return row[n - 1]


@njit
def log_counts(start: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return the logarithm of the number of triangulations beneath each visible pair, (pairs,).

    start, target: the `visible_pairs` of a cycle. Logarithms, as the numbers outgrow any float; a
    sum of them is taken relative to its largest, `top`. Corner i descends, so that the apexes'
    numbers are known: `row[k]` is that of i..k, `below[j, k]` that of k..j, and what does not see
    each other has minus infinity, which adds nothing. n^2 numbers; n^3 / 6 steps at most.
    """
    n = len(start) - 1
    result = np.full(len(target), -np.inf)
    row = np.full(n, -np.inf)
    below = np.full((n, n), -np.inf)  # [j, k]: of the corners k..j
    for i in range(n - 1, -1, -1):
        for p in range(start[i], start[i + 1]):
            j = target[p]
            if j == i + 1:
                result[p] = 0.0
            else:
                top = -np.inf
                for k in range(i + 1, j):
                    top = max(top, row[k] + below[j, k])
                total = 0.0
                if top > -np.inf:
                    for k in range(i + 1, j):
                        total += np.exp(row[k] + below[j, k] - top)
                    result[p] = top + np.log(total)
            row[j] = below[j, i] = result[p]
        for p in range(start[i], start[i + 1]):
            row[target[p]] = -np.inf
    return result


@njit
def _drawn(
    start: np.ndarray, target: np.ndarray, ways: np.ndarray, chances: np.ndarray
) -> np.ndarray:
    """Draw one triangulation (n - 2, 3); chances: (n - 2,) uniform in [0, 1).

    start, target: the `visible_pairs` of a cycle; ways (pairs,): `log_counts`. Of the W(i, j)
    triangulations beneath the pair i-j, W(i, k) W(k, j) have the apex k, so that share of them is
    taken from the chance in turn, k by k; where it is used up is the apex, and the last possible k
    takes what rounding leaves. A stack of pairs, from 0, n - 1 on; n^2 numbers, and up to n steps
    for each triangle.
    """
    n = len(start) - 1
    table = np.full((n, n), -np.inf)
    for i in range(n):
        for p in range(start[i], start[i + 1]):
            table[i, target[p]] = table[target[p], i] = ways[p]
    triangles = np.empty((n - 2, 3), dtype=np.int32)
    waiting = [(0, n - 1)]
    found = 0
    while len(waiting) > 0:
        i, j = waiting.pop()
        if j - i < 2:
            continue
        remaining = chances[found]
        apex = -1
        for k in range(i + 1, j):
            share = table[i, k] + table[j, k] - table[i, j]
            if share > -np.inf:
                apex = k
                remaining -= np.exp(share)
                if remaining < 0.0:
                    break
        triangles[found, 0], triangles[found, 1], triangles[found, 2] = i, apex, j
        found += 1
        waiting.append((i, apex))
        waiting.append((apex, j))
    return triangles


def draw(outline: Boundary, *, seed: int = 0) -> np.ndarray:
    """Return a triangulation (n - 2, 3) drawn uniformly; the same seed gives the same one.

    Raises `SkippedError` for holes, where they cannot be counted, and beyond 2000 vertices.
    """
    if len(outline.edges) > LIMIT:
        raise SkippedError(f"random: {len(outline.edges)} vertices, more than {LIMIT}")
    ring = cycle_of(outline, "random")
    ways = log_counts(ring.start, ring.target)
    chances = np.random.default_rng(seed).random(max(len(ring.cycle) - 2, 0))
    return np.asarray(ring.cycle[_drawn(ring.start, ring.target, ways, chances)])
