"""Puts a comparison together: matches cases, judges counters and times, reaches a verdict."""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness.compare import times
from harness.compare.matching import (
    Match,
    environment_changes,
    latest,
    machine,
    match,
    missing_from,
    other_hardware,
    plan_changes,
    printable,
)
from harness.compare.matching import machines_differ as differ
from harness.compare.model import (
    CaseChange,
    Comparison,
    CounterChange,
    Drift,
    Exact,
    RunFacts,
    Settings,
    Status,
    Total,
    Verdict,
    require_known,
)
from harness.errors import UsageError
from harness.figures import groups
from harness.figures.registry import METRICS, PREDICTED, find, in_order, predictions
from harness.figures.run_state import state_of
from harness.machine.environment import commit_of
from harness.stored.folder import Record, Run


def compare_runs(base: Run, head: Run, settings: Settings | None = None) -> Comparison:
    """Compare `head` with `base`; every case of either run is in the result.

    Raises
    ------
    UsageError
        if records of a run are lost, the runs are of different devices and `settings` do not ask
        for that, or a threshold is of a figure that neither run has
    """
    settings = settings or Settings()
    for run in (base, head):
        if run.cut_off:
            raise UsageError(f"{run.cut_off}: measure again, or run --resume {run.path}")
    base, head = latest(base), latest(head)
    records = (*base.records, *head.records)
    require_known(settings.thresholds, {name for r in records for name in exact_figures(r)})
    matches = match(base, head, across_devices=settings.across_devices)
    elsewhere = _across(matches) or bool(other_hardware(base, head))
    machines_differ = elsewhere or differ(base.facts, head.facts)
    cases = [_counted(found, settings, missing=missing_from(head, found.name)) for found in matches]
    cases, drifts = _timed(matches, cases, settings, machines_differ)
    found = Comparison(
        verdict="good",
        base=_facts(base),
        head=_facts(head),
        settings=settings,
        machines_differ=machines_differ,
        cases=tuple(cases),
        totals=totals([case.counters for case in cases if case.status == "compared"]),
        drifts=tuple(drifts),
        notes=(*_notes(base, head, machines_differ), *_pairs_left(matches)),
        changes=(*plan_changes(base, head), *environment_changes(base.facts, head.facts)),
    )
    return replace(found, verdict=_verdict(found))


def no_baseline(path: str, head: Run, settings: Settings) -> Comparison:
    """Return the comparison of a first run, whose baseline at `path` is still to come."""
    head = latest(head)
    matches = match(Run(head.path, {}, []), head, across_devices=settings.across_devices)
    return Comparison(
        verdict="no-baseline",
        base=RunFacts(path),
        head=_facts(head),
        settings=settings,
        cases=tuple(CaseChange(found.name, "only-head") for found in matches),
        notes=tuple(head.problems),
    )


def _across(matches: Sequence[Match]) -> bool:
    """Whether any case ran on another device in BASE."""
    devices = [(m.base.get("device"), m.head.get("device")) for m in matches if m.base and m.head]
    return any(before != after for before, after in devices)


def _counted(found: Match, settings: Settings, *, missing: str | None) -> CaseChange:
    """Return the case with its status and, where it can be compared, its counters.

    missing : why HEAD should have the case, None where it need not
    """
    base, head = found.base, found.head
    status, reason = _status(base, head)
    if head is None and base is not None and base.get("status") == "ok" and missing is not None:
        status, reason = "not-done", missing
    if base is None or head is None or status != "compared":
        return CaseChange(found.name, status, reason)
    before, after = exact_figures(base), exact_figures(head)
    changes = (_change(n, before[n], after[n], settings) for n in after if n in before)
    counted = head.get("counters") or {}
    lost = [counter_name(n) for n in base.get("counters") or {} if n not in counted]
    # Of gated counters that BASE has and HEAD does not, nothing can be said.
    gated = (name for name in lost if settings.threshold(name) is not None)
    return CaseChange(found.name, status, reason, tuple(changes), tuple(gated))


