"""Sentences and table cells of a comparison, the same in every output."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from harness.compare.model import (
    BROKEN,
    STATUS_TEXT,
    CaseChange,
    Comparison,
    CounterChange,
    Drift,
    TimeChange,
    Total,
)
from harness.metrics.registry import find_metric
from harness.results.record import printable
from harness.settings import COST_COUNTERS
from harness.style import count, figure, percent, step

if TYPE_CHECKING:
    from harness.compare.polygons import Grown

SAME_TRIANGLES = "same triangles"
"""Stands for the ratio of a case whose drawing is equal in both versions."""

NOT_GATED = "not gated"
"""What is shown and does not decide the exit code is always called so, and never regressed."""


def headline(comparison: Comparison) -> str:
    """Return the verdict in one line of plain text: what, by how much, on which device."""
    if comparison.verdict == "no-baseline":
        return (
            f"No baseline yet: {comparison.base.path} holds no run; the "
            f"{count(len(comparison.cases), 'case')} of HEAD can be compared once it is kept as one"
        )
    # Those that could not be compared are counted, so that none is dropped silently.
    statuses = Counter(case.status for case in comparison.cases if case.status != "compared")
    left = ", ".join(f"{count(n, 'case')} {STATUS_TEXT[each]}" for each, n in statuses.items())
    if comparison.verdict == "nothing-comparable":
        untimed = "only times are gated, and no case was timed" if comparison.compared() else ""
        return f"Nothing comparable: {untimed or left or 'neither run holds a case'}"
    said = _regression if comparison.verdict == "regression" else _calm
    return f"{said(comparison)} ({left})" if left else said(comparison)


def _regression(comparison: Comparison) -> str:
    """Describe the regression that grew most, or the common drift if no case regressed."""
    regressed = sorted(comparison.regressed(), key=_severity, reverse=True)
    if not regressed:
        drift = max(comparison.drifted(), key=lambda drift: drift.ratio)
        return f"Regression: {drift.group}: {drift_text(comparison, drift)}"
    worst, *others = regressed
    rest = f"; {count(len(others), 'more case')} regressed" if others else ""
    if worst.status != "compared":
        return f"Regression: {worst.id}: {judged(comparison, worst)[1]}{rest}"
    parts = [f"{spaced(worst.lost)} no longer counted"] if worst.lost else []
    counters = {change.metric: change for change in worst.regressions()}
    parts += [f"{spaced([n])} {counter_text(counters[n])}" for n in in_order(counters)[:1]]
    if comparison.settings.gates_time and worst.time and worst.time.outcome == "regressed":
        parts.append(f"time {time_text(worst.time)}")
    return f"Regression: {worst.id}: {' and '.join(parts)}{rest}"


def _severity(case: CaseChange) -> tuple[bool, float]:
    growth = [math.inf if c.change is None else abs(c.change) for c in case.regressions()]
    if case.time is not None and case.time.outcome == "regressed":
        growth.append((case.time.ratio or 1.0) - 1)
    return case.status in BROKEN, max(growth, default=0.0)


def _calm(comparison: Comparison) -> str:
    """Summarise a comparison without a regression."""
    compared, settings = comparison.compared(), comparison.settings
    start = "Inconclusive" if comparison.verdict == "inconclusive" else "No regression"
    devices = ", ".join(sorted({printable(case.id.device_name) for case in compared}))
    differing = sum(any(c.exact in ("worse", "better") for c in x.counters) for x in compared)
    counters = f"counters differ in {differing}" if differing else "no counter differs"
    if "counters" not in settings.gates:
        counters += f" ({NOT_GATED})"
    outcomes = Counter(
        SAME_TRIANGLES if case.time.against == "same-triangles" else case.time.outcome
        for case in compared
        if case.time is not None
    )
    found = ", ".join(f"{number} {outcome}" for outcome, number in outcomes.items())
    times = f"times: {found} within {within(comparison)}" if found else "no times"
    if found and not settings.gates_time:
        times = f"times are {NOT_GATED}"
    said = f"{start}: {count(len(compared), 'case')} on {devices}, {counters}, {times}"
    drifts = [each for each in comparison.drifts if each.outcome in ("regressed", "improved")]
    if drifts:
        drift = max(drifts, key=lambda drift: abs(drift.ratio - 1))
        said += f"; all cases together took {percent(drift.ratio - 1)} time ({NOT_GATED})"
    better = sum(judged(comparison, case)[0] == "good" for case in compared)
    return f"{said}; {better} improved" if better else said


def within(comparison: Comparison) -> str:
    """Write the threshold of times, `±5 %`; several where some were timed in the same rounds."""
    times = [case.time for case in comparison.cases if case.time is not None]
    found = sorted({time.threshold for time in times if time.threshold is not None})
    found = found or [comparison.settings.time_threshold_of(paired=False)]
    return " or ".join(f"±{threshold * 100:g} %" for threshold in found)


def counter_text(change: CounterChange) -> str:
    """Write `99,275 → 111,496 (+12.3 %)`, or only the value where nothing changed."""
    return figure(change.head) if change.exact == "equal" else step(change.base, change.head)


def grown_text(grown: Grown) -> str:
    """Write `polygon 12 (9 vertices) of mine:cut, city 64 px: helper lanes 12 → 31 (+158 %)`."""
    vertices = count(len(grown.frame.points), "vertex", "vertices")
    which = f"polygon {grown.polygon} ({vertices})"
    growth = step(grown.base, grown.head)
    return f"{which} of {grown.case}: {spaced([grown.metric])} {growth}"


def time_text(change: TimeChange | Drift) -> str:
    """Format the ratio of times with its interval: `1.084 (1.052-1.113)`."""
    if isinstance(change, TimeChange) and change.against == "same-triangles":
        return SAME_TRIANGLES
    if change.ratio is None:
        return ""
    return f"{change.ratio:.3f} ({change.low:.3f}-{change.high:.3f})"


def drift_text(comparison: Comparison, drift: Drift) -> str:
    """Describe the drift of a group and of the reference draw."""
    if drift.gated:
        words = drift.outcome if comparison.settings.gates_time else NOT_GATED
        return f"all cases together: time {time_text(drift)}, in the same rounds: {words}"
    text = f"all cases together: time {drift.ratio:.3f}"
    if drift.reference is not None:
        text += f", reference draw {drift.reference:.3f}"
    return f"{text} ({NOT_GATED}: runs made one after the other cannot tell code from machine)"


def spaced(names: Iterable[str]) -> str:
    """Return names of figures as words, with commas between."""
    return ", ".join(name.replace("_", " ") for name in names)


def in_order(names: Iterable[str]) -> list[str]:
    """Return the counters `names` once each, those first that stand for the cost best."""
    counters = list(dict.fromkeys(names))
    first = [name for name in COST_COUNTERS if name in counters]
    return list(dict.fromkeys([*first, *counters]))


Kind = Literal["bad", "unsure", "good", "plain"]
"""How a case is to stand out; in this order they are listed."""

ORDER: tuple[Kind, ...] = get_args(Kind)


def judged(comparison: Comparison, case: CaseChange) -> tuple[Kind, str]:
    """Return how a case is to stand out, and in a few words what became of it."""
    if case.status != "compared":
        unsure = case.status in ("only-base", "content-changed")
        words = ": ".join(filter(None, (STATUS_TEXT[case.status], case.reason)))
        return "bad" if comparison.is_regressed(case) else "unsure" if unsure else "plain", words
    gated_time = case.time if comparison.settings.gates_time else None
    outcome = gated_time.outcome if gated_time else "unchanged"
    worse = in_order(change.metric for change in case.regressions() if change.exact == "worse")
    worse += ["time"] * (outcome == "regressed")
    kinds = {change.exact for change in case.counters if change.threshold is not None}
    kind: Kind = "plain"
    other = [change.metric for change in case.regressions() if change.exact == "changed"]
    if worse or other or case.lost:
        parts = {
            "regressed": worse,
            "no longer counted": case.lost,
            "covers other pixels": other,
        }
        told = "; ".join(f"{word}: {spaced(names)}" for word, names in parts.items() if names)
        kind = "bad"
    elif gated_time and outcome == "inconclusive":
        kind, told = "unsure", f"inconclusive: {gated_time.reason}"
    elif kinds & {"worse", "changed"}:
        told = "worse within its threshold"
    elif "better" in kinds or outcome == "improved":
        kind, told = "good", "improved"
    else:
        told = "unchanged"
    aside = _ungated(comparison, case)
    return kind, f"{told}; {', '.join(aside)} ({NOT_GATED})" if aside else told


def _ungated(comparison: Comparison, case: CaseChange) -> list[str]:
    """Say in a word or two each what differs and does not decide the exit code."""
    gates, found = comparison.settings.gates, []
    costs = (change for change in case.counters if find_metric(change.metric).is_cost)
    if "counters" not in gates and any(change.exact != "equal" for change in costs):
        found.append("counters differ")
    words = {
        "regressed": "time slower",
        "improved": "time faster",
        "inconclusive": "time inconclusive",
    }
    if "time" not in gates and case.time is not None and case.time.outcome in words:
        found.append(words[case.time.outcome])
    return found


PLAIN = ("triangles", "fragments", "hits", "samples_passed", "t_junctions", "coverage_error")
"""Counters that get a column only where they differ."""


@dataclass(frozen=True)
class Row:
    """One case of a table, its cells in the order of `Group.heading`, and its time."""

    cells: tuple[str, ...]
    kind: Kind
    affected: bool
    time: TimeChange | None


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


def groups(comparison: Comparison, counters: int = len(COST_COUNTERS)) -> list[Group]:
    """Return the cases as one table for each scene, view, rasteriser and device.

    counters : most counters to show, so that a narrow terminal can show the rest
    """
    found = []
    for group in dict.fromkeys(case.id.group for case in comparison.cases):
        cases = [case for case in comparison.cases if case.id.group == group]
        shown = _shown(cases)[:counters]
        timed = any(case.time is not None for case in cases)
        rows = [_row(comparison, case, shown, timed) for case in cases]
        rows.sort(key=lambda row: ORDER.index(row.kind))
        drift = next((each for each in comparison.drifts if each.group == group), None)
        text = drift_text(comparison, drift) if drift else ""
        heading = ("triangulator", *(name.replace("_", " ") for name in shown))
        heading += ("time vs BASE",) * timed + ("verdict",)
        found.append(Group(str(group), heading, tuple(rows), text, drift in comparison.drifted()))
    return found


def _shown(cases: Sequence[CaseChange]) -> list[str]:
    """Return the counters worth a column, those that regressed first."""
    changes = [change for case in cases for change in case.counters]
    counted = [change for change in changes if find_metric(change.metric).is_cost]
    regressed = in_order(change.metric for change in counted if change.regressed)
    worth = (c.metric for c in counted if c.exact != "equal" or c.metric not in PLAIN)
    return list(dict.fromkeys([*regressed, *in_order(worth)]))


def _row(comparison: Comparison, case: CaseChange, shown: Sequence[str], timed: bool) -> Row:
    changes = {change.metric: change for change in case.counters}
    cells = [printable(case.id.name), *(_counter_cell(changes.get(name)) for name in shown)]
    cells += [time_text(case.time) if case.time else ""] * timed
    kind, verdict = judged(comparison, case)
    same = case.status == "compared" and all(change.exact == "equal" for change in case.counters)
    return Row((*cells, verdict), kind, kind != "plain" or not same, case.time)


def _counter_cell(change: CounterChange | None) -> str:
    """Write HEAD's value and, where it differs from BASE's, the growth."""
    if change is None:
        return ""
    return figure(change.head) + (f" ({percent(change.change)})" if change.change else "")


TOTALS_HEADING = ("counter", "affected", "better", "worse", "BASE", "HEAD", "change")


def totals(comparison: Comparison, *, counted: bool) -> list[tuple[str, ...]]:
    """Return the cells under `TOTALS_HEADING` of each figure that differs in some case.

    counted : those that say what drawing costs; otherwise predictions and a driver's opinions
    """
    differing = [total for total in comparison.totals if total.affected]
    return [_cells(total) for total in differing if find_metric(total.metric).is_cost == counted]


def _cells(total: Total) -> tuple[str, ...]:
    affected = f"{total.affected} of {total.cases}"
    change = "" if total.change is None else percent(total.change)
    numbers = (str(total.better), str(total.worse), figure(total.base), figure(total.head))
    return (spaced([total.metric]), affected, *numbers, change)


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
