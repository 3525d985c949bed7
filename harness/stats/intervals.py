"""Confidence intervals that assume little of the distribution.

`scripts/studies/interval_coverage.py` shows by simulation how often each holds the truth.

Ratios of two drawings' times rest on rounds that timed both.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Final, Literal

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
    `UNKNOWN` as for `mean_interval`, where a base is below 0 or all are 0, and where an end lies
    further from all values' own ratios than these from each other: resamples of a few values can be
    so alike that their errors are almost 0. Source: B. Efron and R. Tibshirani, An Introduction to
    the Bootstrap, 11 and 12.5.
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
        each = values / base
    low, high = _ends(ratio, error, t)
    least, most = np.nanmin(each), np.nanmax(each)
    reach = most - least
    return UNKNOWN if low < least - reach or high > most + reach else (low, high)


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


Verdict = Literal["faster", "slower", "not significant"]
FASTER: Final = "faster"
SLOWER: Final = "slower"
UNDECIDED: Final = "not significant"


@dataclass(frozen=True)
class Ratio:
    """Time of one drawing over that of another, with its 95 % confidence interval.

    rounds : number of rounds that it rests on
    quiet : False if the run was disturbed, so that the ratio shows nothing
    joint : the ratio with an interval that holds for the best of several, None if not computed
    """

    value: float
    low: float
    high: float
    rounds: int
    quiet: bool = True
    joint: "Ratio | None" = None

    @property
    def verdict(self) -> Verdict:
        """What the interval shows of the first drawing against the second."""
        if not self.quiet:
            return UNDECIDED
        return FASTER if self.high < 1 else SLOWER if self.low > 1 else UNDECIDED


RUN_SCATTER = 0.003
"""Standard deviation by which the log ratio of two drawings moves from one run to the next, with
the machine in one state, beyond what its rounds and epochs show: each process lays out its memory
anew, and neighbours on a host come and go. 20 equal runs told it; other runs, in four processes
each, and runs on another CPU were tested with it, and later those of docs/findings-tables.md, "What
do other programs do to an answer?"."""

FEWEST_EPOCHS = 4
"""With fewer, how much epochs differ cannot be told."""


FOLDS = 6
"""Parts of rounds that were all timed in one epoch."""


def blocks(processes: Sequence[int], epochs: Sequence[int], rounds: int) -> list[NDArray[np.intp]]:
    """Return the rounds of parts of a measurement that share as little as possible.

    Processes if there were several, else epochs, else `FOLDS` parts whose rounds alternate.

    processes, epochs : rounds of each
    """
    for parts, fewest in ((processes, 2), (epochs, FEWEST_EPOCHS)):
        if len(parts) >= fewest and sum(parts) == rounds:
            return np.split(np.arange(rounds), np.cumsum(parts)[:-1])
    folds = min(FOLDS, rounds)
    return [np.arange(fold, rounds, folds) for fold in range(folds)]


def paired_ratio(
    samples: Sequence[float] | NDArray[np.float64],
    base: Sequence[float] | NDArray[np.float64],
    epochs: Sequence[int] | None = None,
    processes: Sequence[int] | None = None,
    kept: NDArray[np.bool_] | None = None,
    among: int = 1,
) -> Ratio:
    """Return the ratio of `samples` to `base`; element r of both comes from round r.

    A machine that slows down slows both drawings of a round, so its drift cancels. Where buffers
    were created anew between epochs, each epoch gives the median of its rounds' log ratios. The
    ratio is the mean of these, with Student's interval for the mean of that many independent
    values: it holds what a drawing gains or loses by where its buffers lie, as well as the noise
    of rounds. Where several processes did the same, what they differ by counts, too: each gives the
    mean of its epochs, and Student's interval is that of as many values as there were processes.
    With one process and fewer than `FEWEST_EPOCHS` it is the median of all rounds, with its exact
    order-statistics interval, in which the place of the buffers is a constant that is not seen.

    epochs, processes : rounds of each epoch and of each process, in order
    kept : (r,) the rounds that count, all if None
    among : ratios of which this is chosen by its value: the interval is one of as many that hold
        all at once, by Sidak's inequality, which is exact for independent ones and wide for others

    Raises
    ------
    ValueError
        if the rounds do not match, or there are none
    """
    if len(samples) != len(base) or len(samples) == 0:
        raise ValueError(f"{len(samples)} and {len(base)} samples are not rounds of one group")
    ratios = np.asarray(samples, np.float64) / np.asarray(base, np.float64)
    kept = np.ones(len(ratios), np.bool_) if kept is None else kept
    ratios = ratios[kept]
    count = len(ratios)
    confidence = CONFIDENCE ** (1 / max(1, among))
    ends = np.cumsum(_parts_of(kept, epochs) or [count])
    medians = np.array([np.median(part) for part in np.split(np.log(ratios), ends[:-1])])
    of_processes = _parts_of(kept, processes)
    if len(of_processes) > 1:
        # An epoch belongs to the process in which it ended.
        of = np.searchsorted(np.cumsum(of_processes), ends)
        medians = np.array([medians[of == process].mean() for process in np.unique(of)])
    if len(of_processes) > 1 or len(medians) >= FEWEST_EPOCHS:
        return _of_logs(medians, count, confidence)
    low, high = median_interval(ratios.tolist(), confidence)
    return Ratio(float(np.median(ratios)), low, high, len(ratios))


def _parts_of(kept: NDArray[np.bool_], parts: Sequence[int] | None) -> list[int]:
    """Return how many rounds each part keeps, without those that keep none; [] of no parts."""
    if parts is None or sum(parts) != len(kept):
        return []
    left = [int(part.sum()) for part in np.split(kept, np.cumsum(parts)[:-1])]
    return [rounds for rounds in left if rounds]


def of_any_run(ratio: Ratio, among: int = 1) -> Ratio:
    """Return a run's ratio with the interval in which another run, too, may find it.

    Two independent errors: what the run's own interval tells, and `RUN_SCATTER`.

    among : as of `paired_ratio`
    """
    middle, low, high = np.log([ratio.value, ratio.low, ratio.high])
    quantile = NormalDist().inv_cdf(0.5 + CONFIDENCE ** (1 / max(1, among)) / 2)
    reach = quantile * RUN_SCATTER
    low, high = (middle - np.hypot(middle - low, reach), middle + np.hypot(high - middle, reach))
    return replace(ratio, low=float(np.exp(low)), high=float(np.exp(high)))


def _of_logs(logs: NDArray[np.float64], rounds: int, confidence: float) -> Ratio:
    value, low, high = np.exp(student_interval(logs, confidence)).tolist()
    return Ratio(value, low, high, rounds)
