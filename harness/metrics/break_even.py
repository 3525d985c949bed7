"""Break-even: the number of draws after which a longer triangulation has paid off."""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from harness.metrics.statistics import FASTER, SLOWER, Ratio, compute_student_interval
from harness.results.record import Record, Time

BreakEvenKind = Literal["at once", "after", "up to", "not significant", "never"]

MIN_ROUNDS = 4  # minimum number of rounds of triangulation from which an interval is computed


@dataclass(frozen=True)
class BreakEven:
    """Number of draws from which triangulating and drawing together take less than the base's.

    kind : "at once": drawing is significantly faster, and triangulating takes no longer; "after":
        triangulating may take longer; "up to": drawing is slower and triangulating faster; "not
        significant": the draw times do not differ; "never": triangulating is not faster either
    draws, low, high : number of draws of "after" and "up to", with a 95 % interval, infinite if
        unbounded, None if triangulating was timed once
    """

    kind: BreakEvenKind
    draws: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def text(self) -> str:
        """Text for tables: after 12 draws (11 to 14); at once; not significant; never (slower)."""
        if self.kind == "never":
            return "never (slower)"
        if self.draws is None:
            return self.kind
        count = self._round(self.draws)
        draws = f"{count:,} draw{'' if count == 1 else 's'}"
        if self.low is None or self.high is None:
            return f"{self.kind} about {draws} (triangulated once)"
        if count <= 0 and self.kind == "after":
            return f"at once ({self._format_interval(' to ')} draws)"
        return f"{self.kind} {draws} ({self._format_interval(' to ')})"

    @property
    def short_text(self) -> str:
        """Text for a narrow column: 12 (11-14)."""
        if self.draws is None:
            return "n.s." if self.kind == "not significant" else self.kind
        prefix = "up to " if self.kind == "up to" else ""
        interval = "?" if self.low is None else self._format_interval("-")
        return f"{prefix}{self._round(self.draws):,} ({interval})"

    def _round(self, draws: float) -> int:
        """Round up to the first draw of lower total time; "up to": down to the last such draw."""
        return math.floor(draws) if self.kind == "up to" else math.ceil(draws)

    def _format_interval(self, separator: str) -> str:
        """Format the interval, rounded outwards, so that its ends differ."""
        low, high = self.low or 0.0, self.high or 0.0
        start = f"{max(0, math.ceil(low) - 1):,}"
        return f"{start} or more" if math.isinf(high) else f"{start}{separator}{math.ceil(high):,}"


class _Estimate(NamedTuple):
    value: float
    low: float
    high: float

    @property
    def negated(self) -> "_Estimate":
        return _Estimate(-self.value, -self.high, -self.low)


def compute_break_even(record: Record, base: Record, ratio: Ratio | None) -> BreakEven | None:
    """Return the draws after which the time saved in drawing exceeds the extra triangulation time.

    None for the base itself, and unless drawing and triangulating of both records were timed. The
    extra time has an interval only if both were triangulated in the same rounds.
    """
    if ratio is None or record is base or base.time is None:
        return None
    rounds, base_rounds = record.triangulate_samples_s, base.triangulate_samples_s
    has_interval = len(rounds) == len(base_rounds) >= MIN_ROUNDS
    if has_interval:
        extra = _Estimate(*compute_student_interval(np.subtract(rounds, base_rounds)))
    else:  # triangulated once
        if record.triangulate_s is None or base.triangulate_s is None:
            return None
        extra = _Estimate(*[record.triangulate_s - base.triangulate_s] * 3)
    saved = _estimate_saving(ratio, base.time)
    if ratio.verdict == FASTER:
        if extra.high <= 0:
            return BreakEven("at once")
        return _divide_estimates("after", extra, saved, has_interval)
    if ratio.verdict == SLOWER:
        if extra.high >= 0:
            return BreakEven("never")
        return _divide_estimates("up to", extra.negated, saved.negated, has_interval)
    return BreakEven("not significant")


def _estimate_saving(ratio: Ratio, base: Time) -> _Estimate:
    """Return the seconds that a draw saves; squares of both relative errors are added."""
    draw_s = base.median_s or 0.0
    ends = base.ci95_s or (draw_s, draw_s)
    share = 1 - ratio.value
    low, high = (
        math.hypot((share - end) / share, (draw_s - draw_end) / draw_s) if share else math.inf
        for end, draw_end in ((1 - ratio.high, ends[0]), (1 - ratio.low, ends[1]))
    )
    value = draw_s * share
    return _Estimate(value, value - abs(value) * low, value + abs(value) * high)


def _divide_estimates(
    kind: BreakEvenKind, top: _Estimate, bottom: _Estimate, has_interval: bool
) -> BreakEven:
    """Return the break-even at top / bottom draws, with the interval for independent estimates.

    top, bottom : seconds of extra triangulation, and seconds saved by a draw, which are above 0

    The ends of both intervals determine the ratio's interval, by the method MOVER-R (Newcombe,
    Statistical Methods in Medical Research 25, 2016, after Donner and Zou).
    """
    draws = max(0.0, top.value / bottom.value)
    if not has_interval:
        return BreakEven(kind, draws)
    low = _solve_interval_end(top.value, top.low, bottom.value, bottom.high, -1)
    high = _solve_interval_end(top.value, top.high, bottom.value, bottom.low, 1)
    return BreakEven(kind, draws, max(0.0, low), high)


def _solve_interval_end(
    top: float, top_end: float, bottom: float, bottom_end: float, sign: int
) -> float:
    """Return an end of the interval of top / bottom, the lower if `sign` is -1, else the upper."""
    # The end x solves (top - x bottom)^2 = (top - top_end)^2 + x^2 (bottom - bottom_end)^2: the
    # half-widths of both intervals add as squares. `sign` selects one of the two roots.
    if bottom_end <= 0:
        return math.inf
    below = bottom_end * (2 * bottom - bottom_end)
    inside = (top * bottom) ** 2 - top_end * (2 * top - top_end) * below
    if below <= 0:  # bottom_end is at least 2 * bottom: the roots do not enclose the ratio
        return top_end / bottom_end
    return (top * bottom + sign * math.sqrt(max(0.0, inside))) / below
