"""Match the cases of two runs by their identity.

A case's key will not do: it covers the scene's content, and changed content is to be reported. What
HEAD lacks of its plan is lost; all else was not asked for. What else differs between two runs, of
plan, software and machine, is told.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.errors import IncompatibleRunsError
from harness.metrics.processors import may_be_same, read_processor
from harness.results.record import CaseId, Record
from harness.results.run_folder import Run
from harness.style import flat

ENVIRONMENT = (*("harness", "code", "python", "packages", "kernel", "cpu", "threads", "governor"),)
"""What of a run's environment is compared."""


@dataclass(frozen=True)
class Match:
    """A case with its record in BASE and in HEAD, None where the run has none."""

    id: CaseId
    base: Record | None
    head: Record | None


def match(base: Run, head: Run, *, across_devices: bool) -> list[Match]:
    """Pair the cases of two runs, in HEAD's order, then those that only BASE has.

    across_devices : pair a rasteriser's only device in BASE with its only device in HEAD

    Raises
    ------
    UsageError
        if the runs are of different devices and that was not asked for, or cannot be paired
    """
    renamed = _renamed(base, head, across_devices=across_devices)
    before: dict[CaseId, Record] = {}
    for record in base.records:
        case = record.id
        device = renamed.get((case.rasteriser, case.device_name))
        if device is not None:
            target = next(each.id for each in head.records if each.id.device_name == device)
            case = replace(case, device=target.device, host=target.host)
        before[case] = record
    after = {record.id: record for record in head.records}
    cases = [*after, *(case for case in before if case not in after)]
    return [Match(case, before.get(case), after.get(case)) for case in cases]


def _devices(records: Sequence[Record]) -> dict[str, set[str]]:
    found = defaultdict(set)
    for record in records:
        found[record.id.rasteriser].add(record.id.device_name)
    return found


def _renamed(base: Run, head: Run, *, across_devices: bool) -> dict[tuple[str, str], str]:
    """Return (rasteriser, device in BASE) -> device in HEAD, where these are to be paired."""
    before, after = _devices(base.records), _devices(head.records)
    both = {name: (before[name], after[name]) for name in before.keys() & after.keys()}
    if across_devices:
        others = {name: devices for name, devices in both.items() if devices[0] != devices[1]}
        for name, devices in others.items():
            if max(map(len, devices)) > 1:
                raise IncompatibleRunsError(
                    f"{name} ran on several devices, so it is not clear which to compare "
                    "across; give runs of one device each"
                )
        return {(name, min(then)): min(now) for name, (then, now) in others.items()}
    if both and not any(then & now for then, now in both.values()):
        ran = (", ".join(sorted(set().union(*sides))) for sides in zip(*both.values(), strict=True))
        raise IncompatibleRunsError(
            "BASE ran on {} and HEAD on {}: their figures differ without any change; "
            "add --across-devices to compare them".format(*ran)
        )
    for label, (then, now) in other_hardware(base, head).items():
        raise IncompatibleRunsError(
            f"{label} was '{then}' in BASE and is '{now}' in HEAD: "
            "add --across-devices to compare them"
        )
    return {}


def other_hardware(base: Run, head: Run) -> dict[str, tuple[str, str]]:
    """Return the devices that have one name in both runs and are not the same, with renderers.

    Versions of the driver, which a renderer's name has in brackets, may change.
    """
    then, now = _renderers(base), _renderers(head)
    both = {label: (then[label], now[label]) for label in sorted(then.keys() & now.keys())}
    return {
        label: names
        for label, names in both.items()
        if len({name.partition("(")[0].strip() for name in names}) > 1
    }


def _renderers(run: Run) -> dict[str, str]:
    """Return what the driver calls each device of a run, where it says so."""
    devices = run.facts.get("devices") or {}
    names = {label: (each.get("details") or {}).get("renderer") for label, each in devices.items()}
    return {label: str(name) for label, name in names.items() if name}


def missing_from(head: Run, case: CaseId) -> str | None:
    """Say why a case that `head` holds no record of should be there; None where it need not be.

    Where the plan is not known, as of a single file of records, everything should be there.
    """
    if not head.records:
        return "HEAD holds no cases"
    plan = head.facts.get("plan") or {}
    if not plan:
        return "HEAD does not say what its plan was"
    if not _asks_for(plan, case, head):
        return None
    stopped = "was stopped before its end" if head.facts.get("interrupted") else "is cut short"
    return f"it is in HEAD's plan: the run {stopped}"


def _asks_for(plan: Mapping[str, Any], case: CaseId, head: Run) -> bool:
    """Whether the plan names the case; a part that it lacks names everything."""
    parts: dict[str, Any] = {
        "triangulators": case.name,
        "rasterisers": case.rasteriser,
        "views": vars(case.view),
        "options": case.options.to_json(),
    }
    for name, wanted in parts.items():
        if isinstance(plan.get(name), list) and wanted not in plan[name]:
            return False
    # The scene of a file that was moved has another path in the plan, and its name in the records.
    scenes = {Path(str(plan.get("scene", case.scene))).name, *(r.id.scene for r in head.records)}
    # Where no device is named, HEAD's records tell which was chosen.
    devices = plan.get("devices")
    used = [r.id.device_name for r in head.records if r.id.rasteriser == case.rasteriser]
    named = (*used, *(devices if isinstance(devices, list) else ()))
    return case.scene in scenes and (not used or case.device_name in named)


def machine(facts: Mapping[str, Any]) -> str:
    """Return what tells a machine from others of another kind; "" where the run does not say."""
    environment = facts.get("environment") or {}
    if not (processor := read_processor(facts)):
        return ""
    text = f"{processor}, {environment.get('threads')} threads"
    gpus = [str(gpu.get("name")) for gpu in environment.get("gpus") or []]
    return ", ".join([text, *gpus])


def machines_differ(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Whether both runs say what machine they are of, and it is not the same."""
    alike = may_be_same(read_processor(before), read_processor(after))
    then, now = (machine(facts).removeprefix(read_processor(facts)) for facts in (before, after))
    return bool(machine(before) and machine(after)) and not (alike and then == now)


def changes(base: Run, head: Run) -> list[str]:
    """Return one line for each part of plan, software and machine that both tell and that differs.

    What an older run does not say has not changed.
    """
    before, after = _told(base.facts), _told(head.facts)
    return [
        f"{name} was {_words(before[name])}, is {_words(value)}"
        for name, value in after.items()
        if None not in (value, before.get(name)) and value != before[name]
    ]


def _words(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _told(facts: Mapping[str, Any]) -> dict[str, Any]:
    environment = facts.get("environment") or {}
    machine = {name: environment.get(name) for name in ENVIRONMENT}
    devices = {
        label: {name: (device.get("details") or {}).get(name) for name in ("renderer", "version")}
        for label, device in (facts.get("devices") or {}).items()
    }
    told = {"plan": facts.get("plan") or {}, "environment": machine, "devices": devices}
    return flat(told, ": ")
