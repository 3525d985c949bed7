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
)
from harness.metrics.registry import find_metric
from harness.results.record import make_printable
from harness.settings import COST_COUNTERS
from harness.style import format_count, format_number, format_percent, format_step

if TYPE_CHECKING:
    from harness.compare.polygons import GrownPolygon

SAME_TRIANGLES = "same triangles"  # shown instead of a ratio if one drawing was timed for both

NOT_GATED = "not gated"  # label of changes that do not affect the exit code


def format_headline(comparison: Comparison) -> str:
    """Return the verdict in one line of plain text: metric, change and device."""
    if comparison.verdict == "no-baseline":
        return (
            f"No baseline yet: {comparison.base.path} has no run; store HEAD there as the baseline "
            f"to compare its {format_count(len(comparison.cases), 'case')}"
        )
    # Cases that were not compared are counted in the headline.
    statuses = Counter(case.status for case in comparison.cases if case.status != "compared")
    not_compared = ", ".join(
        f"{format_count(n, 'case')} {STATUS_TEXT[status]}" for status, n in statuses.items()
    )
    if comparison.verdict == "nothing-comparable":
        untimed = (
            "only times are gated, and no case was timed" if comparison.list_compared() else ""
        )
        return f"Nothing comparable: {untimed or not_compared or 'neither run has a case'}"
    is_regression = comparison.verdict == "regression"
    text = (_describe_regression if is_regression else _summarise_without_regression)(comparison)
    return f"{text} ({not_compared})" if not_compared else text


def _describe_regression(comparison: Comparison) -> str:
    regressed = sorted(comparison.list_regressed_cases(), key=_get_severity, reverse=True)
    if not regressed:
        drift = max(comparison.list_regressed_drifts(), key=lambda drift: drift.ratio)
        return f"Regression: {drift.group}: {format_drift(comparison, drift)}"
    worst = regressed[0]
    more = format_count(len(regressed) - 1, "more case")
    suffix = f"; {more} regressed" if len(regressed) > 1 else ""
    if worst.status != "compared":
        return f"Regression: {worst.id}: {describe_case(comparison, worst)[1]}{suffix}"
    parts = [f"{join_names(worst.lost)} no longer counted"] if worst.lost else []
    counters = {change.metric: change for change in worst.list_regressed_counters()}
    parts += [
        f"{join_names([n])} {format_counter(counters[n])}" for n in sort_by_cost(counters)[:1]
    ]
    if comparison.settings.gates_time and worst.time and worst.time.outcome == "regressed":
        parts.append(f"time {format_time(worst.time)}")
    return f"Regression: {worst.id}: {' and '.join(parts)}{suffix}"


def _get_severity(case: CaseChange) -> tuple[bool, float]:
    """Return a sort key: whether the case is broken, and its largest relative growth."""
    growth = [
        math.inf if c.change is None else abs(c.change) for c in case.list_regressed_counters()
    ]
    if case.time is not None and case.time.outcome == "regressed":
        growth.append((case.time.ratio or 1.0) - 1)
    return case.status in BROKEN, max(growth, default=0.0)


def _summarise_without_regression(comparison: Comparison) -> str:
    compared, settings = comparison.list_compared(), comparison.settings
    start = "Inconclusive" if comparison.verdict == "inconclusive" else "No regression"
    devices = ", ".join(sorted({make_printable(case.id.device_name) for case in compared}))
    differing = sum(any(c.exact in ("worse", "better") for c in x.counters) for x in compared)
    counters = f"counters differ in {differing}" if differing else "no counter differs"
    if "counters" not in settings.gates:
        counters += f" ({NOT_GATED})"
    outcomes = Counter(
        SAME_TRIANGLES if case.time.against == "same-triangles" else case.time.outcome
        for case in compared
        if case.time is not None
    )
    counts = ", ".join(f"{number} {outcome}" for outcome, number in outcomes.items())
    times = f"times: {counts} within {format_thresholds(comparison)}" if counts else "no times"
    if counts and not settings.gates_time:
        times = f"times are {NOT_GATED}"
    text = f"{start}: {format_count(len(compared), 'case')} on {devices}, {counters}, {times}"
    drifts = [d for d in comparison.drifts if d.outcome in ("regressed", "improved")]
    if drifts:
        drift = max(drifts, key=lambda drift: abs(drift.ratio - 1))
        text += f"; all cases together took {format_percent(drift.ratio - 1)} time ({NOT_GATED})"
    better = sum(describe_case(comparison, case)[0] == "good" for case in compared)
    return f"{text}; {better} improved" if better else text


