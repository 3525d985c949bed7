"""How many triangulations a simple polygon has.

The recurrence of the optimum with sums and products for minima and sums. Source: P. Epstein and
J.-R. Sack, "Generating triangulations at random", 1994.
"""

import numpy as np
import shapely

from triangulators.compute.kernels import njit
from triangulators.polygon import boundary, check
from triangulators.starting.starts import Cycle, cycle_of


def count_triangulations(polygon: shapely.Polygon, most: int | None = None) -> int:
    """Return the exact number of triangulations of a polygon without holes.

    most: where there are more, that there are is all that is found out; see `count_of_cycle`.
    Raises `InvalidPolygon`, and `Skipped` for holes.
    """
    check(polygon)
    return count_of_cycle(cycle_of(boundary(polygon), "count"), most)


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
