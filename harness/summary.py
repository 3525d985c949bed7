"""The table of a run, for a terminal and as CSV."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness import atomic
from harness.metrics.advice import advice
from harness.metrics.decision import Decided, Decision, Standing
from harness.metrics.per_view import describe_views, over_views
from harness.metrics.registry import (
    METRICS,
    Metric,
    limit_of,
    measures,
    metrics_of,
    predictions,
)
from harness.results.record import Record
from harness.stats.intervals import FASTER, SLOWER, UNDECIDED
from harness.style import plain_table

MAX_COLUMNS = 4
"""Metrics in the table if no counter has a heading; with headings, 80 characters hold all."""

WIDE = 96
"""Characters from which on the table has partial quads, too."""

NAME_WIDTH = 24
"""Characters of a name that stay in one line; longer break-evens continue in the next line."""

WORDS = {FASTER: "faster", SLOWER: "slower", UNDECIDED: "no diff"}


def print_summary(decided: Iterable[Decided], console: Console) -> None:
    """Print one table for each group, the cheapest triangulator first, then notes and advice."""
    for group, decision in decided:
        if decision:
            console.print(_table(decision, wide=console.width >= WIDE))
        for record in group.records:
            if not record.is_ok or record.reason:
                console.print(_note(record))
        lines = [*describe_views(group), *_proven(group.measured), *_regret(group.measured)]
        if decision:
            lines.append(advice(decision))
        for line in lines:
            console.print(line, markup=False, highlight=False)


def _table(decision: Decision, *, wide: bool) -> Table:
    """Return a group's ranking; what is too long for the terminal continues in the next line."""
    records = [each.record for each in decision.standings]
    table = plain_table(_title(decision), title_style="bold", padding=(0, 1, 0, 0))
    widest = max(len(each.name) for each in decision.standings)
    table.add_column("triangulator", overflow="fold", min_width=min(widest, NAME_WIDTH))
    shown = _shown(records, wide=wide)
    for metric in shown:
        table.add_column(metric.heading or metric.label, justify="right", no_wrap=True)
    base = decision.base
    table.add_column(f"vs {base.name}", no_wrap=True)
    # Without any break-even, the verdict stands next to the ratio.
    has_break_even = any(each.pays for each in decision.standings)
    if has_break_even:
        table.add_column("pays after")
    complete = max(record.all_polygons for record in records)
    for each in decision.standings:
        table.add_row(
            each.name,
            *(_number(metric(each.record), metric.form) for metric in shown),
            *_against(each, each is base, complete, has_break_even=has_break_even),
            style="" if each.complete else "dim",
        )
    limit = limit_of(base.record) if base.complete else None
    if limit is not None:
        cells = [_number(metric(limit), metric.form) for metric in shown]
        more = [""] * has_break_even
        table.add_row("(outline alone)", *cells, "the limit", *more, style="dim")
    return table


def _title(decision: Decision) -> str:
    group, count = decision.group.id, decision.standings[0].record.all_polygons
    where = f"{group.rasteriser} on {group.device_name}"
    return f"{group.scene}, {count:,} polygons, {group.condition}: {where}"


def _shown(records: Sequence[Record], *, wide: bool) -> list[Metric]:
    """Return the metrics of the table: those with a heading that any record has.

    A rasteriser none of whose counters has a heading shows the first of what it counts.
    """
    known = metrics_of(records)
    shown = [f for f in known.values() if f.heading and any(f(record) for record in records)]
    replaced = {metric.instead_of for metric in shown}
    shown = [metric for metric in shown if metric.name not in replaced]
    if not any(metric.kind == "counter" for metric in shown):
        room = MAX_COLUMNS - len(shown)
        shown = [known[name] for name in measures(known)[:room]] + shown
    partial = known.get("partial_quads")
    if wide and partial and partial not in shown and any(map(partial, records)):
        shown.insert(1, partial)
    return shown


def _proven(records: Sequence[Record]) -> list[str]:
    """Return which optima are proven for every polygon, and the gaps of the others."""
    optima = [record for record in records if record.proven is not None]
    complete = [record.name for record in optima if record.proven == record.polygons]
    lines = [f"proven optimal, every polygon: {', '.join(complete)}"] if complete else []
    for record in optima:
        if record.proven != record.polygons:
            # No cost is negative, so a gap of 100 % says nothing.
            gap = record.largest_gap
            some = gap is None or round(gap, 4) >= 1.0
            rest = "some of the others have no bound" if some else f"the others within {gap:.2%}"
            count = f"{record.proven:,} of {record.polygons:,} polygons"
            lines.append(f"proven optimal, {count}: {record.name}; {rest}")
    return lines