def format_thresholds(comparison: Comparison) -> str:
    """Return the threshold of times, `±5 %`; two if some cases were timed in common rounds."""
    times = [case.time for case in comparison.cases if case.time is not None]
    thresholds = sorted({time.threshold for time in times if time.threshold is not None})
    thresholds = thresholds or [comparison.settings.get_time_threshold(paired=False)]
    return " or ".join(f"±{threshold * 100:g} %" for threshold in thresholds)


def format_counter(change: CounterChange) -> str:
    """Return `99,275 → 111,496 (+12.3 %)`, or the value alone if unchanged."""
    return (
        format_number(change.head)
        if change.exact == "equal"
        else format_step(change.base, change.head)
    )


def format_grown(grown: GrownPolygon) -> str:
    """Return `polygon 12 (9 vertices) of mine:cut, city 64 px: helper lanes 12 → 31 (+158 %)`."""
    vertices = format_count(len(grown.frame.points), "vertex", "vertices")
    polygon = f"polygon {grown.polygon} ({vertices})"
    growth = format_step(grown.base, grown.head)
    return f"{polygon} of {grown.case}: {join_names([grown.metric])} {growth}"


def format_time(change: TimeChange | Drift) -> str:
    """Format the ratio of times with the interval: `1.084 (1.052-1.113)`."""
    if isinstance(change, TimeChange) and change.against == "same-triangles":
        return SAME_TRIANGLES
    if change.ratio is None:
        return ""
    return f"{change.ratio:.3f} ({change.low:.3f}-{change.high:.3f})"


def format_drift(comparison: Comparison, drift: Drift) -> str:
    """Describe the drift of a group and of the reference draw."""
    if drift.gated:
        label = drift.outcome if comparison.settings.gates_time else NOT_GATED
        return f"all cases together: time {format_time(drift)}, in the same rounds: {label}"
    text = f"all cases together: time {drift.ratio:.3f}"
    if drift.reference is not None:
        text += f", reference draw {drift.reference:.3f}"
    reason = "in separate runs, a change of all cases may come from the code or from the machine"
    return f"{text} (does not affect the verdict: {reason})"


def join_names(names: Iterable[str]) -> str:
    """Return the names of metrics as words, separated by commas."""
    return ", ".join(name.replace("_", " ") for name in names)


def sort_by_cost(names: Iterable[str]) -> list[str]:
    """Return the distinct counters `names`, the best measures of the cost first."""
    counters = list(dict.fromkeys(names))
    first = [name for name in COST_COUNTERS if name in counters]
    return list(dict.fromkeys([*first, *counters]))


Kind = Literal["bad", "unsure", "good", "plain"]  # highlighting of a case, in sorting order

ORDER: tuple[Kind, ...] = get_args(Kind)


def describe_case(comparison: Comparison, case: CaseChange) -> tuple[Kind, str]:
    """Return the highlighting and the verdict of a case, in a few words."""
    if case.status != "compared":
        is_unsure = case.status in ("only-base", "content-changed")
        text = ": ".join(filter(None, (STATUS_TEXT[case.status], case.reason)))
        return "bad" if comparison.is_regressed(case) else "unsure" if is_unsure else "plain", text
    gated_time = case.time if comparison.settings.gates_time else None
    outcome = gated_time.outcome if gated_time else "unchanged"
    regressed = case.list_regressed_counters()
    worse = sort_by_cost(change.metric for change in regressed if change.exact == "worse")
    worse += ["time"] * (outcome == "regressed")
    kinds = {change.exact for change in case.counters if change.threshold is not None}
    kind: Kind = "plain"
    pixel_changes = [change.metric for change in regressed if change.exact == "changed"]
    if worse or pixel_changes or case.lost:
        parts = {
            "regressed": worse,
            "no longer counted": case.lost,
            "covers other pixels": pixel_changes,
        }
        verdict = "; ".join(
            f"{word}: {join_names(names)}" for word, names in parts.items() if names
        )
        kind = "bad"
    elif gated_time and outcome == "inconclusive":
        kind, verdict = "unsure", f"inconclusive: {gated_time.reason}"
    elif kinds & {"worse", "changed"}:
        verdict = "worse within the threshold"
    elif "better" in kinds or outcome == "improved":
        kind, verdict = "good", "improved"
    else:
        verdict = "unchanged"
    ungated = _list_ungated(comparison, case)
    return kind, f"{verdict}; {', '.join(ungated)} ({NOT_GATED})" if ungated else verdict


