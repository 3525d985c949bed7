"""Statistics of samples: rank correlation, and intervals that assume little about distributions.

`scripts/studies/interval_coverage.py` simulates the coverage of each interval. A ratio of two
drawings' times is computed from rounds in which both were timed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]  # values of p polygons, (p,)

CONFIDENCE = 0.95

MIN_VALUES = 6  # fewer polygons or groups cannot bound a median with 95 %

TAIL = 0.01
"""Share of a studentised bootstrap's resamples beyond either end of an interval. The usual 2.5 %
suit many values with little skew. The sums behind ratios and regrets have a few large values: there
2 % give intervals that cover the truth in 90 % of cases (96 values), and 1 % in at least 94 %."""

RESAMPLES = 1999

UNKNOWN = (float("nan"), float("nan"))  # ends that the values do not determine


def compute_median_interval(
    samples: list[float], confidence: float = CONFIDENCE
) -> tuple[float, float]:
    """Return the median's exact order-statistics interval, for any distribution of the samples.

    Fewer than six samples give their range, whose confidence is lower than 95 %. Source: David &
    Nagaraja, Order Statistics, section 7.1.
    """
    from scipy.special import bdtr  # slow to import

    ordered = sorted(samples)
    n = len(ordered)
    # The ends are the k-th smallest and k-th largest sample, for the maximum k with
    # P(Binomial(n, 1/2) < k) <= (1 - confidence) / 2.
    below = bdtr(np.arange(n), n, 0.5)
    k = int(np.searchsorted(below, (1 - confidence) / 2, side="right"))
    if k == 0:
        return ordered[0], ordered[-1]
    return ordered[k - 1], ordered[n - k]


def compute_student_interval(
    values: Sequence[float] | NDArray[np.float64], confidence: float = CONFIDENCE
) -> tuple[float, float, float]:
    """Return the mean of two or more independent values and the ends of Student's interval."""
    from scipy.special import stdtrit  # slow to import

    count = len(values)
    if count < 2:
        raise ValueError("an interval needs two values or more")
    reach = float(stdtrit(count - 1, 0.5 + confidence / 2)) * np.std(values, ddof=1) / count**0.5
    middle = float(np.mean(values))
    return middle, middle - float(reach), middle + float(reach)


