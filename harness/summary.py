"""The table of a run: for a terminal, as CSV, Markdown, LaTeX (booktabs), and JSON of Bencher."""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness import atomic
from harness.errors import InputError
from harness.metrics.decision import Decided, Decision, Standing, format_advice
from harness.metrics.groups import compare_views, describe_views
from harness.metrics.registry import (
    METRICS,
    Metric,
    compute_lower_bound,
    find_metrics,
    list_costs,
    list_predictions,
)
from harness.metrics.statistics import FASTER, SLOWER, UNDECIDED
from harness.results.record import Record
from harness.style import format_latex_table, format_markdown_table, make_plain_table

MAX_COLUMNS = 4  # metrics, if no counter has a heading; those with headings fit 80 characters
MIN_WIDE = 96  # characters of a terminal from which `WIDE_TABLE_METRICS` are shown
WIDE_TABLE_METRICS = ("regret",)  # not in narrow tables: helper lanes give the same order
NAME_WIDTH = 24  # minimum width of the column of names

VERDICTS = {FASTER: "faster", SLOWER: "slower", UNDECIDED: "n.s."}


def print_summary(decided: Iterable[Decided], console: Console) -> None:
    """Print, for each group, a table sorted by cost, the lowest first, with notes and advice."""
    wide = console.width >= MIN_WIDE
    for group, decision in decided:
        if decision:
            console.print(_make_table(decision, wide=wide))
        for record in group.records:
            if not record.is_ok or record.reason:
                verb = "" if record.is_ok else f" {record.status}"
                note = f"{record.name} on {record.id.device_name}{verb}: {record.reason}"
                console.print(Text(note))
        lines = [
            *describe_views(group),
            *_describe_proofs(group.measured),
            *(_describe_regret(group.measured) if wide else ()),
        ]
        if decision:
            lines.append(format_advice(decision))
        for line in lines:
            console.print(line, markup=False, highlight=False)


def _make_table(decision: Decision, *, wide: bool) -> Table:
    records = [standing.record for standing in decision.standings]
    table = make_plain_table(format_title(decision), title_style="bold", padding=(0, 1, 0, 0))
    widest = max(len(standing.name) for standing in decision.standings)
    table.add_column("triangulator", overflow="fold", min_width=min(widest, NAME_WIDTH))
    metrics = _select_metrics(records, wide=wide)
    for metric in metrics:
        table.add_column(metric.heading or metric.label, justify="right", no_wrap=True)
    base = decision.base
    table.add_column(f"vs {base.name}", no_wrap=True)
    # Without a break-even, the column is omitted, and verdicts are in the column of ratios.
    has_break_even = any(standing.break_even for standing in decision.standings)
    if has_break_even:
        table.add_column("break-even")
    for standing in decision.standings:
        table.add_row(
            standing.name,
            *_format_metrics(metrics, standing.record),
            *_make_comparison_cells(standing, decision, has_break_even=has_break_even),
            style="" if standing.complete else "dim",
        )
    bound = compute_lower_bound(base.record) if base.complete else None
    if bound is not None:
        table.add_row("lower bound (outline)", *_format_metrics(metrics, bound), style="dim")
    return table


def make_combined_table(decisions: Sequence[Decision]) -> tuple[list[str], list[list[str]], int]:
    """Return one table of several groups: heading, rows, and the number of leading text columns."""
    standings = [standing for decision in decisions for standing in decision.standings]
    metrics = _select_metrics([standing.record for standing in standings], wide=True)
    heading = ["scene, device", "triangulator", *(m.heading or m.label for m in metrics)]
    rows = []
    for decision in decisions:
        for standing in decision.standings:
            numbers = _format_metrics(metrics, standing.record)
            ratio, _ = _make_comparison_cells(standing, decision, has_break_even=True)
            rows.append([format_title(decision), standing.name, *numbers, ratio.plain])
    return [*heading, "time relative to the base (95 % CI)"], rows, 2


def format_title(decision: Decision) -> str:
    """Return the scene, the condition and the device of a group."""
    group, count = decision.group.id, decision.standings[0].record.all_polygons
    backend = f"{group.rasteriser} on {group.device_name}"
    return f"{group.scene}, {count:,} polygons, {group.condition}: {backend}"


def _select_metrics(records: Sequence[Record], *, wide: bool) -> list[Metric]:
    """Return the metrics with a heading and a value; without a counter, add cost counters."""
    available = find_metrics(records)
    headed = [
        m for m in available.values() if m.heading and (wide or m.name not in WIDE_TABLE_METRICS)
    ]
    metrics = [metric for metric in headed if any(map(metric, records))]
    if not any(metric.kind == "counter" for metric in metrics):
        room = MAX_COLUMNS - len(metrics)
        metrics = [available[name] for name in list_costs(available)[:room]] + metrics
    return metrics


def _describe_proofs(records: Sequence[Record]) -> list[str]:
    optima = [record for record in records if record.proven is not None]
    complete = [record.name for record in optima if record.proven == record.polygons]
    lines = [f"proven optimal, every polygon: {', '.join(complete)}"] if complete else []
    for record in optima:
        if record.proven != record.polygons:
            # A gap of 100 % is the trivial bound, as costs are not negative.
            gap = record.largest_gap
            is_unbounded = gap is None or round(gap, 4) >= 1.0
            bound = "some others have no bound" if is_unbounded else f"the others within {gap:.2%}"
            count = f"{record.proven:,} of {record.polygons:,} polygons"
            lines.append(f"proven optimal, {count}: {record.name}; {bound}")
    return lines


