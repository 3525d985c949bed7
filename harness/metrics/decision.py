"""What the records of a group say together: an order, what to take, when it pays, one sentence.

The first sentence of a report, its ranking, the terminal's table and the pictures are all made of
`decide`, so that they cannot contradict each other.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from harness.metrics.groups import base_of, condition, time_ratio
from harness.metrics.registry import find, measures, value_of
from harness.results.run_folder import Record
from harness.stats.intervals import FASTER, SLOWER, Ratio, Verdict, student_interval
from harness.stats.run_quality import QUIET, State

Kind = Literal["at once", "after", "up to", "not shown", "never"]

FEWEST_ROUNDS = 4
"""With fewer, how much the time of triangulating scatters cannot be told."""


@dataclass(frozen=True)
class BreakEven:
    """From which draw on triangulating and drawing take less than the base's, together.

    kind : "at once": drawing is shown to be faster, triangulating to take no longer; "after":
        drawing is shown to be faster; "up to": drawing is shown to be slower and triangulating
        quicker, so it pays for fewer draws; "not shown": no difference of drawing is shown;
        "never": drawing is shown to be slower, and triangulating is not shown to be quicker
    draws, low, high : of "after" and "up to": draws, with a 95 % interval; infinite where it has no
        end, None where triangulating was timed once, so that nobody knows
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
    value: float
    low: float
    high: float


def break_even(record: Record, base: Record | None) -> BreakEven | None:
    """Return it for two records timed in the same rounds; None where it is not defined.

    It is undefined for the base itself, and unless drawing and triangulating of both were timed. A
    draw saves (1 - ratio) times the base's draw. Both triangulate in the same rounds, too: the
    extra triangulation time is the mean of the rounds' differences, with Student's interval.
    """
    ratio = time_ratio(record, base)
    if ratio is None or base is None or record is base:
        return None
    rounds, usual = (each.get("triangulate_samples_s") or () for each in (record, base))
    known = len(rounds) == len(usual) >= FEWEST_ROUNDS
    if known:
        longer = _Estimate(*student_interval(np.subtract(rounds, usual)))
    else:  # it was timed once
        once, usually = record.get("triangulate_s"), base.get("triangulate_s")
        if once is None or usually is None:
            return None
        longer = _Estimate(*[once - usually] * 3)
    if ratio.verdict == FASTER:
        if longer.high <= 0:
            return BreakEven("at once")
        return _over("after", longer, _saved(ratio, base), known)
    if ratio.verdict == SLOWER:
        if longer.high >= 0:
            return BreakEven("never")
        quicker = _Estimate(-longer.value, -longer.high, -longer.low)
        saved = _saved(ratio, base)
        lost = _Estimate(-saved.value, -saved.high, -saved.low)
        return _over("up to", quicker, lost, known)
    return BreakEven("not shown")


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
    # The end solves (top - x bottom)^2 = (top - top_end)^2 + x^2 (bottom - bottom_end)^2: both
    # intervals' reaches add as squares. Of its two roots `sign` names the one meant.
    if bottom_end <= 0:
        return math.inf
    below = bottom_end * (2 * bottom - bottom_end)
    inside = (top * bottom) ** 2 - top_end * (2 * top - top_end) * below
    if below <= 0:  # bottom_end is twice bottom or more: the roots do not lie around the ratio
        return top_end / bottom_end
    return (top * bottom + sign * math.sqrt(max(0.0, inside))) / below


Ground = Literal["shown", "keep", "counted", "open", "few", "alone", "part"]

TIME = "draw_ms"
COVERED = "fragments"

LEAST_PIXELS = 64
"""Fewer covered pixels than these, all polygons together, say nothing of what is drawn larger."""


@dataclass(frozen=True)
class Standing:
    """A record in a ranking.

    cost : its time over the base's, or its main counter's; what rows are in the order of
    complete : whether it left no polygon out
    ratio : its paired ratio of times, None where there is none
    pays : when it has paid, None where that is not defined
    """

    record: Record
    cost: float
    complete: bool
    ratio: Ratio | None
    pays: BreakEven | None

    @property
    def name(self) -> str:
        """Of the triangulator."""
        return str(self.record["triangulator"])

    @property
    def verdict(self) -> Verdict | None:
        """What its ratio shows, None where there is none."""
        return self.ratio.verdict if self.ratio else None


