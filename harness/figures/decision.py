"""What the records of a group say together: an order, and which triangulator to take.

The first sentence of a report, its ranking, the terminal's table and the pictures are all made of
`decide`, so that they cannot contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from harness.figures.break_even import BreakEven, break_even
from harness.figures.groups import base_of, time_ratio
from harness.figures.ratios import FASTER, SLOWER, Ratio, Verdict
from harness.figures.registry import measures, value_of
from harness.rasterisers.counters import CYCLES
from harness.stored.folder import Record

Ground = Literal["faster", "base", "counters", "undecided", "equal", "few", "alone"]
SHOWN: Final = "faster"
KEEP: Final = "base"
COUNTED: Final = "counters"
OPEN: Final = "undecided"
EQUAL: Final = "equal"
FEW: Final = "few"
ALONE: Final = "alone"

TIME = "draw_ms"
COVERED = "fragments"

LEAST_PIXELS = 64
"""Fewer covered pixels than these, all polygons together, say nothing of what is drawn larger."""


@dataclass(frozen=True)
class Standing:
    """A record in a ranking.

    cost : its time over the base's, or its main counter's; what rows are in the order of
    complete : whether it left no polygon out that another did
    ratio : its paired ratio of times, None where there is none
    pays : when it has paid, None where that is not defined
    disagrees : whether its median time is on the other side of the base's than the ratio says
    """

    record: Record
    cost: float
    complete: bool
    ratio: Ratio | None
    pays: BreakEven | None
    disagrees: bool

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
    ground : SHOWN: times show that the choice is faster than the base; KEEP: that all others are
        slower; COUNTED: they show neither, and the choice has the least of an exact counter among
        those that are not shown to be slower; OPEN: nothing tells them apart; EQUAL: no counter
        does, either; FEW: fewer than `LEAST_PIXELS` are covered; ALONE: nothing to choose from.
        By the last three nothing is advised, and the choice is the base
    choice : what to take, the base where nothing speaks for another
    alike : names of others that are not shown to be slower than the choice, where it is shown
    measure : the main counter, None if nothing was counted
    timed : whether times of two or more are compared
    """

    standings: tuple[Standing, ...]
    base: Standing
    ground: Ground
    choice: Standing
    alike: tuple[str, ...]
    measure: str | None
    timed: bool


def decide(members: Sequence[Record]) -> Decision | None:
    """Decide about the records of a group; None if none of them was measured."""
    good = [record for record in members if record["status"] == "ok"]
    first = base_of(good)
    if first is None:
        return None
    measure = next(iter(measures(first.get("counters") or ())), None)
    complete = max(record["polygons"] for record in good)
    ranked = sorted(
        (_standing(record, first, complete) for record in good),
        key=lambda each: (not each.complete, each.cost, each.name),
    )
    base = next(each for each in ranked if each.record is first)
    rivals = [each for each in ranked if each.complete]
    ground, choice = _choose(rivals, base, measure)
    alike = [
        each.name
        for each in rivals
        if ground == SHOWN and each is not choice and each is not base and _level(each, choice)
    ]
    timed = any(each.ratio is not None and each is not base for each in rivals)
    return Decision(tuple(ranked), base, ground, choice, tuple(alike), measure, timed)


def _standing(record: Record, base: Record, complete: int) -> Standing:
    """Rank by the paired ratio wherever there is one, as the verdict does.

    Medians of two drawings may be in another order than the rounds that timed both.
    """
    ratio = time_ratio(record, base)
    names = [TIME, *measures(record.get("counters") or ())]
    cost, usual = value_of(record, names) or 0.0, value_of(base, names)
    relative = ratio.value if ratio is not None else cost / usual if usual else cost
    return Standing(
        record=record,
        cost=relative,
        complete=record["polygons"] == complete,
        ratio=ratio,
        pays=break_even(record, base),
        disagrees=ratio is not None and (_median(record) - _median(base)) * (ratio.value - 1) < 0,
    )


def _median(record: Record) -> float:
    """Return its median time, of a device whose time is a count its cycles."""
    time = record["time"]
    return float(time["median_s"] if "median_s" in time else time[CYCLES])


def _choose(
    rivals: Sequence[Standing], base: Standing, measure: str | None
) -> tuple[Ground, Standing]:
    others = [each for each in rivals if each is not base]
    if not others:
        return ALONE, rivals[0]
    usual = base if base in rivals else rivals[0]
    covered = (usual.record.get("counters") or {}).get(COVERED)
    if covered is not None and covered < LEAST_PIXELS:
        return FEW, usual
    shown = [each for each in others if each.verdict == FASTER]
    if shown:
        return SHOWN, shown[0]
    if all(each.verdict == SLOWER for each in others):
        return KEEP, base
    open_ = [each for each in rivals if each.verdict != SLOWER]
    counts = {each.name: _count(each, measure) for each in open_}
    known = [each for each in open_ if counts[each.name] is not None]
    # The base first: where nothing is counted less, nothing speaks for a change.
    known.sort(key=lambda each: (counts[each.name], each is not base))
    if known and counts[known[0].name] != counts[known[-1].name]:
        return COUNTED, known[0]
    every = [each.record.get("counters") or {} for each in rivals]
    if known and all(counters == every[0] for counters in every):
        return EQUAL, usual
    return OPEN, base if base in rivals else open_[0]


def _count(each: Standing, measure: str | None) -> int | None:
    found: int | None = (each.record.get("counters") or {}).get(measure)
    return found


def _level(each: Standing, choice: Standing) -> bool:
    ratio = time_ratio(each.record, choice.record)
    return ratio is not None and ratio.verdict != SLOWER


def explained(decision: Decision) -> str | None:
    """Say why times and ratios are in another order, where they are."""
    apart = [each.name for each in decision.standings if each.disagrees and each.complete]
    timed = [each for each in decision.standings if each.ratio is not None and each.complete]
    medians = [_median(each.record) for each in timed]
    if not apart and medians == sorted(medians):
        return None
    why = (
        "a ratio is taken within rounds, so that what the machine does to both cancels; a median "
        "is over all rounds. The ratio decides, and the rows are in its order"
    )
    if apart:
        names = ", ".join(apart)
        return f"{names}: median and ratio to {decision.base.name} seem to disagree: {why}."
    return f"Medians are in another order than ratios: {why}."
