"""Judges times of BASE and HEAD that were taken in the same rounds.

Whatever the machine did in a round it did to both, so each round's ratio tells the code alone: no
peers and no reference draw are needed, and what all cases did together is a finding like any other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from harness.compare.gate_settings import Settings
from harness.compare.model import Drift, TimeChange
from harness.compare.outcomes import decide
from harness.compare.quantiles import Samples
from harness.figures.ratios import Ratio, paired_ratio

Parts = tuple[Sequence[int] | None, Sequence[int] | None]
"""Rounds of each epoch, and of each process."""

Q_VALUE = 1e-3
"""An alarm needs this much evidence: one in a thousand such findings may be chance."""


def judge_rounds(
    base: Samples, head: Samples, settings: Settings, parts: Parts = (None, None)
) -> TimeChange:
    """Judge one case by its rounds' ratios; element r of both is of round r.

    parts : rounds of each epoch and of each process, in order, where the run had any. The
    q-value is still to be corrected for the number of cases.
    """
    ratio = paired_ratio(head, base, *parts)
    threshold = settings.time_threshold_of(paired=True)
    outcome, reason = decide(
        math.log(ratio.value),
        math.log(ratio.value),
        math.log(ratio.low),
        math.log(ratio.high),
        threshold,
    )
    p_value = sign_test(np.log(head / base))
    return TimeChange(
        outcome=outcome,
        reason=reason,
        ratio=ratio.value,
        low=ratio.low,
        high=ratio.high,
        raw_ratio=ratio.value,
        against="rounds",
        threshold=threshold,
        p_value=p_value,
        q_value=p_value,
        base_median_s=float(np.median(base)),
        head_median_s=float(np.median(head)),
        base_rounds=len(base),
        head_rounds=len(head),
    )


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
    return Drift(
        where=where,
        cases=len(pairs),
        outcome=outcome,
        reason=reason,
        ratio=together.value,
        low=together.low,
        high=together.high,
        reference=1.0,
        gated=True,
    )


def sign_test(logs: Samples) -> float:
    """Return the two-sided p-value of as many rounds being slower if either were as likely."""
    slower, faster = int((logs > 0).sum()), int((logs < 0).sum())
    if slower + faster == 0:
        return 1.0
    return float(stats.binomtest(slower, slower + faster).pvalue)
