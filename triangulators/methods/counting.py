"""The number of triangulations of a simple polygon, and uniform random triangulations.

The dynamic program of `optimum.visible_lists`, with sums and products instead of minima and sums.
Source: P. Epstein and J.-R. Sack, "Generating triangulations at random", 1994.
"""

import numpy as np
import shapely

from triangulators.compute.kernels import njit
from triangulators.initial import Cycle, make_cycle, require_few_vertices
from triangulators.polygon import Boundary, checked_boundary

MAX_VERTICES = 2000  # maximum for `draw_triangulation`, which stores a matrix of all vertex pairs


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
    require_few_vertices(outline, "random", MAX_VERTICES)
    ring = make_cycle(outline, "random")
    counts = compute_log_counts(ring.start, ring.target)
    chances = np.random.default_rng(seed).random(max(len(ring.cycle) - 2, 0))
    return np.asarray(ring.cycle[_draw_from_counts(counts, chances)])
