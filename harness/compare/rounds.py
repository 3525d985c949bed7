"""Judges times of BASE and HEAD that were taken in the same rounds.

Whatever the machine did in a round it did to both, so each round's ratio tells the code alone: no
peers and no reference draw are needed, and what all cases did together is a finding like any other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats

from harness.compare.gate_settings import Settings
from harness.compare.model import Drift, Outcome, TimeChange
from harness.compare.quantiles import Samples
from harness.figures.ratios import Ratio, paired_ratio

Parts = tuple[Sequence[int] | None, Sequence[int] | None]
"""Rounds of each epoch, and of each process."""

Q_VALUE = 1e-3
"""An alarm needs this much evidence: one in a thousand such findings may be chance."""


def decide(
    least: float, most: float, low: float, high: float, threshold: float
) -> tuple[Outcome, str]:
    """Return the outcome for a log ratio in `least`..`most` with interval `low`..`high`.

    A growth is shown only if it exceeds the threshold and its interval excludes 1; no growth is
    shown only if the interval is inside the threshold. All else is inconclusive, with the reason.
    """
    bound = math.log1p(threshold)
    if least > bound and low > 0:
        return "regressed", ""
    if most < -bound and high < 0:
        return "improved", ""
    if -bound <= low and high <= bound:
        return "unchanged", ""
    found = f"{math.expm1(low) * 100:+.1f} % to {math.expm1(high) * 100:+.1f} %"
    return "inconclusive", f"somewhere in {found}, the threshold is ±{threshold * 100:g} %"


def judge_rounds(
    base: Samples, head: Samples, settings: Settings, parts: Parts = (None, None)
) -> TimeChange:
    """Judge one case by its rounds' ratios; element r of both is of round r.

    parts : rounds of each epoch and of each process, in order, where the run had any. The
    q-value is still to be corrected for the number of cases.
    """
    ratio = paired_ratio(head, base, *parts)
    threshold = settings.time_threshold_of(paired=True)
    value, low, high = (math.log(x) for x in (ratio.value, ratio.low, ratio.high))
    outcome, reason = decide(value, value, low, high, threshold)
    p_value = sign_test(np.log(head / base))
    return TimeChange(
        *(outcome, reason, ratio.value, ratio.low, ratio.high, ratio.value, "rounds", threshold),
        p_value=p_value,
        q_value=p_value,
        **in_short(base, head),
    )


def in_short(base: Samples, head: Samples) -> dict[str, Any]:
    """Return medians and numbers of rounds, as `TimeChange` has them; None for those of none."""
    both = {"base": base, "head": head}
    medians = {f"{k}_median_s": float(np.median(v)) if len(v) else None for k, v in both.items()}
    return medians | {f"{name}_rounds": len(samples) for name, samples in both.items()}


def drift_of_rounds(
    where: str,
    pairs: Sequence[tuple[Samples, Samples]],
    settings: Settings,
    parts: Parts = (None, None),
) -> Drift:
    """Judge what all cases of a group did together: the median case of each round."""
    logs = np.median([np.log(head / base) for base, head in pairs], axis=0)
    together: Ratio = paired_ratio(np.exp(logs), np.ones(len(logs)), *parts)
    value, low, high = (math.log(x) for x in (together.value, together.low, together.high))
    outcome, reason = decide(value, value, low, high, settings.time_threshold_of(paired=True))
    if outcome in ("regressed", "improved") and sign_test(logs) > Q_VALUE:
        outcome, reason = "inconclusive", "too few rounds"
    ends = (together.value, together.low, together.high)
    return Drift(where, len(pairs), outcome, reason, *ends, reference=1.0, gated=True)


def sign_test(logs: Samples) -> float:
    """Return the two-sided p-value of as many rounds being slower if either were as likely."""
    slower, faster = int((logs > 0).sum()), int((logs < 0).sum())
    if slower + faster == 0:
        return 1.0
    return float(stats.binomtest(slower, slower + faster).pvalue)
