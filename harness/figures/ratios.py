"""Says whether one drawing is faster than another, from rounds that timed both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from harness.figures.intervals import median_interval

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


def paired_ratio(
    samples: Sequence[float] | NDArray[np.float64], base: Sequence[float] | NDArray[np.float64]
) -> Ratio:
    """Return the ratio of `samples` to `base`; element r of both comes from round r.

    The median of the rounds' ratios, with its exact order-statistics interval: a machine that
    slows down slows both drawings of a round, so its drift cancels.

    Raises
    ------
    ValueError
        if the rounds do not match, or there are none
    """
    if len(samples) != len(base) or len(samples) == 0:
        raise ValueError(f"{len(samples)} and {len(base)} samples are not rounds of one group")
    ratios = (np.asarray(samples) / np.asarray(base)).tolist()
    low, high = median_interval(ratios)
    return Ratio(float(np.median(ratios)), low, high, len(ratios))
