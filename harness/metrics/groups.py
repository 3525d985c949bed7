"""Groups of comparable records: ratios of times, and of counters over tiles, views or polygons.

Times of software devices, which are as fast as the processor, are compared on one processor only.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from math import isfinite
from typing import Any

import numpy as np

from harness.errors import make_unknown_name_error
from harness.metrics.registry import PREDICTED, find_metric, list_costs
from harness.metrics.run_quality import QUIET, State, get_run_state, select_rounds
from harness.metrics.statistics import (
    FASTER,
    MIN_VALUES,
    Column,
    Ratio,
    add_run_scatter,
    compute_mean_interval,
    compute_paired_ratio,
    compute_ratio_interval,
)
from harness.rasterisers.counters import compute_estimates
from harness.results.record import CaseGroup, CaseId, Record
from harness.results.run_folder import Run, read_arrays
from triangulators.gpu import is_software

Columns = dict[str, Column]  # criteria and counters of p polygons, (p,), by name

DEFAULT_BASE = "ear-clipping"  # default base of ratios: the method that most programs use today

IDENTIFYING_CRITERIA = ("overdraw", "half_perimeter", "edge_length", "shape")
"""Criteria whose values are all equal only for the same triangulation of a polygon."""


@dataclass(frozen=True)
class RecordGroup:
    """Records that differ in the triangulator alone; `base_name` is the user's choice, or "".

    state : state of the machine during the run; unless quiet, times are not used
    """

    id: CaseGroup
    records: tuple[Record, ...]
    base_name: str = ""
    state: State = QUIET

    @cached_property
    def measured(self) -> list[Record]:
        """The records whose case was measured without failure."""
        return [record for record in self.records if record.is_ok]

    @cached_property
    def base(self) -> Record | None:
        """The base of the ratios, or None if no record was measured.

        The user's choice, otherwise ear clipping, otherwise the first with the most polygons.
        """
        by_name = {record.name: record for record in self.measured}
        for name in (self.base_name, DEFAULT_BASE):
            if name in by_name:
                return by_name[name]
        return max(self.measured, key=lambda record: record.polygons, default=None)

    def compute_ratio(
        self, record: Record, base: Record | None, candidates: int = 1
    ) -> Ratio | None:
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
    return group_records(run.records, run.base, get_run_state(run).state)


def drop_equal_triangulations(records: Sequence[Record]) -> list[Record]:
    """Return records of one polygon and view, one for each set of equal `IDENTIFYING_CRITERIA`."""
    first: dict[tuple[float, ...], Record] = {}
    for record in records:
        predicted = record.predicted
        if all(
            name in predicted for name in IDENTIFYING_CRITERIA
        ):  # a damaged record may lack a criterion
            first.setdefault(
                tuple(round(predicted[name], 6) for name in IDENTIFYING_CRITERIA), record
            )
    return list(first.values())


def replace_base(run: Run, name: str) -> Run:
    """Return the run with the triangulator `name` as the base of ratios."""
    names = dict.fromkeys(record.name for record in run.records)
    if run.records and name not in names:
        raise make_unknown_name_error("base", name, names)
    return replace(run, facts={**run.facts, "base": name})


def compute_time_ratio(
    record: Record, base: Record | None, candidates: int = 1, *, quiet: bool = True
) -> Ratio | None:
    """Return the paired ratio of two records' times, or None for incomparable records.

    The interval includes the scatter between runs. If the caller may report the lowest of several
    `candidates`, a ratio significantly below 1 also gets an interval corrected for that choice
    (`joint`). The ratio of a run that is not `quiet` is not used.
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


DESCRIBED_COUNTERS = ("helper_lanes", "quads")  # compared over views, like the main counter


@dataclass(frozen=True)
class ViewStatistics:
    """A counter's mean and ratio to the base's sum, with 95 % intervals over views, or NaN."""

    views: int
    measure: str
    mean: float
    mean_low: float
    mean_high: float
    ratio: float
    ratio_low: float
    ratio_high: float

    @property
    def text(self) -> str:
        """The ratio, with its interval if there is one."""
        interval = f" ({self.ratio_low:.3f}-{self.ratio_high:.3f})"
        return f"{self.ratio:.3f}{interval if isfinite(self.ratio_low) else ''}"


def compare_views(record: Record, base: Record | None, measure: str = "") -> ViewStatistics | None:
    """Return a counter's mean over views and ratio to the base, or None if incomparable."""
    if base is None or record.polygons != base.polygons:
        return None
    if record.views is None or base.views is None:
        return None
    sums, base_sums = record.views.counters, base.views.counters
    common = {*sums} & {*base_sums}
    measure = measure or next(iter(list_costs(common)), "")
    if measure not in common or len(sums[measure]) != len(base_sums[measure]):
        return None
    values = np.array(sums[measure], np.float64)
    base_values = np.array(base_sums[measure], np.float64)
    if not base_values.sum():
        return None
    return ViewStatistics(
        len(values),
        measure,
        float(values.mean()),
        *compute_mean_interval(values),
        float(values.sum() / base_values.sum()),
        *compute_ratio_interval(values, base_values),
    )


def describe_views(group: RecordGroup) -> list[str]:
    """Return lines that compare the group's counters over views, and count depth ties."""
    base = group.base
    if base is None:
        return []
    main = next(iter(list_costs(base.views.counters if base.views else ())), "")
    lines = [
        _describe_counter(group, base, name) for name in dict.fromkeys((main, *DESCRIBED_COUNTERS))
    ]
    if ties := base.counters.get("depth_ties", 0):
        lines.append(f"{ties:,} depth tests of {base.name} are ties: rounding decides them")
    return [line for line in lines if line]


