"""The cells that the terminal, Markdown and HTML tables share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from harness.compare.gate_settings import is_cost
from harness.compare.model import MISSING, CaseChange, Comparison, CounterChange, Drift, Total
from harness.compare.wording import (
    FIRST,
    NOT_GATED,
    case_verdict,
    figure,
    in_order,
    percent,
    time_text,
)

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
    counted = [c for c in changes if is_cost(c.metric)]
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
    return Row(tuple(cells), found, found != "plain" or _differs(case))


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


def _differs(case: CaseChange) -> bool:
    return case.status != "compared" or any(change.exact != "equal" for change in case.counters)


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
    return [
        total for total in comparison.totals if total.affected and is_cost(total.metric) == counted
    ]


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
        harness = f"harness {run.harness}" if run.harness else ""
        if run.harness_commit and run.harness_commit != run.commit:
            harness += f" at {run.harness_commit}"
        commit = run.commit and f"commit {run.commit}"
        parts = (run.path, run.created, commit, harness, run.machine)
        lines.append(f"{name}: {', '.join(part for part in parts if part)}")
    return lines
