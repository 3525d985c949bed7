"""Finds for each case of one run the same case of the other, by what it means.

A case's key will not do: it covers the scene's content, and changed content is to be reported. What
HEAD lacks of its plan is lost; all else was not asked for. What else differs between two runs, of
plan, software and machine, is told.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

from harness.compare.model import CaseName
from harness.errors import UsageError
from harness.figures.groups import group_of, groups, time_ratio, without_twins
from harness.figures.intervals import UNDECIDED
from harness.machine.environment import label_of, same
from harness.stored.folder import Record, Run
from harness.stored.schema import USUAL_OPTIONS, flat

ENVIRONMENT = ("harness", "code", "python", "kernel", "cpu", "threads", "governor")
"""What of a run's environment is compared."""


@dataclass(frozen=True)
class Match:
    """A case with its record in BASE and in HEAD, None where the run has none."""

    name: CaseName
    base: Record | None
    head: Record | None


def case_name(record: Record) -> CaseName:
    """Return what the record's case means; fields that older runs lack get their usual value."""
    options = {**USUAL_OPTIONS, **(record.get("options") or {})}
    return CaseName(
        scene=printable(record.get("scene", "?")),
        triangulator=printable(record.get("triangulator", "?")),
        rasteriser=printable(record.get("rasteriser", "?")),
        device=printable(record.get("device", "?")),
        resolution=int(record.get("resolution") or 0),
        rotation=float(record.get("rotation") or 0.0),
        fit=str(record.get("fit") or "box"),
        options=tuple(sorted(options.items())),
    )


def latest(run: Run) -> Run:
    """Return the run with one record a case, and a problem for each that is left out.

    A run that was resumed by force may hold two contents of a scene.
    """
    problems = list(run.problems)
    found: dict[CaseName, Record] = {}
    for record in run.records:
        name = case_name(record)
        if name in found:
            problems.append(f"{name.triangulator}, {name.where}: measured twice; the later counts")
            del found[name]
        found[name] = record
    return replace(run, records=list(found.values()), problems=problems)


def printable(text: object) -> str:
    """Write any text in one line that neither a terminal nor XML takes for more than text."""
    line = " ".join(str(text).split())
    return "".join(sign if sign.isprintable() else "\ufffd" for sign in line)


def match(base: Run, head: Run, *, across_devices: bool) -> list[Match]:
    """Pair the cases of two runs, in HEAD's order, then those that only BASE has.

    across_devices : pair a rasteriser's only device in BASE with its only device in HEAD

    Raises
    ------
    UsageError
        if the runs are of different devices and that was not asked for, or cannot be paired
    """
    if across_devices:
        renamed = _renamed(base, head)
    else:
        _refuse_other_devices(base, head)
        renamed = {}
    before: dict[CaseName, Record] = {}
    for record in base.records:
        name = case_name(record)
        device = renamed.get((name.rasteriser, name.device), name.device)
        before[case_name({**record, "device": device})] = record
    after = {case_name(record): record for record in head.records}
    names = [*after, *(name for name in before if name not in after)]
    return [Match(name, before.get(name), after.get(name)) for name in names]


def _devices(records: Sequence[Record]) -> dict[str, set[str]]:
    found = defaultdict(set)
    for record in records:
        found[str(record.get("rasteriser", "?"))].add(str(record.get("device", "?")))
    return found


def _renamed(base: Run, head: Run) -> dict[tuple[str, str], str]:
    """Return (rasteriser, device in BASE) -> device in HEAD."""
    before, after = _devices(base.records), _devices(head.records)
    renamed = {}
    for rasteriser in before.keys() & after.keys():
        if before[rasteriser] == after[rasteriser]:
            continue
        if len(before[rasteriser]) > 1 or len(after[rasteriser]) > 1:
            raise UsageError(
                f"{rasteriser} ran on several devices, so it is not clear which to compare "
                "across; give runs of one device each"
            )
        renamed[rasteriser, next(iter(before[rasteriser]))] = next(iter(after[rasteriser]))
    return renamed


def _refuse_other_devices(base: Run, head: Run) -> None:
    before, after = _devices(base.records), _devices(head.records)
    shared = before.keys() & after.keys()
    if shared and not any(before[name] & after[name] for name in shared):
        raise UsageError(
            f"BASE ran on {_listed(before, shared)} and HEAD on {_listed(after, shared)}: "
            "their figures differ without any change; add --across-devices to compare them"
        )
    for label, (then, now) in other_hardware(base, head).items():
        raise UsageError(
            f"{label} was '{then}' in BASE and is '{now}' in HEAD: "
            "add --across-devices to compare them"
        )


def other_hardware(base: Run, head: Run) -> dict[str, tuple[str, str]]:
    """Return the devices that have one name in both runs and are not the same, with renderers."""
    labels = (base.facts.get("devices") or {}).keys() & (head.facts.get("devices") or {}).keys()
    names = {label: (renderer(base.facts, label), renderer(head.facts, label)) for label in labels}
    return {
        label: (then, now)
        for label, (then, now) in sorted(names.items())
        if then and now and hardware(then) != hardware(now)
    }


def _listed(devices: dict[str, set[str]], rasterisers: set[str]) -> str:
    return ", ".join(sorted(set().union(*(devices[name] for name in rasterisers))))


def renderer(facts: dict[str, Any], label: str) -> str:
    """Return what the driver calls the device `label` of a run, "" if the run does not say."""
    details = ((facts.get("devices") or {}).get(label) or {}).get("details") or {}
    return str(details.get("renderer") or "")


