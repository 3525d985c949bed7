"""Decide which triangulator to take in a group: ranking, verdicts, and the ground of the choice.

The table of the terminal, summary.csv, the report and the advice are all made of one `Decision`, so
that they cannot contradict each other.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from harness.metrics.break_even import BreakEven, break_even
from harness.metrics.groups import RecordGroup, groups_of
from harness.metrics.registry import measures, value_of
from harness.results.record import Record
from harness.results.run_folder import Run
from harness.stats.intervals import FASTER, SLOWER, Ratio, Verdict

Ground = Literal["shown", "keep", "counted", "open", "few", "alone", "part"]

TIME = "draw_ms"
COVERED = "fragments"

MIN_PIXELS = 64
"""With fewer covered pixels, all polygons together, counters say nothing about larger drawings."""


@dataclass(frozen=True)
class Standing:
    """A record in a ranking.

    cost : sort key: time relative to the base's, or main counter relative to the base's
    complete : whether it drew all polygons
    ratio : paired ratio of times to the base's, None if there is none
    pays : break-even against the base, None if undefined
    """

    record: Record
    cost: float
    complete: bool
    ratio: Ratio | None
    pays: BreakEven | None

    @property
    def name(self) -> str:
        """Name of the triangulator."""
        return self.record.name

    @property
    def verdict(self) -> Verdict | None:
        """Verdict of the ratio, None if there is none."""
        return self.ratio.verdict if self.ratio else None


@dataclass(frozen=True)
class Decision:
    """Which triangulator to take, and why.

    standings : measured records: the complete ones first, the cheapest on top; unless the group's
        state is quiet, in the order of the main counter
    base : the standing that the others are compared with
    ground : "shown": times show that the choice is faster than the base; "keep": that all others
        are slower; "counted": they show neither, and the choice has the least of an exact counter
        among those that are not shown to be slower; "open": nothing tells them apart; "few": fewer
        than `MIN_PIXELS` are covered; "alone": nothing to choose from; "part": each left polygons
        out. With the last three there is no recommendation
    choice : what to take: the base if nothing speaks for another
    alike : names of others that are not shown to be slower than a choice that is "shown"
    measure : the main counter, None if nothing was counted
    timed : whether times of two or more are compared
    saving : of "shown": the choice's ratio to the base, with an interval that holds for the best of
        all others at once: the best of several noisy ratios looks better than it is
    """

    group: RecordGroup
    standings: tuple[Standing, ...]
    base: Standing
    ground: Ground
    choice: Standing
    alike: tuple[str, ...]
    measure: str | None
    timed: bool
    saving: Ratio | None = None


def decide(group: RecordGroup) -> Decision | None:
    """Decide about the records of a group, or return None if none was measured."""
    base_record = group.base
    if base_record is None:
        return None
    measure = next(iter(measures(base_record.counters)), None)
    all_polygons = max(record.all_polygons for record in group.measured)
    complete = [record for record in group.measured if record.polygons == all_polygons]
    among = sum(record is not base_record for record in complete)
    standings = [
        _rank(record, group, base_record, all_polygons, among) for record in group.measured
    ]
    standings.sort(key=lambda each: (-each.record.polygons, each.cost, each.name))
    ranked = tuple(standings)
    base = next(each for each in ranked if each.record is base_record)
    rivals = [each for each in ranked if each.complete]
    if not rivals and len(ranked) > 1:
        return Decision(group, ranked, base, "part", ranked[0], (), measure, timed=False)
    rivals = rivals or standings
    ground, choice, saving = _choose(rivals, base, measure)
    others = [each for each in rivals if each is not choice and each is not base]
    shown = others if ground == "shown" else []
    ratios = {each.name: group.compare(each.record, choice.record) for each in shown}
    alike = tuple(name for name, ratio in ratios.items() if ratio and ratio.verdict != SLOWER)
    timed = any(each.ratio is not None and each is not base for each in rivals)
    return Decision(group, ranked, base, ground, choice, alike, measure, timed, saving)


Decided = tuple[RecordGroup, Decision | None]
"""A group and what was decided about it, None if nothing was measured."""


def decide_all(run: Run) -> list[Decided]:
    """Return the groups of a run with what was decided about each."""
    return [(group, decide(group)) for group in groups_of(run)]


def _rank(
    record: Record, group: RecordGroup, base: Record, all_polygons: int, among: int
) -> Standing:
    """Rank by the paired ratio if there is one, as the verdict does.

    Medians of two drawings may be in another order than the rounds that timed both.

    among : number of complete records that the base is compared with
    """
    ratio = group.compare(record, base, among)
    counted = measures(record.counters)
    if ratio is not None and (ratio.quiet or not counted):
        cost = ratio.value
    else:
        names = [TIME, *counted] if ratio is None else counted
        cost, usual = value_of(record, names) or 0.0, value_of(base, names)
        cost = cost / usual if usual else cost
    complete = record.polygons == all_polygons
    return Standing(record, cost, complete, ratio, break_even(record, base, ratio))


def _choose(
    rivals: Sequence[Standing], base: Standing, measure: str | None
) -> tuple[Ground, Standing, Ratio | None]:
    # Strongest ground first: what is too little to judge, then times, then counters, then nothing.
    others = [each for each in rivals if each is not base]
    if not others:
        return "alone", rivals[0], None
    usual = base if base in rivals else rivals[0]
    covered = usual.record.counters.get(COVERED)
    if covered is not None and covered < MIN_PIXELS:
        return "few", usual, None
    for each in others:
        if each.verdict == FASTER:
            saving = each.ratio and (each.ratio.joint or each.ratio)
            if saving is not None and saving.verdict == FASTER:
                return "shown", each, saving
    if all(each.verdict == SLOWER for each in others):
        return "keep", base, None
    open_ = [each for each in rivals if each.verdict != SLOWER]
    counts = {each.name: each.record.counters.get(measure or "") for each in open_}
    counted = [(count, each) for each in open_ if (count := counts[each.name]) is not None]
    # The base first: if no count is less, nothing speaks for a change.
    counted.sort(key=lambda pair: (pair[0], pair[1] is not base))
    if counted and counted[0][0] != counted[-1][0]:
        return "counted", counted[0][1], None
    return "open", base if base in rivals else open_[0], None
