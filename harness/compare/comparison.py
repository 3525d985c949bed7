"""Compare two runs: match cases, compare counters and times, decide the verdict."""

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

from harness.compare import times
from harness.compare.matching import (
    Match,
    changes,
    machine,
    machines_differ,
    match,
    missing_from,
    other_hardware,
)
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
from harness.errors import InputError
from harness.machine.git import commit_of
from harness.metrics.processors import find_mixed_processors, format_processors
from harness.metrics.registry import (
    METRICS,
    PREDICTED,
    find_metric,
    list_predictions,
    sort_counters,
)
from harness.results.record import CaseGroup, Record, printable
from harness.results.run_folder import Run, select_latest
from harness.stats.run_quality import state_of


def compare_runs(base: Run, head: Run, settings: Settings | None = None) -> Comparison:
    """Compare `head` with `base`; every case of either run is in the result.

    Raises
    ------
    InputError
        if records of a run are lost, the runs are of different devices and `settings` do not ask
        for that, or a threshold is of a figure that neither run has
    """
    settings = settings or Settings()
    for run in (base, head):
        if run.truncation:
            raise InputError(f"{run.truncation}: measure again, or run --resume {run.path}")
    base, head = select_latest(base), select_latest(head)
    records = (*base.records, *head.records)
    require_known(settings.thresholds, {name for r in records for name in exact_figures(r)})
    matches = match(base, head, across_devices=settings.across_devices)
    elsewhere = _across(matches) or bool(other_hardware(base, head))
    differ = elsewhere or machines_differ(base.facts, head.facts)
    cases = [_counted(each, head, settings) for each in matches]
    cases, drifts = _timed(matches, cases, settings, differ)
    found = Comparison(
        verdict="good",
        base=_facts(base),
        head=_facts(head),
        settings=settings,
        machines_differ=differ,
        cases=tuple(cases),
        totals=totals([case.counters for case in cases if case.status == "compared"]),
        drifts=tuple(drifts),
        notes=tuple(_notes(base, head, differ)),
        changes=tuple(changes(base, head)),
    )
    return replace(found, verdict=_verdict(found))


def no_baseline(path: str, head: Run, settings: Settings) -> Comparison:
    """Return the comparison of a first run, whose baseline at `path` is still to come."""
    head = select_latest(head)
    matches = match(Run(head.path, {}, []), head, across_devices=settings.across_devices)
    return Comparison(
        verdict="no-baseline",
        base=RunFacts(path),
        head=_facts(head),
        settings=settings,
        cases=tuple(CaseChange(found.id, "only-head") for found in matches),
        notes=tuple(head.problems),
    )


def _across(matches: Sequence[Match]) -> bool:
    """Whether any case ran on another device in BASE."""
    return any(m.base.id.device_name != m.head.id.device_name for m in matches if m.base and m.head)


def _counted(found: Match, run: Run, settings: Settings) -> CaseChange:
    """Return the case with its status and, where it can be compared, its counters.

    run : HEAD, which tells what it was to do
    """
    base, head = found.base, found.head
    status, reason = _status(found, run)
    if base is None or head is None or status != "compared":
        return CaseChange(found.id, status, reason)
    before, after = exact_figures(base), exact_figures(head)
    changes = (_change(n, before[n], after[n], settings) for n in after if n in before)
    lost = (counter_name(name) for name in base.counters if name not in head.counters)
    # Of gated counters that BASE has and HEAD does not, nothing can be said.
    gated = (name for name in lost if settings.threshold(name) is not None)
    return CaseChange(found.id, status, reason, tuple(changes), tuple(gated))


def _status(found: Match, run: Run) -> tuple[Status, str]:
    """Say whether a case's records can be compared, and the reason their runs give if not."""
    base, head = found.base, found.head
    if base is None or head is None:
        record = head or base
        assert record is not None  # a match has a record
        missing = missing_from(run, found.id) if head is None else None
        if missing and record.is_ok:
            return "not-done", missing
        told = "" if record.is_ok else f"{record.status}: {_reason(record)}"
        return ("only-head" if base is None else "only-base"), told
    good = base.is_ok, head.is_ok
    if good == (True, False):
        return ("now-failing" if head.status == "failed" else "now-skipped"), _reason(head)
    if good == (False, True):
        return "now-measured", f"BASE: {_reason(base)}"
    if good == (False, False):
        return "not-measured", _reason(head)
    hashes = base.id.scene_hash, head.id.scene_hash
    if all(hashes) and hashes[0] != hashes[1]:
        return "content-changed", f"{hashes[0]} then, {hashes[1]} now"
    before, after = base.polygons, head.polygons
    if before and after and before != after:  # the first runs do not have them
        status: Status = "fewer-polygons" if after < before else "more-polygons"
        return status, f"{before} then, {after} now; {_reason(head)}".rstrip("; ")
    return "compared", ""


