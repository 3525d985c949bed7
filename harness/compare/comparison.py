"""Compare two runs: match cases, compare counters and times, decide the verdict."""

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

from scipy import stats

from harness.compare import times
from harness.compare.matching import (
    Match,
    Pair,
    explain_missing,
    find_changed_hardware,
    format_machine,
    list_changes,
    machines_differ,
    match_cases,
    read_pair,
)
from harness.compare.model import (
    CaseChange,
    Comparison,
    CounterChange,
    Drift,
    Exact,
    RunOrigin,
    Settings,
    Status,
    TimeChange,
    Total,
    Verdict,
    check_thresholds,
)
from harness.errors import InputError
from harness.machine.git import get_commit
from harness.metrics.groups import find_mixed_processors, format_processors
from harness.metrics.registry import (
    METRICS,
    PREDICTED,
    find_metric,
    list_predictions,
    sort_counters,
)
from harness.metrics.run_quality import get_run_state
from harness.results.record import CaseGroup, Record, make_printable
from harness.results.run_folder import Run, select_latest


def compare_runs(base: Run, head: Run, settings: Settings | None = None) -> Comparison:
    """Compare two runs; the result has every case of either run."""
    settings = settings or Settings()
    for run in (base, head):
        if run.truncation:
            raise InputError(f"{run.truncation}: measure again, or run --resume {run.path}")
    base, head = select_latest(base), select_latest(head)
    records = (*base.records, *head.records)
    check_thresholds(settings.thresholds, {name for r in records for name in read_exact_metrics(r)})
    matches = match_cases(base, head, across_devices=settings.across_devices)
    differ = (
        _has_other_device(matches)
        or bool(find_changed_hardware(base, head))
        or machines_differ(base.facts, head.facts)
    )
    cases = [_compare_counters(match, head, settings) for match in matches]
    cases, drifts = _compare_times(matches, cases, settings, differ)
    comparison = Comparison(
        verdict="good",
        base=_read_origin(base),
        head=_read_origin(head),
        settings=settings,
        machines_differ=differ,
        cases=tuple(cases),
        totals=compute_totals([case.counters for case in cases if case.status == "compared"]),
        drifts=tuple(drifts),
        notes=tuple(_list_notes(base, head, differ)),
        changes=tuple(list_changes(base, head)),
    )
    return replace(comparison, verdict=_decide_verdict(comparison))


def compare_without_baseline(path: str, head: Run, settings: Settings) -> Comparison:
    """Return the comparison of a first run, before a baseline is stored at `path`."""
    head = select_latest(head)
    matches = match_cases(Run(head.path, {}, []), head, across_devices=settings.across_devices)
    return Comparison(
        verdict="no-baseline",
        base=RunOrigin(path),
        head=_read_origin(head),
        settings=settings,
        cases=tuple(CaseChange(match.id, "only-head") for match in matches),
        notes=tuple(head.problems),
    )


def _has_other_device(matches: Sequence[Match]) -> bool:
    return any(m.base.id.device_name != m.head.id.device_name for m in matches if m.base and m.head)


def _compare_counters(match: Match, run: Run, settings: Settings) -> CaseChange:
    """Return the status of a case and, if measured in both runs, the changes of its counters."""
    base, head = match.base, match.head
    status, reason = _find_status(match, run)
    if base is None or head is None or status != "compared":
        return CaseChange(match.id, status, reason)
    before, after = read_exact_metrics(base), read_exact_metrics(head)
    changes = (_compare_values(n, before[n], after[n], settings) for n in after if n in before)
    missing = (name_counter(name) for name in base.counters if name not in head.counters)
    # A gated counter that HEAD lacks cannot be compared, so the case fails.
    gated = (name for name in missing if settings.get_counter_threshold(name) is not None)
    return CaseChange(match.id, status, reason, tuple(changes), tuple(gated))