def _describe_counter(group: RecordGroup, base: Record, measure: str) -> str:
    """Return a line with each triangulator's ratio of a counter to the base, "" without views."""
    rows = [
        (statistics.ratio, record.name, statistics)
        for record in group.measured
        if record is not base and (statistics := compare_views(record, base, measure)) is not None
    ]
    if not rows or not measure:
        return ""
    views, noun = rows[0][2].views, "tile" if group.id.view.fit == "tile" else "view"
    nouns = f"{views:,} {noun}{'' if views == 1 else 's'}"
    note = f"95 % CI over {nouns}" if views >= MIN_VALUES else f"{nouns}, too few for intervals"
    rows.sort(key=lambda row: row[0])
    ratios = ", ".join(f"{name} {statistics.text}" for _, name, statistics in rows)
    return f"{find_metric(measure).label} relative to {base.name} ({note}): {ratios}"


SOFTWARE_DEVICES = ("cpu", "zink", "osmesa")  # the renderer string does not identify these


def read_processor(facts: Mapping[str, Any]) -> str:
    """Return the processor of a run: its label or, in older runs, its name; "" if unknown."""
    processor, environment = facts.get("cpu"), facts.get("environment")
    label = processor.get("label") if isinstance(processor, Mapping) else None
    name = environment.get("cpu") if isinstance(environment, Mapping) else None
    return str(label or name or "")


def may_be_same_processor(one: str, other: str) -> bool:
    """Return whether two labels may name the same processor: one is a prefix of the other."""
    return not one or not other or one.startswith(other) or other.startswith(one)


def list_distinct_processors(labels: Iterable[str]) -> list[str]:
    """Return the labels of different processors, or [] if all may name the same one."""
    distinct: list[str] = []
    for label in sorted(set(labels), key=len, reverse=True):
        if not any(may_be_same_processor(label, other) for other in distinct):
            distinct.append(label)
    return sorted(distinct) if len(distinct) > 1 else []


def is_drawn_in_software(run: Run, record: Record) -> bool:
    """Return whether a record's device is a software renderer."""
    device = f"{record.id.rasteriser} on {record.id.device_name}"
    details = ((run.facts.get("devices") or {}).get(device) or {}).get("details") or {}
    renderer = str(details.get("renderer") or record.id.device_name)
    return is_software(renderer) or record.id.device in SOFTWARE_DEVICES


def _list_timed_in_software(run: Run) -> list[Record]:
    return [record for record in run.records if record.time and is_drawn_in_software(run, record)]


def find_mixed_processors(runs: Sequence[Run]) -> dict[str, list[str]]:
    """Return the software devices that were timed on several processors: name -> processors."""
    labels: dict[str, set[str]] = {}
    for run in runs:
        for record in _list_timed_in_software(run):
            labels.setdefault(record.id.device_name, set()).add(read_processor(run.facts))
    return {
        device: distinct
        for device in labels
        if (distinct := list_distinct_processors(labels[device]))
    }


def mark_processors(runs: Sequence[Run], mark: Callable[[CaseId, str], CaseId]) -> list[Run]:
    """Return the runs; `mark` adds the processor to cases of software devices timed on several."""
    mixed = find_mixed_processors(runs)

    def mark_record(run: Run, record: Record) -> Record:
        if record.id.device_name not in mixed or not is_drawn_in_software(run, record):
            return record
        return replace(record, id=mark(record.id, read_processor(run.facts)))

    return [replace(run, records=[mark_record(run, r) for r in run.records]) for run in runs]


def format_processors(mixed: dict[str, list[str]]) -> str:
    """Return devices and their processors in one line."""
    return "; ".join(f"{device} on {', '.join(labels)}" for device, labels in mixed.items())


def describe_machine(run: Run) -> list[str]:
    """Return lines about the processor of software devices, and about disturbances."""
    devices = dict.fromkeys(record.id.device_name for record in _list_timed_in_software(run))
    label = read_processor(run.facts)
    lines = [f"processor of {', '.join(devices)}: {label}"] if devices and label else []
    return lines + get_run_state(run).warnings


def read_columns(run: Run, record: Record) -> Columns | None:
    """Return the criteria and counters of each polygon in a case, or None if not stored."""
    arrays = read_arrays(run, record.key)
    if arrays is None or f"{PREDICTED}triangles" not in arrays:
        return None
    columns = {name: np.asarray(column, np.float64) for name, column in arrays.items()}
    return columns | compute_estimates(columns, PREDICTED)


def compute_ratios(columns: Columns, base: Columns, name: str) -> Column:
    """Return each polygon's ratio in the column `name` to the base's, (p,), NaN if missing or 0.

    Without this division the polygon's size would make every criterion look good.
    """
    drawn = (columns[f"{PREDICTED}triangles"] > 0) & (base[f"{PREDICTED}triangles"] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = columns[name] / base[name]
    return np.where(drawn & np.isfinite(ratio) & (ratio > 0), ratio, np.nan)


def pair_ratios(
    columns: dict[str, Columns], base: str, criterion: str, measure: str
) -> tuple[Column, Column]:
    """Return the ratios to the base of a criterion and of a counter, one per polygon and method.

    columns : by triangulator; without the criterion or the measure, the results are empty
    """
    name, base_columns = PREDICTED + criterion, columns[base]
    complete = all({name, measure} <= column.keys() for column in columns.values())
    compared = [
        column for triangulator, column in columns.items() if triangulator != base and complete
    ]
    if not compared:
        return np.empty(0), np.empty(0)
    x, y = (
        np.concatenate([compute_ratios(column, base_columns, field) for column in compared])
        for field in (name, measure)
    )
    return x, y