def _list_ungated(comparison: Comparison, case: CaseChange) -> list[str]:
    gates, changes = comparison.settings.gates, []
    costs = (change for change in case.counters if find_metric(change.metric).is_cost)
    if "counters" not in gates and any(change.exact != "equal" for change in costs):
        changes.append("counters differ")
    texts = {
        "regressed": "time slower",
        "improved": "time faster",
        "inconclusive": "time inconclusive",
    }
    if "time" not in gates and case.time is not None and case.time.outcome in texts:
        changes.append(texts[case.time.outcome])
    return changes


SECONDARY_COUNTERS = (
    "triangles",
    "fragments",
    "hits",
    "samples_passed",
    "t_junctions",
    "coverage_error",
)
"""Counters that have a column only if they differ in some case."""


@dataclass(frozen=True)
class Row:
    """One case of a table; `affected` is False if the case is only in the table of all cases."""

    cells: tuple[str, ...]
    kind: Kind
    affected: bool
    time: TimeChange | None


@dataclass(frozen=True)
class CaseTable:
    """The cases of a group, with a description of the drift, or "" if no case was timed."""

    title: str
    heading: tuple[str, ...]
    rows: tuple[Row, ...]
    drift: str
    drifted: bool


def build_tables(comparison: Comparison, max_counters: int = len(COST_COUNTERS)) -> list[CaseTable]:
    """Return a table of cases for each group, with at most `max_counters` columns of counters."""
    tables = []
    for group in dict.fromkeys(case.id.group for case in comparison.cases):
        cases = [case for case in comparison.cases if case.id.group == group]
        columns = _select_counters(cases)[:max_counters]
        timed = any(case.time is not None for case in cases)
        rows = [_build_row(comparison, case, columns, timed) for case in cases]
        rows.sort(key=lambda row: ORDER.index(row.kind))
        drift = next((d for d in comparison.drifts if d.group == group), None)
        text = format_drift(comparison, drift) if drift else ""
        heading = ("triangulator", *(name.replace("_", " ") for name in columns))
        heading += ("time vs BASE",) * timed + ("verdict",)
        tables.append(
            CaseTable(
                str(group), heading, tuple(rows), text, drift in comparison.list_regressed_drifts()
            )
        )
    return tables


def _select_counters(cases: Sequence[CaseChange]) -> list[str]:
    """Return the counters with a column; regressed counters are first."""
    changes = [change for case in cases for change in case.counters]
    counted = [change for change in changes if find_metric(change.metric).is_cost]
    regressed = sort_by_cost(change.metric for change in counted if change.regressed)
    selected = (
        c.metric for c in counted if c.exact != "equal" or c.metric not in SECONDARY_COUNTERS
    )
    return list(dict.fromkeys([*regressed, *sort_by_cost(selected)]))


def _build_row(
    comparison: Comparison, case: CaseChange, columns: Sequence[str], timed: bool
) -> Row:
    changes = {change.metric: change for change in case.counters}
    cells = [make_printable(case.id.name), *(_format_cell(changes.get(name)) for name in columns)]
    cells += [format_time(case.time) if case.time else ""] * timed
    kind, verdict = describe_case(comparison, case)
    same = case.status == "compared" and all(change.exact == "equal" for change in case.counters)
    return Row((*cells, verdict), kind, kind != "plain" or not same, case.time)


def _format_cell(change: CounterChange | None) -> str:
    """Return HEAD's value, and the growth if BASE's value differs."""
    if change is None:
        return ""
    return format_number(change.head) + (
        f" ({format_percent(change.change)})" if change.change else ""
    )


TOTALS_HEADING = ("counter", "affected", "better", "worse", "BASE", "HEAD", "change")


def build_totals(comparison: Comparison, *, counted: bool) -> list[tuple[str, ...]]:
    """Return a row for each metric that differs; counted : True for counters of the cost."""
    return [
        (
            join_names([total.metric]),
            f"{total.affected} of {total.cases}",
            str(total.better),
            str(total.worse),
            format_number(total.base),
            format_number(total.head),
            "" if total.change is None else format_percent(total.change),
        )
        for total in comparison.totals
        if total.affected and find_metric(total.metric).is_cost == counted
    ]


def list_runs(comparison: Comparison) -> list[str]:
    """Return a line for each run: path, date, commit, version and machine."""
    lines = []
    for name, run in (("BASE", comparison.base), ("HEAD", comparison.head)):
        harness = f"raster-harness {run.harness}" if run.harness else ""
        if run.harness_commit and run.harness_commit != run.commit:
            harness += f" at {run.harness_commit}"
        commit = run.commit and f"commit {run.commit}"
        parts = (run.path, run.created, commit, harness, run.machine)
        lines.append(f"{name}: {', '.join(part for part in parts if part)}")
    return lines
