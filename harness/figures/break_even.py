"""After how many draws a triangulation has paid for what triangulating it took longer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from harness.figures.groups import time_ratio
from harness.figures.intervals import student_interval
from harness.figures.ratios import FASTER, SLOWER, Ratio
from harness.stored.folder import Record

Kind = Literal["at once", "after", "up to", "not shown", "never"]
AT_ONCE: Final = "at once"
AFTER: Final = "after"
UP_TO: Final = "up to"
NOT_SHOWN: Final = "not shown"
NEVER: Final = "never"

FEWEST_ROUNDS = 4
"""With fewer, how much the time of triangulating scatters cannot be told."""


@dataclass(frozen=True)
class BreakEven:
    """From which draw on triangulating and drawing take less than the base's, together.

    kind : AT_ONCE: drawing is shown to be faster, triangulating to take no longer; AFTER: drawing
        is shown to be faster; UP_TO: drawing is shown to be slower and triangulating quicker, so it
        pays for fewer draws; NOT_SHOWN: no difference of drawing is shown; NEVER: drawing is shown
        to be slower, and triangulating is not shown to be quicker
    draws, low, high : of AFTER and UP_TO: draws, with a 95 % interval; infinite where it has no
        end, None where triangulating was timed once, so that nobody knows
    """

    kind: Kind
    draws: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def written(self) -> str:
        """E.g. after 12 draws (11 to 14); at once; not shown; never (shown to be slower)."""
        if self.kind == NEVER:
            return "never (shown to be slower)"
        if self.draws is None:
            return self.kind
        count = self._whole(self.draws)
        draws = f"{count:,} draw{'' if count == 1 else 's'}"
        if self.low is None or self.high is None:
            return f"{self.kind} about {draws} (triangulated once)"
        if count <= 0 and self.kind == AFTER:
            return f"{AT_ONCE} ({self._ends(' to ')} draws)"
        return f"{self.kind} {draws} ({self._ends(' to ')})"

    @property
    def short(self) -> str:
        """The same for a narrow column: 12 (11-14)."""
        if self.draws is None:
            return self.kind
        begin = "up to " if self.kind == UP_TO else ""
        ends = "?" if self.low is None else self._ends("-")
        return f"{begin}{self._whole(self.draws):,} ({ends})"

    def _whole(self, draws: float) -> int:
        """The first draw that pays, or the last."""
        return math.floor(draws) if self.kind == UP_TO else math.ceil(draws)

    def _ends(self, between: str) -> str:
        """The interval, outwards to whole draws: a narrow one still shows that it is one."""
        low, high = self.low or 0.0, self.high or 0.0
        least = f"{max(0, math.ceil(low) - 1):,}"
        return f"{least} or more" if math.isinf(high) else f"{least}{between}{math.ceil(high):,}"


@dataclass(frozen=True)
class _Estimate:
    value: float
    low: float
    high: float


def break_even(record: Record, base: Record | None) -> BreakEven | None:
    """Return it for two records timed in the same rounds; None where it is not defined.

    It is not for the base itself, nor where drawing or triangulating of either was not timed, or
    drawing in cycles. A
    draw saves (1 - ratio) times the base's draw. Both triangulate in the same rounds, too: what one
    takes longer is the mean of the rounds' differences, with Student's interval.
    """
    ratio = time_ratio(record, base)
    if ratio is None or ratio.exact or base is None or record is base:
        return None
    longer = _longer(record, base)
    if longer is None:
        return None
    if ratio.verdict == FASTER:
        if longer.high <= 0:
            return BreakEven(AT_ONCE)
        return _over(AFTER, longer, _saved(ratio, base), _known(record, base))
    if ratio.verdict == SLOWER:
        if longer.high >= 0:
            return BreakEven(NEVER)
        quicker = _Estimate(-longer.value, -longer.high, -longer.low)
        saved = _saved(ratio, base)
        lost = _Estimate(-saved.value, -saved.high, -saved.low)
        return _over(UP_TO, quicker, lost, _known(record, base))
    return BreakEven(NOT_SHOWN)


def _rounds(record: Record) -> Sequence[float]:
    return record.get("triangulate_samples_s") or ()


def _known(record: Record, base: Record) -> bool:
    return len(_rounds(record)) == len(_rounds(base)) >= FEWEST_ROUNDS


def _longer(record: Record, base: Record) -> _Estimate | None:
    """Return by how many seconds triangulating takes longer; one value where it was timed once."""
    if not _known(record, base):
        seconds, usual = record.get("triangulate_s"), base.get("triangulate_s")
        if seconds is None or usual is None:
            return None
        return _Estimate(*[seconds - usual] * 3)
    return _Estimate(*student_interval(np.subtract(_rounds(record), _rounds(base))))


def _saved(ratio: Ratio, base: Record) -> _Estimate:
    """Return the seconds that a draw saves: relative errors of both factors add as squares."""
    times = base["time"]
    draw_s = times["median_s"]
    ends = times.get("ci95_s") or (draw_s, draw_s)
    share = 1 - ratio.value
    low, high = (
        math.hypot((share - end) / share, (draw_s - other) / draw_s) if share else math.inf
        for end, other in ((1 - ratio.high, ends[0]), (1 - ratio.low, ends[1]))
    )
    value = draw_s * share
    first, second = value - abs(value) * low, value + abs(value) * high
    return _Estimate(value, first, second)


def _over(kind: Kind, top: _Estimate, bottom: _Estimate, known: bool) -> BreakEven:
    """Return `top` over `bottom`, which is above 0, with the interval for independent estimates.

    The ends of both intervals give those of the ratio: MOVER-R (Newcombe, Statistical Methods in
    Medical Research 25, 2016, after Donner and Zou). There are no fewer than 0 draws.
    """
    draws = max(0.0, top.value / bottom.value)
    if not known:
        return BreakEven(kind, draws)
    low = _end(top.value, top.low, bottom.value, bottom.high, -1)
    high = _end(top.value, top.high, bottom.value, bottom.low, 1)
    return BreakEven(kind, draws, max(0.0, low), high)


def _end(top: float, top_end: float, bottom: float, bottom_end: float, sign: int) -> float:
    if bottom_end <= 0:
        return math.inf
    below = bottom_end * (2 * bottom - bottom_end)
    inside = (top * bottom) ** 2 - top_end * (2 * top - top_end) * below
    if below <= 0:  # the saving is known to less than a factor of two
        return top_end / bottom_end
    return (top * bottom + sign * math.sqrt(max(0.0, inside))) / below
