"""Low quantiles of times, which other programs hardly move, and how well they are known."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILE = 0.1
"""Of the samples: low enough to be clear of other programs, not as fickle as the fastest one."""

RESAMPLES = 2000

Samples = NDArray[np.float64]


def positive(values: Sequence[Any]) -> Samples:
    """Return (n,) samples; what is no positive number is left out."""
    numbers = np.array([v for v in values if isinstance(v, int | float)], np.float64)
    return numbers[np.isfinite(numbers) & (numbers > 0)]


def low_quantile(samples_s: Sequence[Any]) -> float | None:
    """Return the low quantile of a record's samples in seconds, None where there are none."""
    samples = positive(samples_s)
    return float(np.quantile(samples, QUANTILE)) if len(samples) else None


def log_ratio(base: Samples, head: Samples) -> float:
    """Return the log of HEAD's low quantile over BASE's."""
    return float(np.log(np.quantile(head, QUANTILE) / np.quantile(base, QUANTILE)))


def margins(base: Samples, head: Samples, confidence: float) -> Samples:
    """Return how far below and above `log_ratio` its percentile bootstrap interval reaches.

    (2,); the same at every call.
    """
    rng = np.random.default_rng(zlib.crc32(base.tobytes() + head.tobytes()))
    ratios = np.log(_resampled(head, rng) / _resampled(base, rng))
    low, high = np.quantile(ratios, [(1 - confidence) / 2, (1 + confidence) / 2])
    ratio = log_ratio(base, head)
    return np.maximum(0.0, [ratio - low, high - ratio])


def _resampled(samples: Samples, rng: np.random.Generator) -> Samples:
    """Return (RESAMPLES,) low quantiles of samples drawn from `samples` with replacement.

    No sample is drawn: the k-th smallest of n uniform numbers has the distribution Beta(k, n+1-k),
    and above it the next is the smallest of n-k. Where they fall among the sorted samples is what
    drawing n of them would have given, so a hundred thousand samples cost as little as thirty.
    """
    n = len(samples)
    ordered = np.sort(samples)
    place = QUANTILE * (n - 1)  # numpy's: between the order statistics k and k + 1
    k = int(place) + 1
    lower = rng.beta(k, n + 1 - k, RESAMPLES)
    found = ordered[_index(lower, n)]
    share = place - int(place)
    if share > 0:
        upper = 1 - (1 - lower) * rng.random(RESAMPLES) ** (1 / (n - k))
        found = (1 - share) * found + share * ordered[_index(upper, n)]
    return found


def _index(uniform: Samples, n: int) -> NDArray[np.intp]:
    return np.minimum((uniform * n).astype(np.intp), n - 1)
