"""Groups of records that may be compared with each other, and ratios of their times."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

from harness.errors import unknown
from harness.results.record import CaseGroup, Record
from harness.results.run_folder import Run
from harness.stats.intervals import FASTER, Ratio, of_any_run, paired_ratio
from harness.stats.run_quality import QUIET, STATES, State, select_rounds

USUAL_BASE = "ear-clipping"
"""Default base of ratios: what most programs use today."""

SAME = ("overdraw", "half_perimeter", "edge_length", "shape")
"""Criteria that are all equal only if two names stand for one triangulation."""


@dataclass(frozen=True)
class RecordGroup:
    """Records that differ in the triangulator alone.

    base_name : the base that the user chose, "" if none
    state : of the machine during the run; unless it was quiet, times show nothing
    """

    id: CaseGroup
    records: tuple[Record, ...]
    base_name: str = ""
    state: State = QUIET

    @cached_property
    def measured(self) -> list[Record]:
        """The records that are ok."""
        return [record for record in self.records if record.is_ok]

    @cached_property
    def base(self) -> Record | None:
        """The record that the others are compared with, or None if none was measured.

        It is the chosen base, else ear clipping, else the first with the most polygons.
        """
        by_name = {record.name: record for record in self.measured}
        for name in (self.base_name, USUAL_BASE):
            if name in by_name:
                return by_name[name]
        return max(self.measured, key=lambda record: record.polygons, default=None)

    def compare(self, record: Record, base: Record | None, among: int = 1) -> Ratio | None:
        """Return `time_ratio` of two records of the group."""
        return time_ratio(record, base, among, quiet=self.state == QUIET)


def group_records(
    records: Iterable[Record], base_name: str = "", state: State = QUIET
) -> list[RecordGroup]:
    """Split records into groups, in order; records of a group keep their order."""
    ordered = sorted(records, key=lambda record: record.id.group)
    return [
        RecordGroup(group, tuple(members), base_name, state)
        for group, members in groupby(ordered, key=lambda record: record.id.group)
    ]


def groups_of(run: Run) -> list[RecordGroup]:
    """Return the groups of a run's records, with the run's base and state."""
    stored = (run.facts.get("state") or {}).get("state")
    known: State = QUIET
    state = next((state for state in STATES if state == stored), known)
    return group_records(run.records, run.base, state)


def without_twins(records: Sequence[Record]) -> list[Record]:
    """Return the records of one polygon and view, the first of each triangulation."""
    first: dict[tuple[float, ...], Record] = {}
    for record in records:
        predicted = record.predicted
        if all(name in predicted for name in SAME):  # damage can take one away
            first.setdefault(tuple(round(predicted[name], 6) for name in SAME), record)
    return list(first.values())


def with_base(run: Run, name: str) -> Run:
    """Return the run with the triangulator `name` as the base of ratios.

    Raises
    ------
    UsageError
        if the run has no such triangulator
    """
    names = dict.fromkeys(record.name for record in run.records)
    if run.records and name not in names:
        raise unknown("base", name, names)
    return replace(run, facts={**run.facts, "base": name})


def time_ratio(
    record: Record, base: Record | None, among: int = 1, *, quiet: bool = True
) -> Ratio | None:
    """Return the paired ratio of two records' times, or None if they are not comparable.

    Its interval is that of any run like theirs (`of_any_run`).

    among : number of ratios of which this one may be chosen by its value; if there are several, a
        ratio that shows a gain has a `joint` one
    quiet : False if the run was disturbed, so that the ratio shows nothing
    """
    if base is None or record.polygons != base.polygons:
        return None
    time, other = record.time, base.time
    if time is None or other is None or not time.is_paired_with(other):
        return None
    parts = (time.epochs or None, time.processes or None)
    samples = (time.samples_s, other.samples_s, *parts, select_rounds(time, other))
    ratio = replace(of_any_run(paired_ratio(*samples)), quiet=quiet)
    if among > 1 and ratio.verdict == FASTER:
        joint = of_any_run(paired_ratio(*samples, among), among)
        ratio = replace(ratio, joint=joint)
    return ratio
