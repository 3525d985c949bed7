"""Confidence intervals that assume nothing of the distribution."""

from __future__ import annotations

import numpy as np

CONFIDENCE = 0.95


def median_interval(samples: list[float]) -> tuple[float, float]:
    """Return the exact order-statistics 95 % confidence interval of the median.

    It assumes nothing of the distribution; with fewer than six samples there is none and the
    range is returned. Source: David & Nagaraja, Order Statistics, section 7.1.
    """
    from scipy.special import bdtr

    ordered = sorted(samples)
    n = len(ordered)
    # Largest k with P(Binomial(n, 1/2) < k) <= 2.5 %: the k-th smallest and k-th largest.
    below = bdtr(np.arange(n), n, 0.5)
    k = int(np.searchsorted(below, (1 - CONFIDENCE) / 2, side="right"))
    if k == 0:
        return ordered[0], ordered[-1]
    return ordered[k - 1], ordered[n - k]
