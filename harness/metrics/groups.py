"""Groups of comparable records, and ratios of times."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby

from harness.errors import make_unknown_name_error
from harness.results.record import CaseGroup, Record
from harness.results.run_folder import Run
from harness.stats.intervals import FASTER, Ratio, add_run_scatter, compute_paired_ratio
from harness.stats.run_quality import QUIET, STATES, State, select_rounds

DEFAULT_BASE = "ear-clipping"
"""Default base of ratios: the method that most programs use today."""

IDENTIFYING = ("overdraw", "half_perimeter", "edge_length", "shape")
"""Criteria whose values are all equal only for the same triangulation of a polygon."""


@dataclass(frozen=True)
class RecordGroup:
    """Records that differ in the triangulator alone.

    base_name : the base that the user chose, "" if none
    state : state of the machine during the run; unless quiet, times are not used
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
        """The base of the ratios, or None if no record was measured.

        The base is the user's choice, otherwise ear clipping, otherwise the first record with the
        maximum number of polygons.
        """
        by_name = {record.name: record for record in self.measured}
        for name in (self.base_name, DEFAULT_BASE):
            if name in by_name:
                return by_name[name]
        return max(self.measured, key=lambda record: record.polygons, default=None)

    def compare(self, record: Record, base: Record | None, candidates: int = 1) -> Ratio | None:
        """Return `compute_time_ratio` of two records of the group."""
        return compute_time_ratio(record, base, candidates, quiet=self.state == QUIET)


def group_records(
    records: Iterable[Record], base_name: str = "", state: State = QUIET
) -> list[RecordGroup]:
    """Split records into sorted groups; the records of a group stay in the given order."""
    ordered = sorted(records, key=lambda record: record.id.group)
    return [
        RecordGroup(group, tuple(members), base_name, state)
        for group, members in groupby(ordered, key=lambda record: record.id.group)
    ]


def group_run(run: Run) -> list[RecordGroup]:
    """Return the groups of a run's records, with the run's base and state."""
    stored = (run.facts.get("state") or {}).get("state")
    return group_records(run.records, run.base, stored if stored in STATES else QUIET)


def drop_equal_triangulations(records: Sequence[Record]) -> list[Record]:
    """Return, of records of one polygon and view, the first of each distinct triangulation."""
    first: dict[tuple[float, ...], Record] = {}
    for record in records:
        predicted = record.predicted
        if all(name in predicted for name in IDENTIFYING):  # a damaged record may lack a criterion
            first.setdefault(tuple(round(predicted[name], 6) for name in IDENTIFYING), record)
    return list(first.values())


def set_base(run: Run, name: str) -> Run:
    """Return the run with the triangulator `name` as the base of ratios.

    Raises
    ------
    UsageError
        if the run has no such triangulator
    """
    names = dict.fromkeys(record.name for record in run.records)
    if run.records and name not in names:
        raise make_unknown_name_error("base", name, names)
    return replace(run, facts={**run.facts, "base": name})


def compute_time_ratio(
    record: Record, base: Record | None, candidates: int = 1, *, quiet: bool = True
) -> Ratio | None:
    """Return the paired ratio of two records' times, or None for incomparable records.

    The interval includes the scatter between runs (`add_run_scatter`).

    candidates : number of ratios of which the caller may report the lowest. If there are several, a
        ratio significantly below 1 also gets an interval corrected for that choice (`joint`)
    quiet : False if the run was disturbed, so that the ratio is not used
    """
    if base is None or record.polygons != base.polygons:
        return None
    time, base_time = record.time, base.time
    if time is None or base_time is None or not time.is_paired_with(base_time):
        return None
    parts = (time.epochs or None, time.processes or None)
    samples = (time.samples_s, base_time.samples_s, *parts, select_rounds(time, base_time))
    ratio = replace(add_run_scatter(compute_paired_ratio(*samples)), quiet=quiet)
    if candidates > 1 and ratio.verdict == FASTER:
        ratio = replace(
            ratio, joint=add_run_scatter(compute_paired_ratio(*samples, candidates), candidates)
        )
    return ratio