def compute_mean_interval(values: NDArray[np.float64], seed: int = 0) -> tuple[float, float]:
    """Return the studentised bootstrap's 95 % confidence interval of the mean of (n,) values.

    The interval is asymmetric if the values are skewed, unlike Student's. It is `UNKNOWN` for fewer
    than `MIN_VALUES` values, for equal values, and if one value outweighs the others so much that
    either end is unbounded. Values so rare, one in n or fewer, that they may be absent from the n
    values are not allowed for. Source: B. Efron and R. Tibshirani, An Introduction to the
    Bootstrap, 12.5.
    """
    n = len(values)
    if n < MIN_VALUES or np.ptp(values) == 0:
        return UNKNOWN
    drawn = values[np.random.default_rng(seed).integers(n, size=(RESAMPLES, n))]
    mean, error = values.mean(), values.std(ddof=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (drawn.mean(axis=1) - mean) / drawn.std(axis=1, ddof=1)
    return _find_interval_ends(mean, error, t)


def compute_ratio_interval(
    values: NDArray[np.float64], base: NDArray[np.float64], seed: int = 0
) -> tuple[float, float]:
    """Return the studentised bootstrap's 95 % interval of sum(values) / sum(base), both (n,).

    Each value is resampled together with its base; a ratio's standard error is the jackknife's. The
    result is `UNKNOWN` in the cases of `compute_mean_interval`; if an element of `base` is
    negative, or all are 0; and if an end lies outside the range of value / base by more than its
    width, because resamples of few values are so similar that their standard errors are almost 0.
    Source: as above, 11 and 12.5.
    """
    n = len(values)
    if n < MIN_VALUES or (base < 0).any() or not base.any():
        return UNKNOWN
    ratio = values.sum() / base.sum()
    residuals = values - ratio * base
    if np.allclose(residuals, 0.0, atol=1e-9 * base.max()):
        return UNKNOWN
    indices = np.random.default_rng(seed).integers(n, size=(RESAMPLES, n))
    drawn, drawn_base = values[indices], base[indices]
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = drawn.sum(axis=1) / drawn_base.sum(axis=1)
        error = _estimate_errors(residuals[None], base[None])[0]
        t = (ratios - ratio) / _estimate_errors(drawn - ratios[:, None] * drawn_base, drawn_base)
        single = values / base
    low, high = _find_interval_ends(ratio, error, t)
    lowest, highest = np.nanmin(single), np.nanmax(single)
    reach = highest - lowest
    return UNKNOWN if low < lowest - reach or high > highest + reach else (low, high)


def _find_interval_ends(value: float, error: float, t: NDArray[np.float64]) -> tuple[float, float]:
    """Return the studentised bootstrap's interval; a t of NaN (0 / 0) counts as 0."""
    low, high = np.quantile(np.where(np.isnan(t), 0.0, t), [TAIL, 1 - TAIL], method="inverted_cdf")
    if not (np.isfinite(low) and np.isfinite(high)):
        return UNKNOWN
    return float(value - high * error), float(value - low * error)


def _estimate_errors(
    residuals: NDArray[np.float64], base: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the jackknife standard errors (k,) of k ratios sum(values) / sum(base), row by row.

    residuals, base : (k, n), values - ratio * base, and base. A factor common to all rows is
    omitted, as it cancels in the studentised bootstrap.
    """
    remainder = base.sum(axis=1, keepdims=True) - base
    errors: NDArray[np.float64] = np.sqrt(((residuals / remainder) ** 2).sum(axis=1))
    return errors


Verdict = Literal["faster", "slower", "not significant"]
FASTER: Final = "faster"
SLOWER: Final = "slower"
UNDECIDED: Final = "not significant"


@dataclass(frozen=True)
class Ratio:
    """Ratio of the times of two drawings, with a 95 % confidence interval."""

    value: float
    low: float
    high: float
    rounds: int  # number of rounds from which the ratio was computed
    quiet: bool = True  # if False, the verdict is always "not significant"
    joint: "Ratio | None" = None  # allows for the choice of the lowest of several ratios

    @property
    def verdict(self) -> Verdict:
        """Whether the first drawing is faster or slower than the second, by the interval."""
        if not self.quiet:
            return UNDECIDED
        return FASTER if self.high < 1 else SLOWER if self.low > 1 else UNDECIDED


RUN_SCATTER = 0.003
"""Standard deviation between runs of the log ratio of two drawings, on an undisturbed machine, in
excess of the scatter of rounds and epochs within a run: processes differ in memory layout, and the
load of a shared host changes. Measured by 20 equal runs; tested on runs of four processes each, on
another CPU, and on the runs of docs/findings-tables.md, "What do other programs do to an answer?".
"""

MIN_EPOCHS = 4  # to estimate the scatter between epochs
SINGLE_EPOCH_PARTS = 6  # into which the rounds of a single epoch are divided


def split_rounds(
    processes: Sequence[int], epochs: Sequence[int], rounds: int
) -> list[NDArray[np.intp]]:
    """Return the indices of the rounds of each part; parts are as independent as possible.

    Parts are processes if there are several; otherwise epochs if there are `MIN_EPOCHS`; otherwise
    every sixth round. processes, epochs : number of rounds of each
    """
    for parts, minimum in ((processes, 2), (epochs, MIN_EPOCHS)):
        if len(parts) >= minimum and sum(parts) == rounds:
            return np.split(np.arange(rounds), np.cumsum(parts)[:-1])
    folds = min(SINGLE_EPOCH_PARTS, rounds)
    return [np.arange(fold, rounds, folds) for fold in range(folds)]


def compute_paired_ratio(
    samples: Sequence[float] | NDArray[np.float64],
    base: Sequence[float] | NDArray[np.float64],
    epochs: Sequence[int] | None = None,
    processes: Sequence[int] | None = None,
    mask: NDArray[np.bool_] | None = None,
    candidates: int = 1,
) -> Ratio:
    """Return the ratio of the times of two drawings, with a confidence interval.

    A machine that slows down slows both drawings of a round, so drift cancels. Buffers are created
    again before each epoch, so an interval from the scatter between epochs includes the effect of
    the buffers' positions in memory. The ratio is

    - with several processes, the exponential of the mean over processes of each process's mean over
      epochs of the median log ratio, with Student's interval over processes;
    - otherwise, with `MIN_EPOCHS` epochs, the exponential of the mean over epochs of the median log
      ratio, with Student's interval over epochs;
    - otherwise, the median over rounds, with the exact order-statistics interval, which does not
      include the effect of the buffers' positions.

    Parameters
    ----------
    samples, base : sequence of float
        Seconds per draw, (r,); element r of both is from round r.
    epochs, processes : sequence of int, optional
        Number of rounds of each epoch and of each process, in order.
    mask : (r,) array of bool, optional
        Rounds to use; by default all.
    candidates : int, optional
        Number of ratios of which the caller reports, say, the lowest. If there are several, the
        interval is widened so that with 95 % confidence the intervals of all of them hold (Sidak's
        inequality, which is exact for independent ratios).

    Returns
    -------
    Ratio
        The ratio of `samples` to `base`.

    Raises
    ------
    ValueError
        If the numbers of rounds differ, or are 0.

    Examples
    --------
    >>> compute_paired_ratio([2.0, 2.1, 1.9, 2.0, 2.0, 2.0], [4.0, 4.2, 3.8, 4.0, 4.0, 4.0]).value
    0.5
    """
    if len(samples) != len(base) or len(samples) == 0:
        raise ValueError(f"{len(samples)} and {len(base)} samples are not rounds of one group")
    ratios = np.asarray(samples, np.float64) / np.asarray(base, np.float64)
    mask = np.ones(len(ratios), np.bool_) if mask is None else mask
    ratios = ratios[mask]
    count = len(ratios)
    confidence = CONFIDENCE ** (1 / max(1, candidates))
    ends = np.cumsum(_count_rounds(mask, epochs) or [count])
    medians = np.array([np.median(part) for part in np.split(np.log(ratios), ends[:-1])])
    process_rounds = _count_rounds(mask, processes)
    if len(process_rounds) > 1:
        # An epoch belongs to the process of its last round.
        owners = np.searchsorted(np.cumsum(process_rounds), ends)
        medians = np.array([medians[owners == owner].mean() for owner in np.unique(owners)])
    if len(process_rounds) > 1 or len(medians) >= MIN_EPOCHS:
        value, low, high = np.exp(compute_student_interval(medians, confidence)).tolist()
        return Ratio(value, low, high, count)
    low, high = compute_median_interval(ratios.tolist(), confidence)
    return Ratio(float(np.median(ratios)), low, high, count)


def _count_rounds(mask: NDArray[np.bool_], parts: Sequence[int] | None) -> list[int]:
    """Return the number of rounds in `mask` of each part with such rounds, or [] without parts."""
    if parts is None or sum(parts) != len(mask):
        return []
    counts = [int(part.sum()) for part in np.split(mask, np.cumsum(parts)[:-1])]
    return [count for count in counts if count]


def add_run_scatter(ratio: Ratio, candidates: int = 1) -> Ratio:
    """Return a run's ratio with its interval widened by the scatter between runs.

    The squares of two half-widths of the log ratio add up: the old one, and that of `RUN_SCATTER`
    alone. candidates : as for `compute_paired_ratio`
    """
    middle, low, high = np.log([ratio.value, ratio.low, ratio.high])
    quantile = NormalDist().inv_cdf(0.5 + CONFIDENCE ** (1 / max(1, candidates)) / 2)
    reach = quantile * RUN_SCATTER
    low, high = (middle - np.hypot(middle - low, reach), middle + np.hypot(high - middle, reach))
    return replace(ratio, low=float(np.exp(low)), high=float(np.exp(high)))


TIE_TOLERANCE = 1e-9  # relative; the sums of two equal triangulations differ by about 1e-15


def compute_ranks(values: Column) -> Column:
    """Return the rank of each value, counted from 1; values within `TIE_TOLERANCE` share the mean.

    Rounding would give two equal sums on either side of a rounding boundary different ranks.
    """
    order = np.argsort(values, kind="stable")
    ascending = values[order]
    tolerance = TIE_TOLERANCE * np.maximum(np.abs(ascending[1:]), np.abs(ascending[:-1]))
    is_new = np.diff(ascending) > tolerance
    group = np.concatenate(([0], np.cumsum(is_new)))[: len(values)]
    sizes = np.bincount(group)
    result = np.empty(len(values))
    result[order] = (np.cumsum(sizes) - (sizes - 1) / 2)[group]
    return result


def compute_spearman(x: Column, y: Column) -> float:
    """Return Spearman's coefficient; NaN if either column is constant or shorter than 3."""
    # Computed here, because importing `scipy.stats` takes longer than a short run.
    if len(x) < 3:
        return float("nan")
    x_ranks, y_ranks = compute_ranks(x), compute_ranks(y)
    if np.ptp(x_ranks) == 0 or np.ptp(y_ranks) == 0:
        return float("nan")
    return float(np.corrcoef(x_ranks, y_ranks)[0, 1])


def compute_rank_correlation(x: Column, y: Column) -> float | None:
    """Return Spearman's coefficient of the finite pairs, or None if it is undefined."""
    finite = np.isfinite(x) & np.isfinite(y)
    coefficient = compute_spearman(x[finite], y[finite])
    return None if np.isnan(coefficient) else coefficient


def compute_rms_error(x: Column, y: Column) -> float | None:
    """Return the root mean square of log(x / y), about x's relative error, or None."""
    valid = np.isfinite(x) & np.isfinite(y) & (x > 0) & (y > 0)
    if not valid.any():
        return None
    return float(np.sqrt(np.mean(np.log(x[valid] / y[valid]) ** 2)))