def hardware(name: str) -> str:
    """Return a renderer's name without the versions of its driver, which may change."""
    return name.partition("(")[0].strip()


def missing_from(head: Run, case: CaseName) -> str | None:
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


def _asks_for(plan: Mapping[str, Any], case: CaseName, head: Run) -> bool:
    """Whether the plan names the case; a part that it lacks names everything."""
    view = {"resolution": case.resolution, "rotation": case.rotation, "fit": case.fit}
    parts: tuple[tuple[str, Any, dict[str, Any]], ...] = (
        ("triangulators", case.triangulator, {}),
        ("rasterisers", case.rasteriser, {}),
        ("views", view, {"rotation": 0.0, "fit": "box"}),
        ("options", dict(case.options), USUAL_OPTIONS),
    )
    for name, wanted, usual in parts:
        named = plan.get(name)
        if isinstance(named, list) and wanted not in [
            {**usual, **each} if isinstance(each, Mapping) else each for each in named
        ]:
            return False
    scenes = {str(record.get("scene")) for record in head.records}
    if case.scene not in scenes and case.scene != Path(str(plan.get("scene", case.scene))).name:
        return False
    # Where no device is named, HEAD's records tell which was chosen.
    devices = plan.get("devices")
    used = [r.get("device") for r in head.records if r.get("rasteriser") == case.rasteriser]
    return not used or case.device in (*used, *(devices if isinstance(devices, list) else ()))


def machine(facts: Mapping[str, Any]) -> str:
    """Return what tells a machine from others of another kind; "" where the run does not say."""
    environment = facts.get("environment") or {}
    if not (processor := label_of(facts)):
        return ""
    text = f"{processor}, {environment.get('threads')} threads"
    gpus = [str(gpu.get("name")) for gpu in environment.get("gpus") or []]
    return ", ".join([text, *gpus])


def machines_differ(before: Mapping[str, Any], after: Mapping[str, Any]) -> bool:
    """Whether both runs say what machine they are of, and it is not the same."""
    known = machine(before) and machine(after)
    alike = same(label_of(before), label_of(after))
    rest = [machine(facts).removeprefix(label_of(facts)) for facts in (before, after)]
    return bool(known) and not (alike and rest[0] == rest[1])


def plan_changes(base: Run, head: Run) -> list[str]:
    """Return one line for each part of the plan that differs."""
    before, after = base.facts.get("plan") or {}, head.facts.get("plan") or {}
    if not before or not after:
        return []
    return _changes("plan", flat(before), flat(after))


def environment_changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Return one line for each known fact about software or machine that differs."""
    return _changes("environment", _facts(before), _facts(after))


def _facts(facts: Mapping[str, Any]) -> dict[str, Any]:
    environment = facts.get("environment") or {}
    found = {name: environment.get(name) for name in ENVIRONMENT}
    found |= environment.get("packages") or {}
    for label, device in (facts.get("devices") or {}).items():
        details = (device or {}).get("details") or {}
        found |= {f"{label}: {key}": details.get(key) for key in ("renderer", "version")}
    return {name: value for name, value in found.items() if value is not None}


def _changes(kind: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Compare what both know: what an older run does not say has not changed."""
    return [
        f"{kind}: {name} was {_short(before[name])}, is {_short(after[name])}"
        for name in after
        if name in before and before[name] != after[name]
    ]


def _short(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_short(item) for item in value) or "none"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}={_short(item)}" for key, item in value.items()) + "}"
    return str(value)


def repeat(
    first: Sequence[Record], second: Sequence[Record]
) -> tuple[int, list[str], dict[tuple[str, str], tuple[int, int, int, int]]]:
    """Compare two runs' counters case by case, and their verdicts pair by pair.

    Pairs are of triangulations of the same polygons, on one device in one view; two names of one
    triangulation are no pair.

    Returns how many cases both counted; the keys of those with a counter that differs; and for each
    (rasteriser, device) how many pairs were timed together in both runs, have the same verdict in
    both (faster, slower, or no difference shown), are decided in both, and of these alike.
    """
    others = {record["key"]: record for record in second if record["status"] == "ok"}
    common = [r for r in first if r["status"] == "ok" and r["key"] in others]
    unequal = [r["key"] for r in common if r["counters"] != others[r["key"]]["counters"]]
    found = {}
    for place in dict.fromkeys((r["rasteriser"], r["device"]) for r in common):
        here = [r for r in common if (r["rasteriser"], r["device"]) == place]
        one, other = _verdicts(here), _verdicts([others[record["key"]] for record in here])
        if pairs := one.keys() & other.keys():
            decided = [pair for pair in pairs if UNDECIDED not in (one[pair], other[pair])]
            same, agreeing = (
                sum(one[pair] == other[pair] for pair in some) for some in (pairs, decided)
            )
            found[place] = (len(pairs), same, len(decided), agreeing)
    return len(common), unequal, found


def _verdicts(records: Sequence[Record]) -> dict[tuple[object, ...], str]:
    found: dict[tuple[object, ...], str] = {}
    for members in groups(records):
        ordered = sorted(members, key=lambda record: str(record["triangulator"]))
        for one, other in combinations(without_twins(ordered), 2):
            ratio = time_ratio(one, other)
            if ratio is not None:
                names = (one["triangulator"], other["triangulator"])
                found[(*group_of(one), *names)] = ratio.verdict
    return found
