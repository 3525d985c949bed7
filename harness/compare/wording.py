"""The sentences of a comparison, the same in every output."""

from __future__ import annotations

from collections import Counter

from harness.compare.model import (
    BROKEN,
    STATUS_TEXT,
    CaseChange,
    Comparison,
    CounterChange,
    Status,
    TimeChange,
)

FIRST = ("quads", "bbox_tests", "helper_lanes")
"""Counters that stand for the cost best, the best first."""


def headline(comparison: Comparison) -> str:
    """Return the verdict in one line of plain text: what, by how much, on which device."""
    verdict = comparison.verdict
    if verdict == "no-baseline":
        return (
            f"No baseline yet: {comparison.base.path} holds no run; the "
            f"{count(len(comparison.cases), 'case')} of HEAD can be compared once it is kept as one"
        )
    if verdict == "nothing-comparable":
        return f"Nothing comparable: {_why_nothing(comparison)}"
    if verdict == "regression":
        return f"Regression: {_regression(comparison)}{_loose_ends(comparison)}"
    return f"{_calm(comparison)}{_loose_ends(comparison)}"


def count(number: int, noun: str) -> str:
    """Write `1 case`, `2 cases`."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def percent(change: float) -> str:
    """Write a relative change with a sign and as many digits as matter: `+12.3 %`."""
    size = abs(change) * 100
    digits = 0 if size >= 100 else 1 if size >= 0.1 else 3
    return f"{change * 100:+,.{digits}f} %"


def counter_text(change: CounterChange) -> str:
    """Write `99,275 → 111,496 (+12.3 %)`, or only the value where nothing changed."""
    if change.exact == "equal":
        return figure(change.head)
    growth = "" if change.change is None else f" ({percent(change.change)})"
    return f"{figure(change.base)} → {figure(change.head)}{growth}"


def figure(value: float) -> str:
    """Write a number with as many digits as matter."""
    whole = float(value).is_integer() or abs(value) >= 1000
    return f"{value:,.0f}" if whole else f"{value:,.4g}"


def time_text(change: TimeChange | None) -> str:
    """Write `1.084 [1.05, 1.11]`, the ratio of times with its interval."""
    if change is None or change.ratio is None:
        return ""
    return f"{change.ratio:.3f} [{change.low:.2f}, {change.high:.2f}]"


def case_verdict(comparison: Comparison, case: CaseChange) -> str:
    """Say in a few words what became of a case."""
    if case.status != "compared":
        return STATUS_TEXT[case.status]
    regressed = [change.metric.replace("_", " ") for change in case.regressions()]
    if case.time is not None and case.time.outcome == "regressed":
        regressed.append("time" if comparison.settings.gates_time else "time, not gated")
    if regressed:
        return f"regressed: {', '.join(regressed)}"
    if case.time is not None and case.time.outcome == "inconclusive":
        return "inconclusive"
    kinds = {change.exact for change in case.counters if change.threshold is not None}
    if "worse" in kinds:
        return "worse within its threshold"
    if "better" in kinds or (case.time is not None and case.time.outcome == "improved"):
        return "improved"
    return "unchanged"


def main_counter(case: CaseChange) -> CounterChange | None:
    """Return the regressed counter that stands for the cost best."""
    found = {change.metric: change for change in case.regressions()}
    return next((found[name] for name in (*FIRST, *found) if name in found), None)


def case_detail(case: CaseChange) -> str:
    """Say by how much a compared case regressed: `quads +12.3 % (…), time +8.4 % (…)`."""
    parts = []
    counter, time = main_counter(case), case.time
    if counter is not None:
        growth = "" if counter.change is None else f"{percent(counter.change)} "
        parts.append(f"{growth}{counter.metric} ({figure(counter.base)} → {figure(counter.head)})")
    if time is not None and time.outcome == "regressed" and time.ratio and time.low and time.high:
        parts.append(
            f"{percent(time.ratio - 1)} time (interval {percent(time.low - 1)} to "
            f"{percent(time.high - 1)})"
        )
    return " and ".join(parts)


def _regression(comparison: Comparison) -> str:
    regressed = sorted(comparison.regressed(), key=_severity, reverse=True)
    if not regressed:
        drift = max(comparison.drifted(), key=lambda drift: drift.ratio)
        return (
            f"all {count(drift.cases, 'case')} of {drift.where} together take "
            f"{percent(drift.ratio - 1)} time, which the reference draw does not explain"
        )
    worst = regressed[0]
    detail = case_detail(worst) if worst.status == "compared" else ""
    detail = detail or ": ".join(part for part in (STATUS_TEXT[worst.status], worst.reason) if part)
    more = len(regressed) - 1
    rest = f"; {count(more, 'more case')} regressed" if more else ""
    return f"{worst.name.triangulator} on {worst.name.device}: {detail}, {_view(worst)}{rest}"


def _view(case: CaseChange) -> str:
    return f"in {case.name.where.replace(f' on {case.name.device}', '')}"


def _severity(case: CaseChange) -> tuple[bool, float, float]:
    counter, time = main_counter(case), case.time
    slower = time.ratio if time is not None and time.outcome == "regressed" and time.ratio else 0.0
    growth = 0.0 if counter is None else float("inf") if counter.change is None else counter.change
    return case.status in BROKEN, max(growth, slower - 1), slower


def _calm(comparison: Comparison) -> str:
    """Say what was found where nothing regressed."""
    compared = comparison.compared()
    noisy = [c for c in compared if c.time is not None and c.time.outcome == "inconclusive"]
    better = [c for c in compared if case_verdict(comparison, c) == "improved"]
    devices = ", ".join(sorted({case.name.device for case in compared}))
    total = f"{count(len(compared), 'case')} on {devices}"
    affected = [c for c in compared if any(x.exact in ("worse", "better") for x in c.counters)]
    counters = f"counters differ in {len(affected)}" if affected else "no counter differs"
    timed = [case.time for case in compared if case.time is not None]
    within = f"±{comparison.settings.time_threshold * 100:g} %"
    if not timed:
        times = "times were not compared"
    elif noisy:
        times = f"times of {len(noisy)} are too noisy to say within {within}"
    else:
        times = f"times unchanged within {within}"
        if any(time.outcome != "unchanged" for time in timed):
            times = "no time regressed"
    start = "Inconclusive" if comparison.verdict == "inconclusive" else "No regression"
    improved = f"; {len(better)} improved" if better else ""
    return f"{start}: {total}, {counters}, {times}{improved}"


def _loose_ends(comparison: Comparison) -> str:
    """Count the cases that could not be compared, so that none is dropped silently."""
    numbers = Counter(case.status for case in comparison.cases)
    wording: dict[Status, str] = {
        "only-base": "missing from HEAD",
        "now-skipped": "now skipped",
        "content-changed": "of changed content",
        "only-head": "new",
        "now-measured": "newly measured",
        "more-polygons": "with more polygons",
        "not-measured": "measured in neither run",
    }
    parts = [
        f"{count(numbers[status], 'case')} {text}"
        for status, text in wording.items()
        if numbers[status]
    ]
    return f" ({', '.join(parts)})" if parts else ""


def _why_nothing(comparison: Comparison) -> str:
    if not comparison.cases:
        return "neither run holds a case"
    if comparison.compared():
        return "only times are gated, and no case was timed"
    statuses = Counter(case.status for case in comparison.cases)
    parts = [f"{count(number, 'case')} {_SHORT[status]}" for status, number in statuses.items()]
    return ", ".join(parts)


_SHORT: dict[Status, str] = {**STATUS_TEXT, "content-changed": "of changed content"}