def _describe_regret(records: Sequence[Record]) -> list[str]:
    covered = max((record.least.polygons for record in records if record.least), default=0)
    drawn = max((record.polygons for record in records), default=0)
    if not 0 < covered < drawn:
        return []
    return [f"regret: for the {covered:,} of {drawn:,} polygons whose minimum is computed quickly"]


def _make_comparison_cells(
    standing: Standing, decision: Decision, *, has_break_even: bool
) -> list[Text]:
    """Return two cells, time ratio and break-even, or one cell with time ratio and verdict."""
    ratio, colour, note = standing.ratio, "", ""
    if not standing.complete:
        complete = max(other.record.all_polygons for other in decision.standings)
        cell = f"{standing.record.polygons} of {complete} done"
    elif standing is decision.base or ratio is None:
        cell = "-" if standing is decision.base else ""
    else:
        cell = f"{ratio.value:.3f} ({ratio.low:.3f}-{ratio.high:.3f})"
        colour = {FASTER: "green", SLOWER: "red"}.get(ratio.verdict, "")
        even = standing.break_even
        note = even.short_text if even else VERDICTS[ratio.verdict]
    cells = [cell, note] if has_break_even else [f"{cell} {note}".strip()]
    return [Text(text, style=colour) for text in cells]


def _format_metrics(metrics: Sequence[Metric], record: Record) -> list[str]:
    """Return the record's value of each metric, "" if unknown."""
    values = ((metric.form, metric(record)) for metric in metrics)
    return ["" if value is None else form.format(value) for form, value in values]


def write_csv(decided: Iterable[Decided], file: Path) -> None:
    """Write a row per case to `file`: identity, counters and all metrics."""
    import pandas as pd

    atomic.write(file, pd.DataFrame(list_rows(decided)).to_csv(index=False).encode())


def list_rows(decided: Iterable[Decided]) -> list[dict[str, Any]]:
    """Return a row, from `make_row`, for each record, group by group."""
    return [make_row(record, decision) for group, decision in decided for record in group.records]


def make_row(record: Record, decision: Decision | None) -> dict[str, Any]:
    """Return a case's identity, counters, metrics, and time relative to the base, by column."""
    case, time = record.id, record.time
    row: dict[str, Any] = {
        "key": record.key,
        "scene": case.scene,
        "triangulator": record.name,
        "rasteriser": case.rasteriser,
        "device": case.device_name,
        **vars(case.view),
        "samples": case.options.samples,
        "work": case.options.work,
        "texture": case.options.texture,
        "order": case.options.order,
        "status": record.status,
        "reason": record.reason,
        "polygons": record.polygons if record.is_ok else None,
        "conforming": record.conforming,
        **record.counters,
    }
    row |= {name: metric(record) for name, metric in (METRICS | list_predictions()).items()}
    low, high = (end * 1e3 for end in time.ci95_s) if time and time.ci95_s else (None, None)
    row |= {"draw_low_ms": low, "draw_high_ms": high}
    standings = decision.standings if decision else ()
    standing = next((s for s in standings if s.record is record), None)
    if decision and standing:
        row |= _make_comparison_columns(standing, decision.base.record)
    # JSON has no NaN, for unknown values, and no infinity, for unbounded intervals.
    unknown = {name for name, v in row.items() if isinstance(v, float) and not math.isfinite(v)}
    return row | dict.fromkeys(unknown)


def _make_comparison_columns(standing: Standing, base: Record) -> dict[str, Any]:
    row: dict[str, Any] = {}
    if (statistics := compare_views(standing.record, base)) is not None:
        columns = {f"view_{name}": value for name, value in vars(statistics).items()}
        row |= {"views": columns.pop("view_views"), **columns}
    if (ratio := standing.ratio) is not None:
        row |= {
            "time_ratio": ratio.value,
            "time_ratio_low": ratio.low,
            "time_ratio_high": ratio.high,
            "verdict": ratio.verdict,
        }
    if (even := standing.break_even) is not None:
        is_after = even.kind == "after"
        row["break_even"] = even.text
        for name in ("draws", "low", "high"):
            row[f"break_even_{name}"] = getattr(even, name) if is_after else None
    return row


def write_table(decided: Sequence[Decided], file: Path) -> None:
    """Write a run's table in the format of the file's suffix, one of `FORMATS`.

    Raises
    ------
    InputError
        If the run has no measured case.
    """
    decisions = [decision for _, decision in decided if decision]
    if not decisions:
        raise InputError(f"{file}: table not written (no case was measured); see cases.jsonl")
    atomic.write(file, FORMATS[file.suffix.lower()](decisions).encode())


def _format_bencher(decisions: Sequence[Decision]) -> str:
    """Return the Bencher Metric Format: a benchmark per case, `latency` in ns, and all counters."""
    benchmarks = {}
    for decision in decisions:
        for standing in decision.standings:
            record, measures = standing.record, {}
            if record.time and record.time.median_s is not None:
                measures["latency"] = {"value": record.time.median_s * 1e9}
                if ends := record.time.ci95_s:
                    low, high = (end * 1e9 for end in ends)
                    measures["latency"] |= {"lower_value": low, "upper_value": high}
            measures |= {name: {"value": value} for name, value in record.counters.items()}
            benchmarks[f"{format_title(decision)}: {standing.name}"] = measures
    return json.dumps(benchmarks, indent=1) + "\n"


FORMATS: dict[str, Callable[[Sequence[Decision]], str]] = {
    ".md": lambda decisions: format_markdown_table(*make_combined_table(decisions)),
    ".tex": lambda decisions: format_latex_table(*make_combined_table(decisions)),
    ".json": _format_bencher,
}
"""Format of a table, by the suffix of its file."""
