"""Rank correlation; SciPy's, with all of `scipy.stats`, takes longer to import than a short run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]


def ranks(values: Column) -> Column:
    """Return each value's rank from 1 on, the mean of theirs where values are equal."""
    _, which, times = np.unique(values, return_inverse=True, return_counts=True)
    mean: Column = (np.cumsum(times) - (times - 1) / 2)[which]
    return mean


def spearman(x: Column, y: Column) -> float:
    """Return Spearman's coefficient; NaN where either column is constant or shorter than 3."""
    if len(x) < 3 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return float("nan")
    return float(np.corrcoef(ranks(x), ranks(y))[0, 1])
