"""Match the cases of two runs by identity.

A case's key is not used: it includes the scene's content, and changed content is to be reported. A
case of BASE that HEAD's plan has and HEAD's records lack was not done. Differences of plan,
software and machine between the runs are listed.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.errors import IncompatibleRunsError
from harness.metrics.processors import may_be_same_processor, read_processor
from harness.results.record import CaseId, Record
from harness.results.run_folder import Run
from harness.style import flatten

ENVIRONMENT = (*("harness", "code", "python", "packages", "kernel", "cpu", "threads", "governor"),)
"""Facts of a run's environment that are compared."""


@dataclass(frozen=True)
class Match:
    """A case with the records in BASE and HEAD, None for a run without a record."""

    id: CaseId
    base: Record | None
    head: Record | None


def match_cases(base: Run, head: Run, *, across_devices: bool) -> list[Match]:
    """Pair the cases of two runs, in HEAD's order, then the cases of BASE alone.

    across_devices : pair a rasteriser's only device in BASE with its only device in HEAD

    Raises
    ------
    IncompatibleRunsError
        if the devices differ without `across_devices`, or a rasteriser has several devices to pair
    """
    device_pairs = _pair_devices(base, head, across_devices=across_devices)
    before: dict[CaseId, Record] = {}
    for record in base.records:
        case = record.id
        device = device_pairs.get((case.rasteriser, case.device_name))
        if device is not None:
            target = next(r.id for r in head.records if r.id.device_name == device)
            case = replace(case, device=target.device, host=target.host)
        before[case] = record
    after = {record.id: record for record in head.records}
    cases = [*after, *(case for case in before if case not in after)]
    return [Match(case, before.get(case), after.get(case)) for case in cases]


def _group_devices(records: Sequence[Record]) -> dict[str, set[str]]:
    """Return rasteriser -> names of its devices."""
    devices = defaultdict(set)
    for record in records:
        devices[record.id.rasteriser].add(record.id.device_name)
    return devices


def _pair_devices(base: Run, head: Run, *, across_devices: bool) -> dict[tuple[str, str], str]:
    """Return (rasteriser, device in BASE) -> device in HEAD, for devices that differ."""
    before, after = _group_devices(base.records), _group_devices(head.records)
    common = {name: (before[name], after[name]) for name in before.keys() & after.keys()}
    if across_devices:
        changed = {name: devices for name, devices in common.items() if devices[0] != devices[1]}
        for name, devices in changed.items():
            if max(map(len, devices)) > 1:
                raise IncompatibleRunsError(
                    f"{name} ran on several devices, so the devices to compare are ambiguous; give "
                    "runs of one device each"
                )
        return {(name, min(old)): min(new) for name, (old, new) in changed.items()}
    for name, sides in common.items():
        if not sides[0] & sides[1]:
            names = (", ".join(sorted(devices)) for devices in sides)
            raise IncompatibleRunsError(
                "{}: BASE ran on {} and HEAD on {}: counters and times differ between devices; "
                "add --across-devices to compare them".format(name, *names)
            )
    for label, (old, new) in find_changed_hardware(base, head).items():
        raise IncompatibleRunsError(
            f"{label} was '{old}' in BASE and is '{new}' in HEAD: "
            "add --across-devices to compare them"
        )
    return {}


def find_changed_hardware(base: Run, head: Run) -> dict[str, tuple[str, str]]:
    """Return label -> (BASE's, HEAD's) renderer of each device whose renderer differs.

    The driver's version, in brackets in a renderer's name, may change.
    """
    before, after = _map_renderers(base), _map_renderers(head)
    common = {
        label: (before[label], after[label]) for label in sorted(before.keys() & after.keys())
    }
    return {
        label: names
        for label, names in common.items()
        if len({name.partition("(")[0].strip() for name in names}) > 1
    }


def _map_renderers(run: Run) -> dict[str, str]:
    """Return label -> renderer of the devices of a run, as named by the driver."""
    devices = run.facts.get("devices") or {}
    names = {
        label: (device.get("details") or {}).get("renderer") for label, device in devices.items()
    }
    return {label: str(name) for label, name in names.items() if name}


def explain_missing(head: Run, case: CaseId) -> str | None:
    """Return why a record of the case is missing from `head`, or None for a case outside the plan.

    Without a plan, as for a single file of records, every case is expected.
    """
    if not head.records:
        return "HEAD has no cases"
    plan = head.facts.get("plan") or {}
    if not plan:
        return "HEAD has no plan"
    if not _is_planned(plan, case, head):
        return None
    stopped = "was interrupted" if head.facts.get("interrupted") else "is incomplete"
    return f"it is in HEAD's plan: the run {stopped}"


def _is_planned(plan: Mapping[str, Any], case: CaseId, head: Run) -> bool:
    """Return whether the plan has the case; a field that the plan lacks matches every case."""
    parts: dict[str, Any] = {
        "triangulators": case.name,
        "rasterisers": case.rasteriser,
        "views": vars(case.view),
        "options": case.options.to_json(),
    }
    for name, value in parts.items():
        if isinstance(plan.get(name), list) and value not in plan[name]:
            return False
    # The plan may have an old path of a moved file; HEAD's records have the scene's name.
    scenes = {Path(str(plan.get("scene", case.scene))).name, *(r.id.scene for r in head.records)}
    # If the plan names no device, HEAD's records have the device that was selected.
    devices = plan.get("devices")
    used = [r.id.device_name for r in head.records if r.id.rasteriser == case.rasteriser]
    named = (*used, *(devices if isinstance(devices, list) else ()))
    return case.scene in scenes and (not used or case.device_name in named)


def format_machine(facts: Mapping[str, Any]) -> str:
    """Return the processor, threads and GPUs of a machine, or "" if the processor is unknown."""
    environment = facts.get("environment") or {}
    if not (processor := read_processor(facts)):
        return ""
    text = f"{processor}, {environment.get('threads')} threads"
    gpus = [str(gpu.get("name")) for gpu in environment.get("gpus") or []]
    return ", ".join([text, *gpus])


def machines_differ(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Return whether the machines of both runs are known and different."""
    alike = may_be_same_processor(read_processor(before), read_processor(after))
    old, new = (
        format_machine(facts).removeprefix(read_processor(facts)) for facts in (before, after)
    )
    return bool(format_machine(before) and format_machine(after)) and not (alike and old == new)


def list_changes(base: Run, head: Run) -> list[str]:
    """Return a line for each fact of plan, software and machine that differs between the runs."""
    before, after = _flatten_compared_facts(base.facts), _flatten_compared_facts(head.facts)
    return [
        f"{name} was {_format_value(before[name])}, is {_format_value(value)}"
        for name, value in after.items()
        if None not in (value, before.get(name)) and value != before[name]
    ]


def _format_value(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _flatten_compared_facts(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the compared facts of a run, by names such as "plan: seed"."""
    environment = facts.get("environment") or {}
    machine = {name: environment.get(name) for name in ENVIRONMENT}
    devices = {
        label: {name: (device.get("details") or {}).get(name) for name in ("renderer", "version")}
        for label, device in (facts.get("devices") or {}).items()
    }
    parts = {"plan": facts.get("plan") or {}, "environment": machine, "devices": devices}
    return flatten(parts, ": ")