def _regret(records: Sequence[Record]) -> list[str]:
    """Return how many polygons regret is over, if it is not over all."""
    known = max((record.least.polygons for record in records if record.least), default=0)
    most = max((record.polygons for record in records), default=0)
    if not 0 < known < most:
        return []
    return [f"regret: over the {known:,} of {most:,} polygons whose fewest quads are quickly found"]


def _against(each: Standing, is_base: bool, complete: int, *, has_break_even: bool) -> list[Text]:
    """Return the ratio with its interval, then the break-even, or else the verdict."""
    drawn, ratio, colour, words = each.record.polygons, each.ratio, "", ""
    if drawn != complete:
        cell = f"{drawn} of {complete} done"
    elif is_base or ratio is None:
        cell = "-" if is_base else ""
    else:
        cell = f"{ratio.value:.3f} ({ratio.low:.3f}-{ratio.high:.3f})"
        colour = {FASTER: "green", SLOWER: "red"}.get(ratio.verdict, "")
        words = each.pays.short if each.pays else WORDS[ratio.verdict]
    cells = [cell, words] if has_break_even else [f"{cell} {words}".strip()]
    return [Text(text, style=colour) for text in cells]


def _note(record: Record) -> Text:
    verb = "" if record.is_ok else f" {record.status}"
    return Text(f"{record.name} on {record.id.device_name}{verb}: {record.reason}")


def _number(value: float | None, form: str) -> str:
    return "" if value is None else form.format(value)


def write_csv(decided: Iterable[Decided], file: Path) -> None:
    """Write one row per case: its identity, its counters and every metric, as `file`."""
    import pandas as pd

    atomic.write(file, pd.DataFrame(rows_of(decided)).to_csv(index=False).encode())


def rows_of(decided: Iterable[Decided]) -> list[dict[str, Any]]:
    """Return `row_of` each record, group by group."""
    return [row_of(record, decision) for group, decision in decided for record in group.records]


def row_of(record: Record, decision: Decision | None) -> dict[str, Any]:
    """Return a case's identity, counters and metrics, and its time against the base's, by name."""
    case, time = record.id, record.time
    row: dict[str, Any] = {
        "key": record.key,
        "scene": case.scene,
        "triangulator": record.name,
        "rasteriser": case.rasteriser,
        "device": case.device_name,
        "resolution": case.view.resolution,
        "rotation": case.view.rotation,
        "status": record.status,
        "reason": record.reason,
        "polygons": record.polygons if record.is_ok else None,
        "conforming": record.conforming,
        **record.counters,
    }
    row |= {name: metric(record) for name, metric in (METRICS | predictions()).items()}
    low, high = (end * 1e3 for end in time.ci95_s) if time and time.ci95_s else (None, None)
    row |= {"draw_low_ms": low, "draw_high_ms": high}
    standings = decision.standings if decision else ()
    standing = next((each for each in standings if each.record is record), None)
    if decision and standing:
        row |= _against_base(standing, decision.base.record)
    # JSON has no number for what is unknown, or for an interval without end.
    unknown = {name for name, v in row.items() if isinstance(v, float) and not math.isfinite(v)}
    return row | dict.fromkeys(unknown)


def _against_base(standing: Standing, base: Record) -> dict[str, Any]:
    """Return the columns that compare a record with the base."""
    row: dict[str, Any] = {}
    if (over := over_views(standing.record, base)) is not None:
        columns = {f"view_{name}": value for name, value in vars(over).items() if name != "views"}
        row |= {"views": over.views, **columns}
    if (ratio := standing.ratio) is not None:
        row |= {
            "time_ratio": ratio.value,
            "time_ratio_low": ratio.low,
            "time_ratio_high": ratio.high,
            "verdict": ratio.verdict,
        }
    if (even := standing.pays) is not None:
        after = (even.draws, even.low, even.high) if even.kind == "after" else [None] * 3
        parts = ("break_even_draws", "break_even_low", "break_even_high")
        row |= {"break_even": even.written, **dict(zip(parts, after, strict=True))}
    return row
