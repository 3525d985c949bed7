"""Match the cases of two runs by identity, and read the times of both.

A case's key is not used: it includes the scene's content, whose change is to be reported.
"""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.compare.model import TimeChange
from harness.errors import IncompatibleRunsError
from harness.metrics import run_quality
from harness.metrics.groups import may_be_same_processor, read_processor
from harness.results.record import CaseId, Record, Time
from harness.results.run_folder import Run
from harness.style import flatten

ENVIRONMENT = "harness", "code", "python", "packages", "kernel", "cpu", "threads", "governor"

QUANTILE = 0.1  # excludes samples that other programs lengthened; steadier than the minimum

Samples = NDArray[np.float64]

Parts = tuple[Sequence[int] | None, Sequence[int] | None]
"""Numbers of rounds in each epoch and in each process, if known."""

MIN_ROUNDS = 8  # minimum number of samples of a case that both runs must have


@dataclass(frozen=True)
class Match:
    """A case with the records in BASE and HEAD, None for a run without a record."""

    id: CaseId
    base: Record | None
    head: Record | None


def match_cases(base: Run, head: Run, *, across_devices: bool) -> list[Match]:
    """Pair the cases of two runs, in HEAD's order, then the cases of BASE alone.

    across_devices : pair a rasteriser's only device in BASE with its only device in HEAD
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
    """Return label -> both renderers of devices that differ in more than the driver's version."""
    before, after = _map_renderers(base), _map_renderers(head)
    common = {
        label: (before[label], after[label]) for label in sorted(before.keys() & after.keys())
    }
    return {
        label: names
        for label, names in common.items()
        if len({_remove_driver_version(name) for name in names}) > 1
    }


def _remove_driver_version(renderer: str) -> str:
    """Return a renderer's name up to the parenthesis of its driver; "Intel(R)" has none."""
    return re.sub(r"\((R|TM|C)\)", "", renderer).partition(" (")[0].strip()


def _map_renderers(run: Run) -> dict[str, str]:
    devices = run.facts.get("devices") or {}
    names = {
        label: (device.get("details") or {}).get("renderer") for label, device in devices.items()
    }
    return {label: str(name) for label, name in names.items() if name}


def explain_missing(head: Run, case: CaseId) -> str | None:
    """Return why `head` has no record of the case, or None for a case outside the plan."""
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
    """Return the processor, threads and GPUs, or "" if the processor is unknown."""
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
    """Return a line for each fact of plan, software and machine that differs."""

    def format_value(value: Any) -> str:
        return ", ".join(map(str, value)) if isinstance(value, list) else str(value)

    before, after = _flatten_compared_facts(base.facts), _flatten_compared_facts(head.facts)
    return [
        f"{name} was {format_value(before[name])}, is {format_value(value)}"
        for name, value in after.items()
        if None not in (value, before.get(name)) and value != before[name]
    ]


def _flatten_compared_facts(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the compared facts of a run, by names such as "plan: seed"."""
    environment = facts.get("environment") or {}
    machine = {name: environment.get(name) for name in ENVIRONMENT}
    devices = {
        label: {name: (device.get("details") or {}).get(name) for name in ("renderer", "version")}
        for label, device in (facts.get("devices") or {}).items()
    }
    parts = {"plan": facts.get("plan") or {}, "environment": machine, "devices": devices}
    return flatten(parts)


@dataclass(frozen=True)
class Pair:
    """Times of one case in both runs: seconds of one draw in each round, (r,) each.

    reference : times of the reference draw in the same rounds, or None if a run has none
    same_work : True if all counters are equal in both runs
    polygons : number of polygons drawn, equal in both runs; 0 if unknown
    same_drawing : True if both versions have the same triangles, which were timed once
    quiet : (r,) True for the common rounds that the ratio uses, or None for all
    obstacle : why the machine's state forbids a comparison of separate runs, or ""
    """

    base: Samples
    head: Samples
    reference: tuple[Samples, Samples] | None
    same_work: bool
    polygons: int = 0
    same_rounds: bool = False
    round_group: str = ""
    same_drawing: bool = False
    parts: Parts = (None, None)
    quiet: NDArray[np.bool_] | None = None
    obstacle: str = ""

    @cached_property
    def log_ratio(self) -> float:
        """Log of HEAD's time over BASE's."""
        return compute_log_ratio(self.base, self.head)


def read_pair(
    base: Record, head: Record, *, same_work: bool, machines_differ: bool = False
) -> Pair | TimeChange | None:
    """Return a case's times in both runs, or None if neither run timed the case.

    Times that cannot be compared give an inconclusive change.
    """
    if base.time is None and head.time is None:
        return None
    before, after = base.time or Time(), head.time or Time()
    first, second = (select_positive(time.samples_s) for time in (before, after))
    reason = ""
    if not len(first) or not len(second):
        reason = f"{'HEAD' if len(first) else 'BASE'} was not timed"
    elif before.timer != after.timer:
        reason = f"timed by {before.timer} clock in BASE, by {after.timer} in HEAD"
    elif min(len(first), len(second)) < MIN_ROUNDS:
        reason = f"too few samples ({len(first)} and {len(second)}, minimum {MIN_ROUNDS})"
    if reason:
        return TimeChange("inconclusive", reason, **summarise_samples(first, second))
    pair = Pair(first, second, None, same_work, polygons=head.polygons)
    references = (select_positive(before.reference_s), select_positive(after.reference_s))
    if min(map(len, references)) < MIN_ROUNDS:
        return pair
    # A missing sample would shift the following samples to other rounds.
    complete = len(first) == len(before.samples_s) and len(second) == len(after.samples_s)
    if complete and before.is_paired_with(after):
        # A coarse timer may give equal samples by chance, so the sums of the criteria and the
        # counters must be equal as well.
        same_counts = (base.predicted, base.counters) == (head.predicted, head.counters)
        return replace(
            pair,
            reference=references,
            same_rounds=True,
            round_group=after.round_group,
            same_drawing=same_counts and before == after,
            parts=(after.epochs or None, after.processes or None),
            quiet=run_quality.select_rounds(before, after),
        )
    obstacle = run_quality.explain_incomparable(before, after, machines_differ=machines_differ)
    return replace(pair, reference=references, obstacle=obstacle)


def select_positive(values: Sequence[Any]) -> Samples:
    """Return the finite positive numbers among `values`, (n,)."""
    numbers = np.array([v for v in values if isinstance(v, int | float)], np.float64)
    return numbers[np.isfinite(numbers) & (numbers > 0)]


def compute_low_quantile(samples_s: Sequence[Any]) -> float | None:
    """Return the low quantile of a record's samples, or None if there are none."""
    samples = select_positive(samples_s)
    return float(np.quantile(samples, QUANTILE)) if len(samples) else None


def compute_log_ratio(base: Samples, head: Samples) -> float:
    """Return the log of HEAD's low quantile over BASE's."""
    return float(np.log(np.quantile(head, QUANTILE) / np.quantile(base, QUANTILE)))


def summarise_samples(base: Samples, head: Samples) -> dict[str, Any]:
    """Return medians and numbers of rounds by their names in `TimeChange`."""
    samples = {"base": base, "head": head}
    medians = {f"{k}_median_s": float(np.median(v)) if len(v) else None for k, v in samples.items()}
    return medians | {f"{name}_rounds": len(values) for name, values in samples.items()}
