"""Break-even: after how many draws a longer triangulation has paid off."""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from harness.results.record import Record, Time
from harness.stats.intervals import FASTER, SLOWER, Ratio, student_interval

Kind = Literal["at once", "after", "up to", "not shown", "never"]

MIN_ROUNDS = 4
"""With fewer rounds the scatter of the time to triangulate is unknown."""


@dataclass(frozen=True)
class BreakEven:
    """Number of draws from which triangulating and drawing together take less than the base's.

    kind : "at once": drawing is shown to be faster, triangulating to take no longer; "after":
        drawing is shown to be faster; "up to": drawing is shown to be slower and triangulating
        quicker, so that fewer draws take less; "not shown": no difference of drawing is shown;
        "never": drawing is shown to be slower, and triangulating is not shown to be quicker
    draws, low, high : of "after" and "up to": draws, with a 95 % interval; infinite if it has no
        end, None if triangulating was timed once, so that the interval is unknown
    """

    kind: Kind
    draws: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def written(self) -> str:
        """E.g. after 12 draws (11 to 14); at once; not shown; never (shown to be slower)."""
        if self.kind == "never":
            return "never (shown to be slower)"
        if self.draws is None:
            return self.kind
        count = self._whole(self.draws)
        draws = f"{count:,} draw{'' if count == 1 else 's'}"
        if self.low is None or self.high is None:
            return f"{self.kind} about {draws} (triangulated once)"
        if count <= 0 and self.kind == "after":
            return f"at once ({self._ends(' to ')} draws)"
        return f"{self.kind} {draws} ({self._ends(' to ')})"

    @property
    def short(self) -> str:
        """The same for a narrow column: 12 (11-14)."""
        if self.draws is None:
            return self.kind
        begin = "up to " if self.kind == "up to" else ""
        ends = "?" if self.low is None else self._ends("-")
        return f"{begin}{self._whole(self.draws):,} ({ends})"

    def _whole(self, draws: float) -> int:
        """The first draw that pays, or the last."""
        return math.floor(draws) if self.kind == "up to" else math.ceil(draws)

    def _ends(self, between: str) -> str:
        """The interval, outwards to whole draws: a narrow one still shows that it is one."""
        low, high = self.low or 0.0, self.high or 0.0
        least = f"{max(0, math.ceil(low) - 1):,}"
        return f"{least} or more" if math.isinf(high) else f"{least}{between}{math.ceil(high):,}"


class _Estimate(NamedTuple):
    """A value with the ends of its interval."""

    value: float
    low: float
    high: float

    @property
    def negated(self) -> "_Estimate":
        return _Estimate(-self.value, -self.high, -self.low)


def break_even(record: Record, base: Record, ratio: Ratio | None) -> BreakEven | None:
    """Return the break-even of a record against the base, or None if it is undefined.

    It is undefined for the base itself, and unless drawing and triangulating of both were timed. A
    draw saves (1 - ratio) times the base's draw. Both triangulate in the same rounds, too: the
    extra time is the mean of the rounds' differences, with Student's interval.

    ratio : `time_ratio` of both
    """
    if ratio is None or record is base or base.time is None:
        return None
    rounds, base_rounds = record.triangulate_samples_s, base.triangulate_samples_s
    known = len(rounds) == len(base_rounds) >= MIN_ROUNDS
    if known:
        extra = _Estimate(*student_interval(np.subtract(rounds, base_rounds)))
    else:  # it was timed once
        if record.triangulate_s is None or base.triangulate_s is None:
            return None
        extra = _Estimate(*[record.triangulate_s - base.triangulate_s] * 3)
    saved = _saved(ratio, base.time)
    if ratio.verdict == FASTER:
        return BreakEven("at once") if extra.high <= 0 else _over("after", extra, saved, known)
    if ratio.verdict == SLOWER:
        if extra.high >= 0:
            return BreakEven("never")
        return _over("up to", extra.negated, saved.negated, known)
    return BreakEven("not shown")


def _saved(ratio: Ratio, base: Time) -> _Estimate:
    """Return the seconds that a draw saves: relative errors of both factors add as squares."""
    draw_s = base.median_s or 0.0
    ends = base.ci95_s or (draw_s, draw_s)
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
    # The end solves (top - x bottom)^2 = (top - top_end)^2 + x^2 (bottom - bottom_end)^2: both
    # intervals' reaches add as squares. Of its two roots `sign` names the one meant.
    if bottom_end <= 0:
        return math.inf
    below = bottom_end * (2 * bottom - bottom_end)
    inside = (top * bottom) ** 2 - top_end * (2 * top - top_end) * below
    if below <= 0:  # bottom_end is twice bottom or more: the roots do not lie around the ratio
        return top_end / bottom_end
    return (top * bottom + sign * math.sqrt(max(0.0, inside))) / below