def _status(base: Record | None, head: Record | None) -> tuple[Status, str]:
    """Say whether two records can be compared, and the reason their runs give if not."""
    if base is None or head is None:
        record = head or base or {}
        measured = "" if record.get("status") == "ok" else f"{record.get('status')}: "
        return ("only-head" if base is None else "only-base"), measured + _reason(record)
    good = base.get("status") == "ok", head.get("status") == "ok"
    if good == (True, False):
        return ("now-failing" if head.get("status") == "failed" else "now-skipped"), _reason(head)
    if good == (False, True):
        return "now-measured", f"BASE: {_reason(base)}"
    if good == (False, False):
        return "not-measured", _reason(head)
    hashes = base.get("scene_hash"), head.get("scene_hash")
    if all(hashes) and hashes[0] != hashes[1]:
        return "content-changed", f"{hashes[0]} then, {hashes[1]} now"
    before, after = base.get("polygons"), head.get("polygons")
    if before is not None and after is not None and before != after:
        status: Status = "fewer-polygons" if after < before else "more-polygons"
        return status, f"{before} then, {after} now; {_reason(head)}".rstrip("; ")
    return "compared", ""


def _reason(record: Record) -> str:
    return printable(record.get("reason") or "")


def _timed(
    matches: Sequence[Match], cases: Sequence[CaseChange], settings: Settings, machines_differ: bool
) -> tuple[list[CaseChange], list[Drift]]:
    """Return the cases with their times judged, and the drift of each group timed together."""
    judged = {}
    groups: dict[str, dict[int, times.Pair]] = defaultdict(dict)
    for number, (found, case) in enumerate(zip(matches, cases, strict=True)):
        if case.status == "compared" and found.base and found.head:
            counted = [c for c in case.counters if find(c.metric).kind in ("counter", "count")]
            same_work = bool(counted) and all(change.exact == "equal" for change in counted)
            pair = times.read_pair(
                found.base, found.head, same_work=same_work, machines_differ=machines_differ
            )
            if isinstance(pair, times.Pair):
                groups[case.name.where][number] = pair
            elif pair is not None:
                judged[number] = pair
    drifts = []
    for where, pairs in groups.items():
        changes, drift = times.judge_group(
            where, list(pairs.values()), settings, machines_differ=machines_differ
        )
        judged |= dict(zip(pairs, changes, strict=True))
        drifts.append(drift)
    corrected = dict(zip(judged, times.correct(list(judged.values()), settings), strict=True))
    return [replace(case, time=corrected.get(n)) for n, case in enumerate(cases)], drifts


def _facts(run: Run) -> RunFacts:
    environment = run.facts.get("environment") or {}
    return RunFacts(
        path=str(run.path),
        created=str(run.facts.get("created") or ""),
        commit=commit_of(run.facts),
        harness=str(environment.get("harness") or ""),
        harness_commit=commit_of(run.facts, "git"),
        machine=machine(run.facts),
        cases=len(run.records),
    )


def _notes(base: Run, head: Run, machines_differ: bool) -> list[str]:
    notes = [f"BASE: {problem}" for problem in base.problems]
    notes += [f"HEAD: {problem}" for problem in head.problems]
    for name, run in (("BASE", base), ("HEAD", head)):
        if not run.records:
            notes.append(f"{name} holds no cases")
        if run.facts.get("interrupted"):
            notes.append(f"{name} was stopped before its end")
        notes += [f"{name}: {warning}" for warning in run.facts.get("warnings") or []]
    if machines_differ:
        notes.append(
            "the runs are of different machines: times are relative to the other cases, or to the "
            "reference draw, of their own run"
        )
    for device, kinds in groups.several_processors([base, head]).items():
        notes.append(
            f"{device} draws on the processor, and the runs are of different ones "
            f"({', '.join(kinds)}): ratios of times differ between them by some per cent"
        )
    notes += [
        f"{name}: {line}"
        for name, run in (("BASE", base), ("HEAD", head))
        for line in state_of(run.facts, run.records).words
    ]
    return notes