@dataclass(frozen=True)
class Decision:
    """Which triangulator to take, and why.

    standings : every record that was measured: the complete ones first, the cheapest on top
    base : what they are compared with
    ground : "shown": times show that the choice is faster than the base; "keep": that all others
        are slower; "counted": they show neither, and the choice has the least of an exact counter
        among those that are not shown to be slower; "open": nothing tells them apart; "few": fewer
        than `LEAST_PIXELS` are covered; "alone": nothing to choose from; "part": each left polygons
        out. By the last three nothing is advised
    choice : what to take, the base where nothing speaks for another
    alike : names of others that are not shown to be slower than the choice, where it is shown
    measure : the main counter, None if nothing was counted
    timed : whether times of two or more are compared
    saving : of "shown": the choice's ratio to the base, with an interval that holds for the best of
        all others at once: the best of several noisy ratios looks better than it is
    state : the state that the machine was in (`run_quality`); where it was not quiet, times show
        nothing, and rows are in the order of the main counter
    """

    standings: tuple[Standing, ...]
    base: Standing
    ground: Ground
    choice: Standing
    alike: tuple[str, ...]
    measure: str | None
    timed: bool
    saving: Ratio | None = None
    state: State = QUIET


def decide(members: Sequence[Record]) -> Decision | None:
    """Decide about the records of a group; None if none of them was measured."""
    good = [record for record in members if record["status"] == "ok"]
    first = base_of(good)
    if first is None:
        return None
    measure = next(iter(measures(first.get("counters") or ())), None)
    whole = max(map(polygons_of, good))
    standings = [_standing(record, first, whole) for record in good]
    standings.sort(key=lambda each: (-each.record["polygons"], each.cost, each.name))
    ranked = tuple(standings)
    base = next(each for each in ranked if each.record is first)
    rivals = [each for each in ranked if each.complete]
    if not rivals and len(ranked) > 1:
        return Decision(ranked, base, "part", ranked[0], (), measure, timed=False)
    rivals = rivals or standings
    ground, choice, saving = _choose(rivals, base, measure)
    others = [each for each in rivals if each is not choice and each is not base]
    shown = others if ground == "shown" else []
    ratios = {each.name: time_ratio(each.record, choice.record) for each in shown}
    alike = tuple(name for name, ratio in ratios.items() if ratio and ratio.verdict != SLOWER)
    timed = any(each.ratio is not None and each is not base for each in rivals)
    state: State = first.get("state", QUIET) if timed else QUIET
    return Decision(ranked, base, ground, choice, alike, measure, timed, saving, state)


def polygons_of(record: Record) -> int:
    """Return how many polygons the view has, drawn or not."""
    names = ("polygons", "polygons_skipped", "polygons_failed")
    return int(sum(record.get(name) or 0 for name in names))


def _standing(record: Record, base: Record, whole: int) -> Standing:
    """Rank by the paired ratio wherever there is one, as the verdict does.

    Medians of two drawings may be in another order than the rounds that timed both.
    """
    ratio = time_ratio(record, base)
    counted = measures(record.get("counters") or ())
    if ratio is not None and (ratio.quiet or not counted):
        cost = ratio.value
    else:
        names = [TIME, *counted] if ratio is None else counted
        cost, usual = value_of(record, names) or 0.0, value_of(base, names)
        cost = cost / usual if usual else cost
    complete = record["polygons"] == whole
    return Standing(record, cost, complete, ratio, break_even(record, base))


