"""Places of equal numbers in an array, group after group, by a counting sort."""

import numpy as np

from triangulators.compute.kernels import njit


@njit(nogil=True)
def grouped(keys: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (start, places): `keys[places[start[k]:start[k + 1]]]` are all k, places ascending.

    keys (n,) in 0..count - 1; start (count + 1,) int64; places (n,) int32. Takes two passes.
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
