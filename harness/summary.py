"""The table of a run, for a terminal and as CSV."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness import atomic
from harness.metrics import per_view
from harness.metrics.decision import (
    Decision,
    Standing,
    advice,
    break_even,
    decide,
    polygons_of,
)
from harness.metrics.groups import base_of, condition, groups, time_ratio
from harness.metrics.registry import (
    LEAST,
    METRICS,
    Figure,
    figures_of,
    limit_of,
    measures,
    predictions,
)
from harness.results.run_folder import Record
from harness.stats.intervals import FASTER, SLOWER, UNDECIDED
from harness.style import plain_table

MOST_COLUMNS = 4
"""Figures of the table where no counter has a heading; with them, 80 characters hold all of it."""

WIDE = 96
"""Characters from which on the table has partial quads, too."""

NAME = 24
"""Characters of a name that stay in one line; when a triangulator pays goes on in the next."""

WORDS = {FASTER: "faster", SLOWER: "slower", UNDECIDED: "no diff"}


def print_summary(records: Sequence[Record], console: Console) -> None:
    """Print one table for each group, the cheapest triangulator first, then what it says."""
    for members in groups(records):
        decision = decide(members)
        good = [record for record in members if record["status"] == "ok"]
        if decision:
            console.print(_table(decision, wide=console.width >= WIDE))
        for record in members:
            if record["status"] != "ok" or record.get("reason"):
                console.print(_note(record))
        lines = [*per_view.said(good), *_proven(good), *_judged(good)]
        if decision:
            lines.append(advice(decision))
        for line in lines:
            console.print(line, markup=False, highlight=False)


def _table(decision: Decision, *, wide: bool) -> Table:
    """Return a group's ranking; what is too long for the terminal goes on in the next line."""
    records = [each.record for each in decision.standings]
    table = plain_table(_title(records[0]), title_style="bold", padding=(0, 1, 0, 0))
    widest = max(len(each.name) for each in decision.standings)
    table.add_column("triangulator", overflow="fold", min_width=min(widest, NAME))
    shown = _shown(records, wide=wide)
    for figure in shown:
        table.add_column(figure.heading or figure.label, justify="right", no_wrap=True)
    base = decision.base
    table.add_column(f"vs {base.name}", no_wrap=True)
    # Where nothing says when it has paid, the verdict alone stands here.
    paid = any(each.pays for each in decision.standings)
    if paid:
        table.add_column("pays after")
    complete = max(polygons_of(record) for record in records)
    for each in decision.standings:
        table.add_row(
            each.name,
            *(_number(figure(each.record), figure.form) for figure in shown),
            *_against(each, each is base, complete, paid=paid),
            style="" if each.complete else "dim",
        )
    limit = limit_of(base.record) if base.complete else None
    if limit is not None:
        cells = [_number(figure(limit), figure.form) for figure in shown]
        table.add_row("(outline alone)", *cells, "the limit", *[""] * paid, style="dim")
    return table


def _title(first: Record) -> str:
    return (
        f"{first['scene']}, {polygons_of(first):,} polygons, {condition(first)}: "
        f"{first['rasteriser']} on {first['device']}"
    )


def _shown(records: Sequence[Record], *, wide: bool) -> list[Figure]:
    """Return the figures of the table: those with a heading that any record has.

    A rasteriser none of whose counters has a heading shows the first of what it counts.
    """
    known = figures_of(records)
    shown = [f for f in known.values() if f.heading and any(f(record) for record in records)]
    replaced = {figure.instead_of for figure in shown}
    shown = [figure for figure in shown if figure.name not in replaced]
    if not any(figure.kind == "counter" for figure in shown):
        room = MOST_COLUMNS - len(shown)
        shown = [known[name] for name in measures(known)[:room]] + shown
    partial = known.get("partial_quads")
    if wide and partial and partial not in shown and any(map(partial, records)):
        shown.insert(1, partial)
    return shown


