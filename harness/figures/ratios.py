"""Says whether one drawing is faster than another, from rounds that timed both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from harness.figures.intervals import median_interval, student_interval

Verdict = Literal["faster", "slower", "no difference shown"]
FASTER: Final = "faster"
SLOWER: Final = "slower"
UNDECIDED: Final = "no difference shown"


@dataclass(frozen=True)
class Ratio:
    """Time of one drawing over that of another, with its 95 % confidence interval."""

    value: float
    low: float
    high: float
    rounds: int

    @classmethod
    def of_counts(cls, count: int, base: int) -> Ratio:
        """Return the ratio of times that are counts, which no other run would find another."""
        value = count / base if base else 1.0
        return cls(value, value, value, 1)

    @property
    def exact(self) -> bool:
        """Whether it is of counts."""
        return self.low == self.high and self.rounds == 1

    @property
    def verdict(self) -> Verdict:
        """What the interval shows of the first drawing against the second."""
        return FASTER if self.high < 1 else SLOWER if self.low > 1 else UNDECIDED


RUN_SCATTER = 0.003
"""Standard deviation by which the log ratio of two drawings moves from one run to the next, with
the machine in one state, beyond what its rounds and epochs show: each process lays out its memory
anew, and neighbours on a host come and go. 20 equal runs told it (docs/findings.md, "How far to
trust this"); other runs, in four processes each, and runs on another CPU were tested with it."""

FEWEST_EPOCHS = 4
"""With fewer, how much epochs differ cannot be told."""


NORMAL = 1.959963985
"""The normal distribution's 97.5 % quantile."""

FOLDS = 6
"""Parts of rounds that were all timed in one epoch."""


def blocks(times: Mapping[str, Any], rounds: int) -> list[NDArray[np.intp]]:
    """Return the rounds of parts of a record's times that share as little as may be.

    Processes where there were several, else epochs, else `FOLDS` parts whose rounds alternate.
    """
    for name, fewest in (("processes", 2), ("epochs", FEWEST_EPOCHS)):
        parts = times.get(name) or []
        if len(parts) >= fewest and sum(parts) == rounds:
            return np.split(np.arange(rounds), np.cumsum(parts)[:-1])
    folds = min(FOLDS, rounds)
    return [np.arange(fold, rounds, folds) for fold in range(folds)]


def paired_ratio(
    samples: Sequence[float] | NDArray[np.float64],
    base: Sequence[float] | NDArray[np.float64],
    epochs: Sequence[int] | None = None,
    processes: Sequence[int] | None = None,
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

    Raises
    ------
    ValueError
        if the rounds do not match, or there are none
    """
    if len(samples) != len(base) or len(samples) == 0:
        raise ValueError(f"{len(samples)} and {len(base)} samples are not rounds of one group")
    ratios = np.asarray(samples, np.float64) / np.asarray(base, np.float64)
    count = len(ratios)
    ends = np.cumsum(epochs if epochs is not None and sum(epochs) == count else [count])
    medians = np.array([np.median(part) for part in np.split(np.log(ratios), ends[:-1])])
    if processes is not None and len(processes) > 1 and sum(processes) == count:
        # An epoch belongs to the process in which it ended.
        of = np.searchsorted(np.cumsum(processes), ends)
        medians = np.array([medians[of == process].mean() for process in np.unique(of)])
        return _of_logs(medians, count)
    if len(medians) >= FEWEST_EPOCHS:
        return _of_logs(medians, count)
    low, high = median_interval(ratios.tolist())
    return Ratio(float(np.median(ratios)), low, high, len(ratios))


def of_any_run(ratio: Ratio) -> Ratio:
    """Return a run's ratio with the interval in which another run, too, may find it.

    Two independent errors: what the run's own interval tells, and `RUN_SCATTER`.
    """
    middle, low, high = np.log([ratio.value, ratio.low, ratio.high])
    reach = NORMAL * RUN_SCATTER
    low, high = (middle - np.hypot(middle - low, reach), middle + np.hypot(high - middle, reach))
    return Ratio(ratio.value, float(np.exp(low)), float(np.exp(high)), ratio.rounds)


def _of_logs(logs: NDArray[np.float64], rounds: int) -> Ratio:
    value, low, high = np.exp(student_interval(logs)).tolist()
    return Ratio(value, low, high, rounds)
