"""The sentences of a comparison and the cells of its tables, the same in every output."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from harness.compare.model import (
    BROKEN,
    FIRST,
    MISSING,
    STATUS_TEXT,
    CaseChange,
    Comparison,
    CounterChange,
    Drift,
    TimeChange,
    Total,
)
from harness.figures.counters import CYCLES
from harness.figures.registry import find
from harness.style import count, figure, percent, step

if TYPE_CHECKING:
    from harness.compare.polygons import Grown

NOT_GATED = "not gated"
"""What is shown and does not decide the exit code is always called so, and never regressed."""


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


def counter_text(change: CounterChange) -> str:
    """Write `99,275 → 111,496 (+12.3 %)`, or only the value where nothing changed."""
    return figure(change.head) if change.exact == "equal" else step(change.base, change.head)


def grown_text(grown: Grown) -> str:
    """Write `polygon 12 (9 vertices) of mine:cut, city 64 px: helper lanes 12 → 31 (+158 %)`."""
    return (
        f"polygon {grown.polygon} ({count(grown.vertices, 'vertex', 'vertices')}) of {grown.case}: "
        f"{spaced([grown.metric])} {step(grown.base, grown.head)}"
    )


def time_text(change: TimeChange | None) -> str:
    """Write `1.084 (1.052-1.113)`, the ratio of times with its interval."""
    if change is None or change.ratio is None:
        return ""
    return f"{change.ratio:.3f} ({change.low:.3f}-{change.high:.3f})"


def case_verdict(comparison: Comparison, case: CaseChange) -> str:
    """Say in a few words what became of a case."""
    if case.status != "compared":
        return STATUS_TEXT[case.status][0]
    verdict = _gated_verdict(comparison, case)
    aside = ungated(comparison, case)
    return f"{verdict} ({NOT_GATED}: {', '.join(aside)})" if aside else verdict


def _gated_verdict(comparison: Comparison, case: CaseChange) -> str:
    """Say what became of that which decides the exit code."""
    time = case.time if comparison.settings.gates_time else None
    parts = []
    if case.lost:
        parts.append(f"no longer counted: {spaced(case.lost)}")
    changed = [change.metric for change in case.regressions() if change.exact == "changed"]
    if changed:
        parts.append(f"covers other pixels: {spaced(changed)}")
    regressed = in_order(c.metric for c in case.regressions() if c.exact == "worse")
    regressed += ["time"] * (time is not None and time.outcome == "regressed")
    if regressed:
        parts.insert(0, f"regressed: {spaced(regressed)}")
    if parts:
        return "; ".join(parts)
    if time is not None and time.outcome == "inconclusive":
        return "inconclusive"
    kinds = {change.exact for change in case.counters if change.threshold is not None}
    if kinds & {"worse", "changed"}:
        return "worse within its threshold"
    if "better" in kinds or (time is not None and time.outcome == "improved"):
        return "improved"
    return "unchanged"


def ungated(comparison: Comparison, case: CaseChange) -> list[str]:
    """Say in a word or two each what differs and does not decide the exit code."""
    found = []
    if "counters" not in comparison.settings.gates:
        kinds = {c.exact for c in case.counters if find(c.metric).is_cost} - {"equal"}
        found += [f"counters {'worse' if 'worse' in kinds else 'differ'}"] * bool(kinds)
    if case.time is not None and not comparison.settings.gates_time:
        words = {"regressed": "slower", "improved": "faster", "inconclusive": "time too noisy"}
        found += [words[case.time.outcome]] if case.time.outcome in words else []
    return found


def spaced(names: Iterable[str]) -> str:
    """Return names of figures as words, with commas between."""
    return ", ".join(name.replace("_", " ") for name in names)


def in_order(names: Iterable[str]) -> list[str]:
    """Return the counters `names` once each, those first that stand for the cost best."""
    found = list(dict.fromkeys(names))
    return [name for name in FIRST if name in found] + [n for n in found if n not in FIRST]


def main_counter(case: CaseChange) -> CounterChange | None:
    """Return the regressed counter that stands for the cost best."""
    found = {change.metric: change for change in case.regressions()}
    return next((found[name] for name in in_order(found)), None)


def case_detail(comparison: Comparison, case: CaseChange) -> str:
    """Say by how much a compared case regressed: `quads +12.3 % (…), time +8.4 % (…)`."""
    parts = []
    if case.lost:
        parts.append(f"{spaced(case.lost)} no longer counted")
    counter = main_counter(case)
    time = case.time if comparison.settings.gates_time else None
    if counter is not None:
        growth = "" if counter.change is None else f"{percent(counter.change)} "
        parts.append(
            f"{growth}{spaced([counter.metric])} ({figure(counter.base)} → {figure(counter.head)})"
        )
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
            f"{percent(drift.ratio - 1)} time, measured in the same rounds"
        )
    worst = regressed[0]
    detail = case_detail(comparison, worst) if worst.status == "compared" else ""
    said = (STATUS_TEXT[worst.status][0], worst.reason)
    detail = detail or ": ".join(filter(None, said))
    more = len(regressed) - 1
    rest = f"; {count(more, 'more case')} regressed" if more else ""
    name = worst.name
    view = name.where.replace(f" on {name.device}", "")
    return f"{name.triangulator} on {name.device}: {detail}, in {view}{rest}"


def _severity(case: CaseChange) -> tuple[bool, float, float]:
    counter, time = main_counter(case), case.time
    slower = time.ratio if time is not None and time.outcome == "regressed" and time.ratio else 0.0
    growth = 0.0
    if counter is not None:
        growth = float("inf") if counter.change is None else abs(counter.change)
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
    if "counters" not in comparison.settings.gates:
        counters += f" ({NOT_GATED})"
    timed = [case.time for case in compared if case.time is not None]
    if not timed:
        cycles = any(_find(case, CYCLES) for case in compared)
        times = "cycles are their times" if cycles else "times were not compared"
    elif not comparison.settings.gates_time:
        times = f"times are {NOT_GATED}"
    elif noisy:
        times = f"times of {len(noisy)} are too noisy to say within {within(comparison)}"
    else:
        times = f"times unchanged within {within(comparison)}"
        if any(time.against == "peers" for time in timed):
            times = f"times beside each other unchanged within {within(comparison)}"
        if any(time.outcome != "unchanged" for time in timed):
            times = "no time regressed"
    start = "Inconclusive" if comparison.verdict == "inconclusive" else "No regression"
    improved = f"; {len(better)} improved" if better else ""
    return f"{start}: {total}, {counters}, {times}{_aside(comparison)}{improved}"


def _aside(comparison: Comparison) -> str:
    """Say by how much all cases of a group became slower or faster where that is not gated."""
    found = [
        drift
        for drift in comparison.drifts
        if drift.outcome in ("regressed", "improved") and drift not in comparison.drifted()
    ]
    if not found:
        return ""
    drift = max(found, key=lambda drift: abs(drift.ratio - 1))
    return f"; all cases together took {percent(drift.ratio - 1)} time ({NOT_GATED})"


def within(comparison: Comparison) -> str:
    """Write the threshold of times, `±5 %`; several where some were timed in the same rounds."""
    times = [case.time for case in comparison.cases if case.time is not None]
    found = sorted({time.threshold for time in times if time.threshold is not None})
    found = found or [comparison.settings.time_threshold_of(paired=False)]
    return " or ".join(f"±{threshold * 100:g} %" for threshold in found)


def _loose_ends(comparison: Comparison) -> str:
    """Count the cases that could not be compared, so that none is dropped silently."""
    numbers = Counter(case.status for case in comparison.cases)
    parts = [
        f"{count(numbers[status], 'case')} {text}"
        for status, (_, text) in STATUS_TEXT.items()
        if text and numbers[status]
    ]
    return f" ({', '.join(parts)})" if parts else ""


def _why_nothing(comparison: Comparison) -> str:
    if not comparison.cases:
        return "neither run holds a case"
    if comparison.compared():
        return "only times are gated, and no case was timed"
    statuses = Counter(case.status for case in comparison.cases)
    text = {status: both[status == "content-changed"] for status, both in STATUS_TEXT.items()}
    return ", ".join(f"{count(number, 'case')} {text[each]}" for each, number in statuses.items())


Kind = str
"""`bad`, `good`, `unsure` or `plain`: how a row is to stand out."""

PLAIN = ("triangles", "fragments", "hits", "samples_passed", "t_junctions", "coverage_error")
"""Counters that get a column only where they differ."""

TOTALS_HEADING = ("counter", "affected", "better", "worse", "BASE", "HEAD", "change")


@dataclass(frozen=True)
class Row:
    """One case of a table, its cells in the order of `Group.heading`."""

    cells: tuple[str, ...]
    kind: Kind
    affected: bool


@dataclass(frozen=True)
class Group:
    """The cases that differ in their triangulator alone.

    drift : one line on what they did together; "" where nothing was timed
    drifted : whether that makes the gate fail
    """

    title: str
    heading: tuple[str, ...]
    rows: tuple[Row, ...]
    drift: str
    drifted: bool


def groups(comparison: Comparison, counters: int = len(FIRST)) -> list[Group]:
    """Return the cases as one table for each scene, view, rasteriser and device.

    counters : most counters to show, so that a narrow terminal can show the rest
    """
    titles = dict.fromkeys(case.name.where for case in comparison.cases)
    drifts = {drift.where: drift for drift in comparison.drifts}
    return [_group(comparison, title, drifts.get(title), counters) for title in titles]


def _group(comparison: Comparison, title: str, drift: Drift | None, counters: int) -> Group:
    cases = [case for case in comparison.cases if case.name.where == title]
    shown = _shown(cases)[:counters]
    timed = any(case.time is not None for case in cases)
    heading = ("triangulator", *(name.replace("_", " ") for name in shown))
    heading += ("time vs BASE",) * timed + ("verdict",)
    ordered = sorted(cases, key=lambda case: ORDER.index(kind(comparison, case)))
    return Group(
        title,
        heading,
        tuple(_row(comparison, case, shown, timed) for case in ordered),
        "" if drift is None else drift_text(comparison, drift),
        drift in comparison.drifted(),
    )


def _shown(cases: Sequence[CaseChange]) -> list[str]:
    """Return the counters worth a column, first those that regressed and those that differ."""
    changes = [change for case in cases for change in case.counters]
    counted = [c for c in changes if find(c.metric).is_cost]
    known = in_order(c.metric for c in counted if c.metric in FIRST)
    regressed = in_order(c.metric for c in counted if c.regressed)
    differing = in_order(c.metric for c in counted if c.exact != "equal")
    costs = (name for name in in_order(c.metric for c in counted) if name not in PLAIN)
    first = [] if set(known) & set(regressed) else regressed[:1]
    return list(dict.fromkeys([*first, *known, *differing, *costs]))


def _row(comparison: Comparison, case: CaseChange, shown: list[str], timed: bool) -> Row:
    counters = [_find(case, name) for name in shown]
    cells = [case.name.triangulator, *(_counter_cell(change) for change in counters)]
    cells += [time_text(case.time)] * timed
    verdict = case_verdict(comparison, case)
    reason = case.reason or (case.time.reason if case.time is not None else "")
    cells.append(f"{verdict}: {reason}" if reason and verdict != "unchanged" else verdict)
    found = kind(comparison, case)
    same = case.status == "compared" and all(change.exact == "equal" for change in case.counters)
    return Row(tuple(cells), found, found != "plain" or not same)


def _counter_cell(change: CounterChange | None) -> str:
    """Write HEAD's value and, where it differs from BASE's, the growth."""
    if change is None:
        return ""
    growth = "" if change.change in (0, None) else f" ({percent(change.change or 0)})"
    return f"{figure(change.head)}{growth}"


ORDER = ("bad", "unsure", "good", "plain")


def kind(comparison: Comparison, case: CaseChange) -> Kind:
    """Return how a case is to stand out."""
    if comparison.is_regressed(case):
        return "bad"
    verdict = case_verdict(comparison, case)
    if verdict.startswith("improved"):
        return "good"
    unsure = verdict.startswith("inconclusive") or case.status in (*MISSING, "content-changed")
    return "unsure" if unsure else "plain"


def _find(case: CaseChange, metric: str) -> CounterChange | None:
    return next((change for change in case.counters if change.metric == metric), None)


def drift_text(comparison: Comparison, drift: Drift) -> str:
    """Say what all cases of a group did together, and what the reference draw did."""
    text = f"all cases together: time {drift.ratio:.3f}"
    if drift.gated:
        text += f" ({drift.low:.3f}-{drift.high:.3f}), in the same rounds"
        words = drift.outcome if comparison.settings.gates_time else NOT_GATED
        return f"{text}: {words}"
    if drift.reference is not None:
        text += f", reference draw {drift.reference:.3f}"
    return f"{text} ({NOT_GATED}: runs made one after the other cannot tell code from machine)"


def affected_totals(comparison: Comparison, *, counted: bool) -> list[Total]:
    """Return the totals of figures that differ in some case.

    counted : those that say what drawing costs; otherwise predictions and a driver's opinions
    """
    affected = (total for total in comparison.totals if total.affected)
    return [total for total in affected if find(total.metric).is_cost == counted]


def total_cells(total: Total) -> tuple[str, ...]:
    """Return the cells under `TOTALS_HEADING`."""
    return (
        total.metric.replace("_", " "),
        f"{total.affected} of {total.cases}",
        str(total.better),
        str(total.worse),
        figure(total.base),
        figure(total.head),
        "" if total.change is None else percent(total.change),
    )


def run_lines(comparison: Comparison) -> list[str]:
    """Return one line for each run: where it is, when it was made and of which commit."""
    lines = []
    for name, run in (("BASE", comparison.base), ("HEAD", comparison.head)):
        harness = f"raster-harness {run.harness}" if run.harness else ""
        if run.harness_commit and run.harness_commit != run.commit:
            harness += f" at {run.harness_commit}"
        commit = run.commit and f"commit {run.commit}"
        parts = (run.path, run.created, commit, harness, run.machine)
        lines.append(f"{name}: {', '.join(part for part in parts if part)}")
    return lines