def _reason(record: Record) -> str:
    return printable(record.reason or "")


def _timed(
    matches: Sequence[Match], cases: Sequence[CaseChange], settings: Settings, machines_differ: bool
) -> tuple[list[CaseChange], list[Drift]]:
    """Return the cases with their times judged, and the drift of each group timed together."""
    judged = {}
    groups: dict[CaseGroup, dict[int, times.Pair]] = defaultdict(dict)
    for number, (found, case) in enumerate(zip(matches, cases, strict=True)):
        if case.status == "compared" and found.base and found.head:
            counted = [
                c for c in case.counters if find_metric(c.metric).kind in ("counter", "count")
            ]
            same_work = bool(counted) and all(change.exact == "equal" for change in counted)
            pair = times.read_pair(
                found.base, found.head, same_work=same_work, machines_differ=machines_differ
            )
            if isinstance(pair, times.Pair):
                groups[case.id.group][number] = pair
            elif pair is not None:
                judged[number] = pair
    drifts = []
    for group, pairs in groups.items():
        changes, drift = times.compare_group(
            group, list(pairs.values()), settings, machines_differ=machines_differ
        )
        judged |= dict(zip(pairs, changes, strict=True))
        drifts += [] if drift is None else [drift]
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


def _notes(base: Run, head: Run, differ: bool) -> list[str]:
    notes = []
    for name, run in (("BASE", base), ("HEAD", head)):
        told = [*run.problems, *(run.facts.get("warnings") or [])]
        told += state_of(run).words
        told += ["it holds no cases"] * (not run.records)
        told += ["it was stopped before its end"] * bool(run.facts.get("interrupted"))
        notes += [f"{name}: {line}" for line in told]
    if differ:
        notes.append(
            "the runs are of different machines: times are relative to the other cases, or to the "
            "reference draw, of their own run"
        )
    if mixed := find_mixed_processors([base, head]):
        notes.append(
            f"ratios of times of what draws on the processor differ between processors by some per "
            f"cent: {format_processors(mixed)}"
        )
    return notes


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
    counted = record.counters
    found: dict[str, float] = {counter_name(name): counted[name] for name in sort_counters(counted)}
    for name, figure in {**METRICS, **list_predictions()}.items():
        value = figure(record) if figure.exact else None
        if value is not None:
            found[name] = value
    predicted = record.predicted
    features = (name for name in sorted(predicted) if name not in found)
    return found | {f"{PREDICTED}{name}": predicted[name] for name in features}


def counter_name(name: str) -> str:
    """Return what a comparison calls the counter `name`."""
    return name if find_metric(name).kind == "counter" else f"counted_{name}"


def _change(name: str, base: float, head: float, settings: Settings) -> CounterChange:
    exact: Exact = "equal"
    whole = float(base).is_integer() and float(head).is_integer()
    # Sums of square roots may differ in their last digits.
    if base != head and (whole or not math.isclose(base, head, rel_tol=1e-12)):
        less, better = head < base, find_metric(name).better
        exact = "better" if less == (better == "lower") else "worse"
        exact = "changed" if better == "none" else exact
    threshold = settings.threshold(name)
    beyond = threshold is not None and abs(head - base) > threshold * abs(base)
    wrong = exact == "worse" or (exact == "changed" and find_metric(name).is_shared)
    growth = relative(base, head)
    return CounterChange(name, base, head, growth, exact, threshold, beyond and wrong)


def totals(cases: Sequence[Sequence[CounterChange]]) -> tuple[Total, ...]:
    """Sum each figure over the compared cases; ratios, which have no sum, are left out."""
    columns = defaultdict(list)
    for change in chain.from_iterable(cases):
        if find_metric(change.metric).unit != "x":
            columns[change.metric].append(change)
    found = []
    for name, column in columns.items():
        base, head = sum(each.base for each in column), sum(each.head for each in column)
        kinds = Counter(each.exact for each in column)
        affected = len(column) - kinds["equal"]
        told = (len(column), affected, kinds["better"], kinds["worse"])
        found.append(Total(name, find_metric(name).unit, *told, base, head, relative(base, head)))
    return tuple(found)


def relative(base: float, head: float) -> float | None:
    """Return the growth from `base` to `head` relative to `base`; None where that is 0."""
    if base == 0:
        return 0.0 if head == 0 else None
    return head / base - 1
