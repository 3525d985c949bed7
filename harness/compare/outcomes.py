"""When a growth is shown, when none is, and when nothing can be said."""

from __future__ import annotations

import math

from harness.compare.model import Outcome


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
