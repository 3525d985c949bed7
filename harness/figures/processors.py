"""Keeps times of software rasterisers on different processors apart: to them it is the device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from harness.figures.run_state import state_of
from harness.machine.processor import differ, label_of
from harness.stored.folder import Record, Run
from triangulators.devices import is_software

ON_THE_CPU = ("cpu", "zink", "osmesa")
"""Names of devices that are software besides those whose name says so."""


def of_cpu(run: Run, record: Record) -> bool:
    """Whether the processor draws on a record's device."""
    name = str(record.get("device") or "")
    device = (run.facts.get("devices") or {}).get(f"{record.get('rasteriser')} on {name}") or {}
    renderer = str((device.get("details") or {}).get("renderer") or name)
    return is_software(renderer) or name.partition("@")[0] in ON_THE_CPU


def several(runs: Sequence[Run]) -> dict[str, list[str]]:
    """Return the software devices that were timed on several processors, with these."""
    labels: dict[str, set[str]] = {}
    for run in runs:
        for record in run.records:
            if record.get("time") and of_cpu(run, record):
                labels.setdefault(str(record["device"]), set()).add(label_of(run.facts))
    return {name: kinds for name, found in labels.items() if (kinds := differ(found))}


def apart(runs: Sequence[Run]) -> list[Run]:
    """Return the runs with the processor in the name of each device that `several` names."""
    mixed = several(runs)

    def named(run: Run, record: Record) -> Record:
        if record.get("device") not in mixed or not of_cpu(run, record):
            return record
        return {**record, "device": f"{record['device']} ({label_of(run.facts)})"}

    return [replace(run, records=[named(run, each) for each in run.records]) for run in runs]


def words(mixed: dict[str, list[str]]) -> str:
    """Name the devices and their processors, in one line."""
    return "; ".join(f"{device} on {', '.join(kinds)}" for device, kinds in mixed.items())


def machine_words(run: Run) -> list[str]:
    """Say, a line each, which processor drew, where it did, and where it was slower than it can be.

    What is of processors is said of runs alone that were timed on them.
    """
    timed = [each for each in run.records if each.get("time") and of_cpu(run, each)]
    devices = ", ".join(dict.fromkeys(str(each["device"]) for each in timed))
    label = label_of(run.facts)
    lines = [f"times of {devices} are of this processor: {label}"] if timed and label else []
    return lines + state_of(run.facts, run.records).words
