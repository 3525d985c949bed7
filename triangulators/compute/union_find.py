"""What hangs together: a forest of parents, with paths halved as they are walked (union-find)."""

import numpy as np

from triangulators.compute.kernels import njit


@njit
def root_of(parent: np.ndarray, v: int) -> int:
    """Return the root of the tree that `v` is in; parent (n,): 0..n - 1 where all are apart."""
    while parent[v] != v:
        parent[v] = parent[parent[v]]
        v = parent[v]
    return v


@njit
def join(parent: np.ndarray, a: int, b: int) -> bool:
    """Make one tree of those of `a` and `b`; return whether they were two."""
    a, b = root_of(parent, a), root_of(parent, b)
    parent[a] = b
    return a != b
