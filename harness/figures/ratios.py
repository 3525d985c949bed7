"""Says whether one drawing is faster than another, from rounds that timed both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from harness.figures.intervals import CONFIDENCE, median_interval

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

    @property
    def verdict(self) -> Verdict:
        """What the interval shows of the first drawing against the second."""
        if self.high < 1:
            return FASTER
        if self.low > 1:
            return SLOWER
        return UNDECIDED


FEWEST_EPOCHS = 4
"""With fewer, how much epochs differ cannot be told."""


def paired_ratio(
    samples: Sequence[float] | NDArray[np.float64],
    base: Sequence[float] | NDArray[np.float64],
    epochs: Sequence[int] | None = None,
) -> Ratio:
    """Return the ratio of `samples` to `base`; element r of both comes from round r.

    A machine that slows down slows both drawings of a round, so its drift cancels. Where buffers
    were created anew between epochs, each epoch gives the median of its rounds' log ratios. The
    ratio is the mean of these, with Student's interval for the mean of that many independent
    values: it holds what a drawing gains or loses by where its buffers lie, as well as the noise
    of rounds. With fewer than `FEWEST_EPOCHS` it is the median of all rounds, with its exact
    order-statistics interval, in which the place of the buffers is a constant that is not seen.

    epochs : rounds of each epoch, in order

    Raises
    ------
    ValueError
        if the rounds do not match, or there are none
    """
    if len(samples) != len(base) or len(samples) == 0:
        raise ValueError(f"{len(samples)} and {len(base)} samples are not rounds of one group")
    ratios = np.asarray(samples, np.float64) / np.asarray(base, np.float64)
    if epochs is not None and len(epochs) >= FEWEST_EPOCHS and sum(epochs) == len(ratios):
        return _over_epochs(np.log(ratios), np.cumsum(epochs)[:-1])
    low, high = median_interval(ratios.tolist())
    return Ratio(float(np.median(ratios)), low, high, len(ratios))


def _over_epochs(logs: NDArray[np.float64], bounds: NDArray[np.int64]) -> Ratio:
    from scipy.special import stdtrit

    medians = np.array([np.median(part) for part in np.split(logs, bounds)])
    count = len(medians)
    reach = float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2)) * medians.std(ddof=1) / np.sqrt(count)
    middle = medians.mean()
    value, low, high = np.exp([middle, middle - reach, middle + reach]).tolist()
    return Ratio(value, low, high, len(logs))
