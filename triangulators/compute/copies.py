"""Copies of arrays in compiled code, element by element.

Numba compiles the text of an error message with every slice that is assigned to, for some two
seconds of compiling; these have none. Arrays must be of equal shape.
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
