"""After how many draws a triangulation has paid for what triangulating it took longer."""

from __future__ import annotations

import math
from dataclasses import dataclass

from harness.figures.groups import time_ratio
from harness.figures.ratios import FASTER, SLOWER
from harness.stored.folder import Record


@dataclass(frozen=True)
class BreakEven:
    """Draws from which on triangulating and drawing take less than the base's, together.

    draws, low, high : by the ratio of the draws' times and by the ends of its 95 % interval; 0
        where triangulating takes no longer, infinite where no draw is saved
    """

    draws: float
    low: float
    high: float

    @property
    def written(self) -> str:
        """E.g. 12 draws (11 to 14); never."""
        if math.isinf(self.draws):
            return "never"
        if self.high == 0:
            return "at once"
        most = "never" if math.isinf(self.high) else f"{math.ceil(self.high):,}"
        return f"{math.ceil(self.draws):,} draws ({math.ceil(self.low):,} to {most})"


def break_even(record: Record, base: Record | None) -> BreakEven | None:
    """Return it for two records timed in the same rounds; None where it is not defined.

    It is not for the base itself, where either was not timed, nor where the record's triangulating
    is the shorter one and its draws are slower. What is saved a draw is (1 - ratio) times the
    base's draw; what the longer triangulating takes was measured once, so the interval is that of
    the ratio alone.
    """
    ratio = time_ratio(record, base)
    if ratio is None or base is None or record is base:
        return None
    seconds, usual = record.get("triangulate_s"), base.get("triangulate_s")
    if seconds is None or usual is None:
        return None
    extra = seconds - usual
    if extra <= 0:
        return None if ratio.verdict == SLOWER else BreakEven(0.0, 0.0, 0.0)
    draw_s = base["time"]["median_s"]
    draws, low, high = (
        _after(extra, draw_s, each) for each in (ratio.value, ratio.low, ratio.high)
    )
    # What is not shown to be faster is not shown to pay.
    return BreakEven(draws if ratio.verdict == FASTER else math.inf, low, high)


def _after(extra_s: float, draw_s: float, ratio: float) -> float:
    return extra_s / (draw_s * (1 - ratio)) if ratio < 1 else math.inf