def _choose(
    rivals: Sequence[Standing], base: Standing, measure: str | None
) -> tuple[Ground, Standing, Ratio | None]:
    # Strongest ground first: what is too little to judge, then times, then counters, then nothing.
    others = [each for each in rivals if each is not base]
    if not others:
        return "alone", rivals[0], None
    usual = base if base in rivals else rivals[0]
    covered = (usual.record.get("counters") or {}).get(COVERED)
    if covered is not None and covered < LEAST_PIXELS:
        return "few", usual, None
    for each in others:
        if each.verdict == FASTER:
            saving = time_ratio(each.record, base.record, among=len(others))
            if saving is not None and saving.verdict == FASTER:
                return "shown", each, saving
    if all(each.verdict == SLOWER for each in others):
        return "keep", base, None
    open_ = [each for each in rivals if each.verdict != SLOWER]
    counts = {each.name: (each.record.get("counters") or {}).get(measure) for each in open_}
    known = [each for each in open_ if counts[each.name] is not None]
    # The base first: where nothing is counted less, nothing speaks for a change.
    known.sort(key=lambda each: (counts[each.name], each is not base))
    if known and counts[known[0].name] != counts[known[-1].name]:
        return "counted", known[0], None
    return "open", base if base in rivals else open_[0], None


def advice(decision: Decision | None) -> str:
    """Return one sentence about a group: which triangulator to take, and why."""
    if decision is None:
        return "Nothing was measured: every case was skipped or failed."
    first = decision.choice.record
    place = f"{first['device']} ({first['rasteriser']}, {condition(first)})"
    return f"On {place}, {_advice(decision, first['scene'])}."


def _advice(decision: Decision, scene: str) -> str:
    choice, base = decision.choice, decision.base
    take = f"triangulate {scene} by {choice.name}"
    if decision.ground == "shown" and decision.saving:
        ratio = decision.saving
        words = f"{take}: it is shown to save {_share(1 - ratio.value)} of {base.name}'s draw time "
        words += f"(95 % interval {_share(1 - ratio.high, '')} to {_share(1 - ratio.low)})"
        if choice.pays is not None and choice.pays.kind in ("at once", "after"):
            words += f", and pays {choice.pays.written}"
        if decision.alike:
            words += f"; no difference to {listed(decision.alike)} is shown"
        return words
    if decision.ground == "keep":
        return f"{take}: every other triangulator is shown to draw slower"
    if decision.ground == "counted":
        words = f"{take}: it has the least by exact count, {_counted(decision)}"
        return words + (f"; {_times(decision)}" if decision.timed else "")
    if decision.ground == "alone":
        return f"{scene} was triangulated by {choice.name} alone, so there is nothing to compare"
    if decision.ground == "part":
        most, whole = choice.record["polygons"], polygons_of(choice.record)
        return (
            f"nothing is advised for {scene}: each triangulator left polygons out, "
            f"{choice.name} the fewest ({most:,} of {whole:,} are drawn)"
        )
    if decision.ground == "few":
        covered = choice.record["counters"][COVERED]
        pixels = f"{covered:,} pixel{'s' * (covered != 1)}"
        return f"nothing is advised for {scene}: it covers {pixels}, too few to tell"
    if decision.timed and decision.state != QUIET:
        return f"{take}: no other costs less by exact count; {_times(decision)}"
    counted = ", and none costs less by exact count" if choice.record.get("counters") else ""
    return f"{take}: no other is shown to be faster{counted}"


def _times(decision: Decision) -> str:
    """Say why times decided nothing."""
    if decision.state != QUIET:
        return (
            f"its times are {decision.state} and show nothing, so measure again when nothing else "
            "runs"
        )
    if any(each.verdict == FASTER for each in decision.standings if each.complete):
        return "times show none to be faster, the best of so many taken as such"
    return "times show none to be faster"


def _counted(decision: Decision) -> str:
    measure, choice, base = decision.measure, decision.choice, decision.base
    assert measure is not None
    own = choice.record["counters"][measure]
    words = f"{own:,} {find(measure).label}"
    usual = (base.record.get("counters") or {}).get(measure)
    drawn = {each.record["polygons"] for each in (choice, base)}
    if base is choice or not usual or len(drawn) > 1:
        return words
    return f"{words}, {_share(1 - own / usual)} fewer than {base.name}"


def _share(value: float, unit: str = " %") -> str:
    return f"{100 * value:.1f}{unit}"


def listed(names: Sequence[str]) -> str:
    """Return names as a sentence has them: a, b and c."""
    if len(names) == 1:
        return names[0]
    return f"{', '.join(names[:-1])} and {names[-1]}"