def _pairs_left(matches: Sequence[Match]) -> list[str]:
    """Say how many pairs a comparison of the same rounds rests on, where it is not all."""
    masks = [
        pair.kept
        for found in matches
        if found.base and found.head
        for pair in [times.read_pair(found.base, found.head, same_work=False)]
        if isinstance(pair, times.Pair) and pair.kept is not None
    ]
    count, left = (sum(map(size, masks)) for size in (len, np.count_nonzero))
    if left == count:
        return []
    return [
        f"{left} of {count} pairs of samples are compared: in the others a draw waited for a core"
    ]


def _verdict(found: Comparison) -> Verdict:
    if found.regressed() or found.drifted():
        return "regression"
    compared = found.compared()
    untimed = all(case.time is None for case in compared)
    if not compared or (untimed and "counters" not in found.settings.gates):
        return "nothing-comparable"
    times_shown = [case.time for case in compared if case.time is not None]
    if found.settings.gates_time and any(t.outcome == "inconclusive" for t in times_shown):
        return "inconclusive"
    return "good"


def exact_figures(record: Record) -> dict[str, float]:
    """Return the record's exact figures: the registered ones, then all else that it counted.

    What somebody's rasteriser counts under the name of a figure that is none of its counters is
    called `counted_...` here, and what a criterion predicts `predicted_...` where no metric does.
    """
    counted = record.get("counters") or {}
    found = {counter_name(name): counted[name] for name in in_order(counted)}
    for name, figure in {**METRICS, **predictions()}.items():
        value = figure(record) if figure.exact else None
        if value is not None:
            found[name] = value
    predicted = record.get("predicted") or {}
    features = (name for name in sorted(predicted) if name not in found)
    return found | {f"{PREDICTED}{name}": predicted[name] for name in features}


def counter_name(name: str) -> str:
    """Return what a comparison calls the counter `name`."""
    return name if find(name).kind == "counter" else f"counted_{name}"


def _change(name: str, base: float, head: float, settings: Settings) -> CounterChange:
    exact: Exact = "equal"
    whole = float(base).is_integer() and float(head).is_integer()
    # Sums of square roots may differ in their last digits.
    if base != head and (whole or not math.isclose(base, head, rel_tol=1e-12)):
        worse_up = {"lower": True, "higher": False}.get(find(name).better)
        exact = (
            "changed" if worse_up is None else "worse" if (head > base) == worse_up else "better"
        )
    threshold = settings.threshold(name)
    beyond = threshold is not None and abs(head - base) > threshold * abs(base)
    wrong = exact == "worse" or (exact == "changed" and find(name).is_shared)
    change = relative(base, head)
    return CounterChange(name, base, head, change, exact, threshold, beyond and wrong)


def totals(cases: Sequence[Sequence[CounterChange]]) -> tuple[Total, ...]:
    """Sum each figure over the compared cases; ratios, which have no sum, are left out."""
    columns = defaultdict(list)
    for changes in cases:
        for change in changes:
            if find(change.metric).adds_up:
                columns[change.metric].append(change)
    return tuple(_total(name, changes) for name, changes in columns.items())


def _total(name: str, changes: Sequence[CounterChange]) -> Total:
    base, head = sum(c.base for c in changes), sum(c.head for c in changes)
    kinds = [change.exact for change in changes]
    better, worse, equal = (kinds.count(kind) for kind in ("better", "worse", "equal"))
    cases = len(changes)
    change = relative(base, head)
    return Total(name, find(name).unit, cases, cases - equal, better, worse, base, head, change)


def relative(base: float, head: float) -> float | None:
    """Return the growth from `base` to `head` relative to `base`; None where that is 0."""
    if base == 0:
        return 0.0 if head == 0 else None
    return head / base - 1