def _proven(records: Sequence[Record]) -> list[str]:
    """Say of which optima every polygon is proven, and how far the others may be from it."""
    told = [record for record in records if record.get("proven") is not None]
    whole = [r["triangulator"] for r in told if r["proven"] == r["polygons"]]
    lines = [f"proven optimal, every polygon: {', '.join(whole)}"] if whole else []
    for record in told:
        if record["proven"] != record["polygons"]:
            # No cost is negative, so a gap of 100 % says nothing.
            gap = record.get("largest_gap")
            some = gap is None or round(gap, 4) >= 1.0
            rest = "some of the others have no bound" if some else f"the others within {gap:.2%}"
            count = f"{record['proven']:,} of {record['polygons']:,} polygons"
            lines.append(f"proven optimal, {count}: {record['triangulator']}; {rest}")
    return lines


def _judged(records: Sequence[Record]) -> list[str]:
    """Say over how many polygons the regret is, where it is not over all."""
    known = max((record.get(LEAST) or {}).get("polygons", 0) for record in records or [{}])
    most = max((record["polygons"] for record in records), default=0)
    if not 0 < known < most:
        return []
    return [f"regret: over the {known:,} of {most:,} polygons whose fewest quads are quickly found"]


def _against(each: Standing, is_base: bool, complete: int, *, paid: bool) -> list[Text]:
    """Return the ratio with its interval, then when it has paid, or else the verdict."""
    drawn, ratio, colour, words = each.record["polygons"], each.ratio, "", ""
    if drawn != complete:
        told = f"{drawn} of {complete} done"
    elif is_base or ratio is None:
        told = "-" if is_base else ""
    else:
        told = f"{ratio.value:.3f} ({ratio.low:.3f}-{ratio.high:.3f})"
        colour = {FASTER: "green", SLOWER: "red"}.get(ratio.verdict, "")
        words = each.pays.short if each.pays else WORDS[ratio.verdict]
    cells = [told, words] if paid else [f"{told} {words}".strip()]
    return [Text(cell, style=colour) for cell in cells]


def _note(record: Record) -> Text:
    verb = "" if record["status"] == "ok" else f" {record['status']}"
    return Text(f"{record['triangulator']} on {record['device']}{verb}: {record['reason']}")


def _number(value: float | None, form: str) -> str:
    return "" if value is None else form.format(value)


def write_csv(records: Sequence[Record], file: Path) -> None:
    """Write one row per case: its identity, its counters and every metric, as `file`."""
    import pandas as pd

    atomic.write(file, pd.DataFrame(rows_of(records)).to_csv(index=False).encode())


def rows_of(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Return `row_of` each record, group by group."""
    found = [(members, base_of(members)) for members in groups(records)]
    return [row_of(record, base) for members, base in found for record in members]


def row_of(record: Record, base: Record | None) -> dict[str, Any]:
    """Return a case's identity, counters and metrics, and its time against `base`'s, by name."""
    names = ("key", "scene", "triangulator", "rasteriser", "device", "resolution", "rotation")
    row: dict[str, Any] = {name: record.get(name) for name in names}
    row |= {name: record.get(name) for name in ("status", "reason", "polygons", "conforming")}
    row |= dict(record.get("counters") or {})
    row |= {name: figure(record) for name, figure in (METRICS | predictions()).items()}
    ends = (record.get("time") or {}).get("ci95_s")
    low, high = (end * 1e3 for end in ends) if ends else (None, None)
    row |= {"draw_low_ms": low, "draw_high_ms": high}
    base = base if record["status"] == "ok" else None
    if (over := per_view.over_views(record, base)) is not None:
        told = {f"view_{name}": value for name, value in vars(over).items() if name != "views"}
        row |= {"views": over.views, **told}
    if (ratio := time_ratio(record, base)) is not None:
        row |= {
            "time_ratio": ratio.value,
            "time_ratio_low": ratio.low,
            "time_ratio_high": ratio.high,
            "verdict": ratio.verdict,
        }
        if (even := break_even(record, base)) is not None:
            after = (even.draws, even.low, even.high) if even.kind == "after" else [None] * 3
            parts = ("break_even_draws", "break_even_low", "break_even_high")
            row |= {"break_even": even.written, **dict(zip(parts, after, strict=True))}
    # There is no number in JSON for what is not known, or an interval without end.
    unknown = {name for name, v in row.items() if isinstance(v, float) and not math.isfinite(v)}
    return row | dict.fromkeys(unknown)
