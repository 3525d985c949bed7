"""Processors of software devices: to a software rasteriser the processor is the device.

Times of software devices on different processors are never compared.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

from harness.results.processors import list_different, processor_label
from harness.results.record import CaseId, Record
from harness.results.run_folder import Run
from harness.stats.run_quality import state_of
from triangulators.devices import is_software

SOFTWARE_DEVICES = ("cpu", "zink", "osmesa")
"""Software devices whose driver does not say that they are."""


def is_drawn_by_processor(run: Run, record: Record) -> bool:
    """Return whether a record's device is software."""
    device = f"{record.id.rasteriser} on {record.id.device_name}"
    details = ((run.facts.get("devices") or {}).get(device) or {}).get("details") or {}
    renderer = str(details.get("renderer") or record.id.device_name)
    return is_software(renderer) or record.id.device in SOFTWARE_DEVICES


def _timed_by_processor(run: Run) -> list[Record]:
    return [each for each in run.records if each.time and is_drawn_by_processor(run, each)]


def several_processors(runs: Sequence[Run]) -> dict[str, list[str]]:
    """Return the software devices that were timed on several processors: name -> processors."""
    labels: dict[str, set[str]] = {}
    for run in runs:
        for record in _timed_by_processor(run):
            labels.setdefault(record.id.device_name, set()).add(processor_label(run.facts))
    return {name: kinds for name, found in labels.items() if (kinds := list_different(found))}


def by_processor(runs: Sequence[Run], mark: Callable[[CaseId, str], CaseId]) -> list[Run]:
    """Return the runs with cases of software devices on several processors marked.

    mark : (case, processor) -> the case with the processor in one of its fields
    """
    mixed = several_processors(runs)

    def marked(run: Run, record: Record) -> Record:
        if record.id.device_name not in mixed or not is_drawn_by_processor(run, record):
            return record
        return replace(record, id=mark(record.id, processor_label(run.facts)))

    return [replace(run, records=[marked(run, each) for each in run.records]) for run in runs]


def format_processors(mixed: dict[str, list[str]]) -> str:
    """Return the devices and their processors in one line."""
    return "; ".join(f"{device} on {', '.join(kinds)}" for device, kinds in mixed.items())


def describe_machine(run: Run) -> list[str]:
    """Return the processor that drew, if one did, and what disturbed the run, a line each."""
    devices = ", ".join(dict.fromkeys(each.id.device_name for each in _timed_by_processor(run)))
    label = processor_label(run.facts)
    lines = [f"times of {devices} are of this processor: {label}"] if devices and label else []
    return lines + state_of(run).words
