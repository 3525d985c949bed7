"""The comparison as tables for a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness.compare.model import Comparison
from harness.compare.rows import (
    TOTALS_HEADING,
    Group,
    affected_totals,
    groups,
    run_lines,
    total_cells,
)
from harness.compare.wording import headline
from harness.pictures.style import plain_table

STYLES = {"bad": "red", "good": "green", "unsure": "yellow", "plain": ""}
VERDICT_STYLES = {"regression": "bold red", "good": "bold green"}


def print_comparison(comparison: Comparison, console: Console) -> None:
    """Print the verdict, the totals of counters, a table of each group, and what else differs."""
    style = VERDICT_STYLES.get(comparison.verdict, "bold yellow")
    console.print(Text(headline(comparison), style=style), soft_wrap=True)
    for line in run_lines(comparison):
        console.print(Text(line, style="dim"), soft_wrap=True)
    differing = affected_totals(comparison, counted=True)
    if differing:
        table = _table("counters that differ", TOTALS_HEADING, words=(0,))
        for total in differing:
            table.add_row(*total_cells(total))
        console.print(table)
    for group in groups(comparison, counters=1):
        _print_group(group, console)
    for line in (*comparison.changes, *comparison.notes):
        console.print(Text(line, style="dim"), soft_wrap=True)


def _print_group(group: Group, console: Console) -> None:
    last = len(group.heading) - 1
    table = _table(group.title, group.heading, words=(0, last))
    for row in group.rows:
        table.add_row(*(Text(cell) for cell in row.cells), style=STYLES[row.kind])
    console.print(table)
    if group.drift:
        style = "red" if group.drifted else "dim"
        console.print(Text(group.drift, style=style), soft_wrap=True)


def _table(title: str, heading: tuple[str, ...], words: tuple[int, ...]) -> Table:
    table = plain_table(Text(title))
    for number, name in enumerate(heading):
        table.add_column(
            name,
            justify="left" if number in words else "right",
            no_wrap=number < len(heading) - 1,
            overflow="fold",
        )
    return table
