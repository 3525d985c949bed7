"""Confidence intervals that assume little of the distribution.

`scripts/studies/interval_coverage.py` shows by simulation how often each holds the truth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95

FEWEST = 6
"""Polygons, or groups, of which fewer tell no interval: that of their median would be open."""

TAIL = 0.01
"""Share of a studentised bootstrap's resamples beyond either end. 2.5 % would do for many values of
little skew. Of ratios and regrets, of which a few large values are most, 2 % cover 90 % with 96
values; 1 % cover 94 % and more."""

RESAMPLES = 1999

UNKNOWN = (float("nan"), float("nan"))
"""Ends of an interval that the values do not tell."""


def median_interval(samples: list[float], confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return the exact order-statistics confidence interval of the median, by default of 95 %.

    It assumes nothing of the distribution; with fewer than six samples there is none and the
    range is returned. Source: David & Nagaraja, Order Statistics, section 7.1.
    """
    from scipy.special import bdtr

    ordered = sorted(samples)
    n = len(ordered)
    # Largest k with P(Binomial(n, 1/2) < k) <= 2.5 %: the k-th smallest and k-th largest.
    below = bdtr(np.arange(n), n, 0.5)
    k = int(np.searchsorted(below, (1 - confidence) / 2, side="right"))
    if k == 0:
        return ordered[0], ordered[-1]
    return ordered[k - 1], ordered[n - k]


def student_interval(
    values: Sequence[float] | NDArray[np.float64], confidence: float = CONFIDENCE
) -> tuple[float, float, float]:
    """Return the mean of independent values and the ends of Student's interval of it.

    Raises
    ------
    ValueError
        for fewer than two values, which tell no interval
    """
    from scipy.special import stdtrit

    count = len(values)
    if count < 2:
        raise ValueError("one value tells no interval")
    reach = float(stdtrit(count - 1, 0.5 + confidence / 2)) * np.std(values, ddof=1) / count**0.5
    middle = float(np.mean(values))
    return middle, middle - float(reach), middle + float(reach)


def mean_interval(values: NDArray[np.float64], seed: int = 0) -> tuple[float, float]:
    """Return the studentised bootstrap's 95 % confidence interval of the mean of (n,) values.

    It follows the skew of the values, which the percentile bootstrap and Student's interval do not.
    `UNKNOWN` for fewer than `FEWEST` values, for values that are all equal, which do not tell how
    far others may lie from them, and where one value so outweighs the others that either end is
    open. What happens to fewer than one in n / 3 is likely not among n values, and no interval of
    theirs holds it. Source: B. Efron and R. Tibshirani, An Introduction to the Bootstrap, 12.5.
    """
    n = len(values)
    if n < FEWEST or np.ptp(values) == 0:
        return UNKNOWN
    drawn = values[np.random.default_rng(seed).integers(n, size=(RESAMPLES, n))]
    mean, error = values.mean(), values.std(ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (drawn.mean(axis=1) - mean) / drawn.std(axis=1, ddof=1)
    return _ends(mean, error, t)


def ratio_interval(
    values: NDArray[np.float64], base: NDArray[np.float64], seed: int = 0
) -> tuple[float, float]:
    """Return the studentised bootstrap's 95 % interval of sum(values) / sum(base), both (n,).

    Values are drawn together with their bases; a ratio's standard error is the jackknife's.
    `UNKNOWN` as for `mean_interval`, and where a base is below 0 or all are 0. Source: B. Efron and
    R. Tibshirani, An Introduction to the Bootstrap, 11 and 12.5.
    """
    n = len(values)
    if n < FEWEST or (base < 0).any() or not base.any():
        return UNKNOWN
    ratio = values.sum() / base.sum()
    residuals = values - ratio * base
    if np.allclose(residuals, 0.0, atol=1e-9 * base.max()):
        return UNKNOWN
    places = np.random.default_rng(seed).integers(n, size=(RESAMPLES, n))
    drawn, below = values[places], base[places]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = drawn.sum(axis=1) / below.sum(axis=1)
        error = _ratio_error(residuals[None], base[None])[0]
        t = (ratios - ratio) / _ratio_error(drawn - ratios[:, None] * below, below)
    return _ends(ratio, error, t)


def _ends(value: float, error: float, t: NDArray[np.float64]) -> tuple[float, float]:
    """Return the interval of a value with its standard error, from its resamples' statistics t."""
    low, high = np.quantile(np.where(np.isnan(t), 0.0, t), [TAIL, 1 - TAIL], method="inverted_cdf")
    if not (np.isfinite(low) and np.isfinite(high)):
        return UNKNOWN
    return float(value - high * error), float(value - low * error)


def _ratio_error(residuals: NDArray[np.float64], base: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard errors of ratios, one a row, by leaving out each value in turn (the jackknife).

    They lack a factor that is the same for all rows and cancels in the studentised bootstrap.
    """
    rest = base.sum(axis=1, keepdims=True) - base
    errors: NDArray[np.float64] = np.sqrt(((residuals / rest) ** 2).sum(axis=1))
    return errors


def median_over(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return `median_interval` of one value a polygon; `UNKNOWN` for fewer than `FEWEST`."""
    return UNKNOWN if len(values) < FEWEST else median_interval(values.tolist())