def _find_status(match: Match, run: Run) -> tuple[Status, str]:
    base, head = match.base, match.head
    if base is None or head is None:
        record = head or base
        assert record is not None  # a match has a record
        missing = explain_missing(run, match.id) if head is None else None
        if missing and record.is_ok:
            return "not-done", missing
        reason = "" if record.is_ok else f"{record.status}: {make_printable(record.reason or '')}"
        return ("only-head" if base is None else "only-base"), reason
    failure = make_printable(head.reason or "")
    if not head.is_ok:
        if not base.is_ok:
            return "not-measured", failure
        return ("now-failing" if head.status == "failed" else "now-skipped"), failure
    if not base.is_ok:
        return "now-measured", f"BASE: {make_printable(base.reason or '')}"
    hashes = base.id.scene_hash, head.id.scene_hash
    if all(hashes) and hashes[0] != hashes[1]:
        return "content-changed", f"{hashes[0]} then, {hashes[1]} now"
    before, after = base.polygons, head.polygons
    if before and after and before != after:  # the oldest runs have no numbers of polygons
        status: Status = "fewer-polygons" if after < before else "more-polygons"
        return status, f"{before} then, {after} now; {failure}".rstrip("; ")
    return "compared", ""


def _compare_times(
    matches: Sequence[Match], cases: Sequence[CaseChange], settings: Settings, machines_differ: bool
) -> tuple[list[CaseChange], list[Drift]]:
    """Return `cases` with their changes of time added, and the drift of each group."""
    changes_by_case = {}
    groups: dict[CaseGroup, dict[int, Pair]] = defaultdict(dict)
    for number, (match, case) in enumerate(zip(matches, cases, strict=True)):
        if case.status == "compared" and match.base and match.head:
            counted = [
                c for c in case.counters if find_metric(c.metric).kind in ("counter", "count")
            ]
            same_work = bool(counted) and all(change.exact == "equal" for change in counted)
            pair = read_pair(
                match.base, match.head, same_work=same_work, machines_differ=machines_differ
            )
            if isinstance(pair, Pair):
                groups[case.id.group][number] = pair
            elif pair is not None:
                changes_by_case[number] = pair
    drifts = []
    for group, pairs in groups.items():
        group_changes, drift = times.compare_group(
            group, list(pairs.values()), settings, machines_differ=machines_differ
        )
        changes_by_case |= dict(zip(pairs, group_changes, strict=True))
        drifts += [] if drift is None else [drift]
    changes = correct_q_values(list(changes_by_case.values()), settings)
    corrected = dict(zip(changes_by_case, changes, strict=True))
    return [replace(case, time=corrected.get(n)) for n, case in enumerate(cases)], drifts


def _read_origin(run: Run) -> RunOrigin:
    environment = run.facts.get("environment") or {}
    return RunOrigin(
        path=str(run.path),
        created=str(run.facts.get("created") or ""),
        commit=get_commit(run.facts),
        harness=str(environment.get("harness") or ""),
        harness_commit=get_commit(run.facts, "git"),
        machine=format_machine(run.facts),
        cases=len(run.records),
    )


def _list_notes(base: Run, head: Run, differ: bool) -> list[str]:
    notes = []
    for name, run in (("BASE", base), ("HEAD", head)):
        lines = [*run.problems, *(run.facts.get("warnings") or [])]
        lines += get_run_state(run).warnings
        lines += ["no cases"] * (not run.records)
        lines += ["interrupted before the end"] * bool(run.facts.get("interrupted"))
        notes += [f"{name}: {line}" for line in lines]
    if differ:
        notes.append(
            "different machines: times are relative to the other cases or to the reference draw of "
            "the same run"
        )
    if mixed := find_mixed_processors([base, head]):
        notes.append(
            "time ratios of software devices differ by some per cent between processors: "
            f"{format_processors(mixed)}"
        )
    return notes


