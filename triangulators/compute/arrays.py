"""Small things that kernels do with arrays: copies, groups of equal numbers, what hangs together.

Numba compiles the text of an error message with every slice that is assigned to, for some two
seconds of compiling; the copies here, element by element of arrays of equal shape, have none.
"""

import numpy as np

from triangulators.compute.kernels import njit


@njit(nogil=True)
def copy_row(source: np.ndarray, into: np.ndarray) -> None:
    """Copy (n,)."""
    for k in range(len(source)):
        into[k] = source[k]


@njit(nogil=True)
def copy_rows(source: np.ndarray, into: np.ndarray) -> None:
    """Copy (n, k)."""
    for row in range(len(source)):
        for k in range(source.shape[1]):
            into[row, k] = source[row, k]


@njit(nogil=True)
def grouped(keys: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (start, places): `keys[places[start[k]:start[k + 1]]]` are all k, places ascending.

    keys (n,) in 0..count - 1; start (count + 1,) int64; places (n,) int32. A counting sort, in two
    passes.
    """
    start = np.zeros(count + 2, dtype=np.int64)
    for key in keys:
        start[key + 2] += 1
    for k in range(count):
        start[k + 2] += start[k + 1]
    places = np.empty(len(keys), dtype=np.int32)
    # start[k + 1] is where the next one of k goes: in the end it is where those of k + 1 begin.
    for place in range(len(keys)):
        places[start[keys[place] + 1]] = place
        start[keys[place] + 1] += 1
    return start[:-1], places


@njit
def root_of(parent: np.ndarray, v: int) -> int:
    """Return the root of the tree that `v` is in; parent (n,): 0..n - 1 where all are apart.

    Paths are halved as they are walked (union-find).
    """
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
