"""Records that may be compared with each other, and what they are compared against.

Times of software rasterisers on different processors stay apart: to them it is the device.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any

from harness.errors import unknown
from harness.results.processors import list_different, processor_label
from harness.results.run_folder import Record, Run
from harness.stats.intervals import Ratio, of_any_run, paired_ratio
from harness.stats.run_quality import QUIET, kept_pairs, state_of
from triangulators.devices import is_software

USUAL_BASE = "ear-clipping"
"""What ratios are given against unless told otherwise: what most programs use today."""

SAME = ("overdraw", "half_perimeter", "edge_length", "shape")
"""Criteria that, when they are all equal, show two names for one triangulation."""


CONDITIONS = {
    "rotation": (0.0, "turned {:g}°"),
    "fit": ("box", "fit to a {}"),
    "samples": (1, "{} samples per pixel"),
    "work": (0, "work {}"),
    "order": ("native", "{} order"),
    "seed": (0, "seed {}"),
}
"""How something is drawn usually, and what is said where it is not."""


def condition(record: Mapping[Any, Any]) -> str:
    """Say how what a record is of was drawn: `128 px, turned 30°, work 8`."""
    told = {**record, **(record.get("options") or {})}
    unusual = (
        form.format(told[name])
        for name, (usual, form) in CONDITIONS.items()
        if told.get(name) not in (None, usual)
    )
    return ", ".join([f"{record['resolution']} px", *unusual])


def group_of(record: Record) -> tuple[Any, ...]:
    """Return what the records that may be compared with each other have in common."""
    options = tuple(sorted((record.get("options") or {}).items()))
    names = ("scene", "rasteriser", "device", "resolution", "rotation", "fit")
    return (*(record.get(name) for name in names), options)


def groups(records: Sequence[Record]) -> list[list[Record]]:
    """Split records into those measured alike but for the triangulator."""
    ordered = sorted(records, key=lambda record: repr(group_of(record)))
    return [list(members) for _, members in groupby(ordered, key=group_of)]


def without_twins(records: Sequence[Record]) -> list[Record]:
    """Return the records of one polygon and view, the first of each triangulation."""
    seen: dict[tuple[float, ...], Record] = {}
    for record in records:
        predicted = record["predicted"]
        if all(name in predicted for name in SAME):  # damage can take one away
            seen.setdefault(tuple(round(predicted[name], 6) for name in SAME), record)
    return list(seen.values())


def base_of(members: Sequence[Record]) -> Record | None:
    """Return the record of a group that the others are measured against; None if none was measured.

    It is the base that the run chose (`base` of its records, as they are read), else ear clipping,
    else the first that left no polygon out.
    """
    measured = [record for record in members if record["status"] == "ok"]
    by_name = {record["triangulator"]: record for record in measured}
    for name in (*(record.get("base") for record in measured[:1]), USUAL_BASE):
        if name in by_name:
            return by_name[name]
    return max(measured, key=lambda record: record.get("polygons") or 0, default=None)


def with_base(run: Run, name: str) -> Run:
    """Return the run with the triangulator `name` as what ratios are given against.

    Raises
    ------
    UsageError
        if the run holds no such triangulator
    """
    known = dict.fromkeys(record["triangulator"] for record in run.records)
    if run.records and name not in known:
        raise unknown("base", name, known)
    return replace(run, records=[{**record, "base": name} for record in run.records])


def time_ratio(record: Record, base: Record | None, among: int = 1) -> Ratio | None:
    """Return the paired ratio of two records' times, None where they are not comparable.

    Its interval is that of a run like theirs, not of theirs alone (`of_any_run`). It shows nothing
    where the run's state was not quiet.

    among : how many there are of which one is chosen by its ratio
    """
    if base is None or record.get("polygons") != base.get("polygons"):
        return None
    times, base_times = record.get("time") or {}, base.get("time") or {}
    # Without the rounds of both, which damage can take away, nothing is paired.
    if not all({"samples_s", "reference_s"} <= each.keys() for each in (times, base_times)):
        return None
    if times["reference_s"] != base_times["reference_s"]:
        return None
    if len(times["samples_s"]) != len(base_times["samples_s"]):
        return None
    parts = times.get("epochs"), times.get("processes")
    kept = kept_pairs(times, base_times)
    found = paired_ratio(times["samples_s"], base_times["samples_s"], *parts, kept, among)
    return replace(of_any_run(found, among), quiet=record.get("state", QUIET) == QUIET)


ON_THE_CPU = ("cpu", "zink", "osmesa")
"""Names of devices that are software besides those whose name says so."""


def of_cpu(run: Run, record: Record) -> bool:
    """Whether the processor draws on a record's device."""
    name = str(record.get("device") or "")
    device = (run.facts.get("devices") or {}).get(f"{record.get('rasteriser')} on {name}") or {}
    renderer = str((device.get("details") or {}).get("renderer") or name)
    return is_software(renderer) or name.partition("@")[0] in ON_THE_CPU


def several_processors(runs: Sequence[Run]) -> dict[str, list[str]]:
    """Return the software devices that were timed on several processors, with these."""
    labels: dict[str, set[str]] = {}
    for run in runs:
        for record in run.records:
            if record.get("time") and of_cpu(run, record):
                labels.setdefault(str(record["device"]), set()).add(processor_label(run.facts))
    return {name: kinds for name, found in labels.items() if (kinds := list_different(found))}


def by_processor(runs: Sequence[Run], field: str = "device", how: str = "{} ({})") -> list[Run]:
    """Return the runs with the processor in a field of what drew on a device that several had."""
    mixed = several_processors(runs)

    def named(run: Run, record: Record) -> Record:
        if record.get("device") not in mixed or not of_cpu(run, record):
            return record
        return {**record, field: how.format(record.get(field), processor_label(run.facts))}

    return [replace(run, records=[named(run, each) for each in run.records]) for run in runs]


def processor_words(mixed: dict[str, list[str]]) -> str:
    """Name the devices and their processors, in one line."""
    return "; ".join(f"{device} on {', '.join(kinds)}" for device, kinds in mixed.items())


def machine_words(run: Run) -> list[str]:
    """Say, a line each, which processor drew, where it did, and where it was slower than it can be.

    What is of processors is said of runs alone that were timed on them.
    """
    timed = [each for each in run.records if each.get("time") and of_cpu(run, each)]
    devices = ", ".join(dict.fromkeys(str(each["device"]) for each in timed))
    label = processor_label(run.facts)
    lines = [f"times of {devices} are of this processor: {label}"] if timed and label else []
    return lines + state_of(run.facts, run.records).words
