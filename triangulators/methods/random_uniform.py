"""A random triangulation, each of a simple polygon's equally likely.

The apex over a pair of corners is drawn in proportion to the triangulations it leaves. Source:
P. Epstein and J.-R. Sack, "Generating triangulations at random", 1994.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.errors import Skipped
from triangulators.methods.count_triangulations import log_counts
from triangulators.polygon import Boundary
from triangulators.starting.starts import cycle_of

LIMIT = 2000  # corners, as a table of all pairs is kept


@njit
def _draw(
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


def triangulate(outline: Boundary, *, seed: int = 0) -> np.ndarray:
    """Return a triangulation (n - 2, 3) drawn uniformly; the same seed gives the same one.

    Raises `Skipped` for holes, where they cannot be counted, and beyond 2000 vertices.
    """
    if len(outline.edges) > LIMIT:
        raise Skipped(f"random: {len(outline.edges)} vertices, more than {LIMIT}")
    ring = cycle_of(outline, "random")
    ways = log_counts(ring.start, ring.target)
    chances = np.random.default_rng(seed).random(max(len(ring.cycle) - 2, 0))
    return ring.cycle[_draw(ring.start, ring.target, ways, chances)]
