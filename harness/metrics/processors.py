"""Processors of runs: times of software devices on different processors are never compared.

A software rasteriser is as fast as the processor that runs it.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from harness.results.record import CaseId, Record
from harness.results.run_folder import Run
from harness.stats.run_quality import get_run_state
from triangulators.devices import is_software

SOFTWARE_DEVICES = ("cpu", "zink", "osmesa")
"""Software devices that the driver's renderer string does not identify as software."""


def read_processor(facts: Mapping[str, Any]) -> str:
    """Return the processor of a run from its `run.json`, or "" if unknown.

    Older runs have the processor's name in place of the longer label.
    """
    processor, environment = facts.get("cpu"), facts.get("environment")
    label = processor.get("label") if isinstance(processor, Mapping) else None
    name = environment.get("cpu") if isinstance(environment, Mapping) else None
    return str(label or name or "")


def may_be_same_processor(one: str, other: str) -> bool:
    """Return whether two labels may name the same processor: one is a prefix of the other."""
    return not one or not other or one.startswith(other) or other.startswith(one)


def list_distinct_processors(labels: Iterable[str]) -> list[str]:
    """Return the labels of different processors, or [] if all may name the same processor."""
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
    """Return the runs; apply `mark` to cases of software renderers timed on several CPU models.

    mark : (case, processor) -> the case with the processor in one of its fields
    """
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
    """Return lines about the processor of software devices, and about disturbances of the run."""
    devices = dict.fromkeys(record.id.device_name for record in _list_timed_in_software(run))
    label = read_processor(run.facts)
    lines = [f"processor of {', '.join(devices)}: {label}"] if devices and label else []
    return lines + get_run_state(run).warnings