def _decide_verdict(comparison: Comparison) -> Verdict:
    if comparison.list_regressed_cases() or comparison.list_regressed_drifts():
        return "regression"
    compared = comparison.list_compared()
    untimed = all(case.time is None for case in compared)
    if not compared or (untimed and "counters" not in comparison.settings.gates):
        return "nothing-comparable"
    times_shown = [case.time for case in compared if case.time is not None]
    if comparison.settings.gates_time and any(t.outcome == "inconclusive" for t in times_shown):
        return "inconclusive"
    return "good"


def read_exact_metrics(record: Record) -> dict[str, float]:
    """Return the exact metrics of a record: counters, metrics, then predictions."""
    counters = record.counters
    values: dict[str, float] = {
        name_counter(name): counters[name] for name in sort_counters(counters)
    }
    for name, metric in {**METRICS, **list_predictions()}.items():
        value = metric(record) if metric.exact else None
        if value is not None:
            values[name] = value
    predicted = record.predicted
    features = (name for name in sorted(predicted) if name not in values)
    return values | {f"{PREDICTED}{name}": predicted[name] for name in features}


def name_counter(name: str) -> str:
    """Return a counter's name in a comparison: `counted_NAME` if another metric is called NAME."""
    return name if find_metric(name).kind == "counter" else f"counted_{name}"


def _compare_values(name: str, base: float, head: float, settings: Settings) -> CounterChange:
    """Return the change of an exact metric, with the gate's decision."""
    exact: Exact = "equal"
    are_integers = float(base).is_integer() and float(head).is_integer()
    # Sums of square roots may differ in their last digits, which is no change of the triangles.
    if base != head and (are_integers or not math.isclose(base, head, rel_tol=1e-12)):
        decreased, better = head < base, find_metric(name).better
        exact = "better" if decreased == (better == "lower") else "worse"
        exact = "changed" if better == "none" else exact
    threshold = settings.get_counter_threshold(name)
    exceeds = threshold is not None and abs(head - base) > threshold * abs(base)
    is_wrong = exact == "worse" or (exact == "changed" and find_metric(name).is_shared)
    growth = compute_growth(base, head)
    return CounterChange(name, base, head, growth, exact, threshold, exceeds and is_wrong)


def compute_totals(cases: Sequence[Sequence[CounterChange]]) -> tuple[Total, ...]:
    """Return the sums of each metric over the compared cases; ratios have no sum."""
    columns = defaultdict(list)
    for change in chain.from_iterable(cases):
        if find_metric(change.metric).unit != "x":
            columns[change.metric].append(change)
    totals = []
    for name, column in columns.items():
        base, head = sum(change.base for change in column), sum(change.head for change in column)
        kinds = Counter(change.exact for change in column)
        affected = len(column) - kinds["equal"]
        counts = (len(column), affected, kinds["better"], kinds["worse"])
        totals.append(
            Total(name, find_metric(name).unit, *counts, base, head, compute_growth(base, head))
        )
    return tuple(totals)


def compute_growth(base: float, head: float) -> float | None:
    """Return the growth relative to `base`, or None if only `base` is 0."""
    if base == 0:
        return 0.0 if head == 0 else None
    return head / base - 1


def correct_q_values(changes: Sequence[TimeChange], settings: Settings) -> list[TimeChange]:
    """Correct q-values for the number of cases; a change with a high q-value is inconclusive."""
    p_values = [change.q_value for change in changes if change.q_value is not None]
    if not p_values:
        return list(changes)
    q_values = iter(stats.false_discovery_control(p_values, method="bh").tolist())
    corrected = []
    for change in changes:
        if change.q_value is not None:
            change = replace(change, q_value=(q_value := next(q_values)))
            limit = times.MAX_ROUNDS_Q if change.against == "rounds" else 1 - settings.confidence
            if change.outcome in ("regressed", "improved") and q_value > limit:
                reason = (
                    f"not significant after correction for the number of cases (q = {q_value:.2g})"
                )
                change = replace(change, outcome="inconclusive", reason=reason)
        corrected.append(change)
    return corrected
