"""The comparison as GitHub-flavoured Markdown, for a step summary or a comment."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence

from harness.compare.matching import printable
from harness.compare.model import Comparison
from harness.compare.rows import (
    TOTALS_HEADING,
    Group,
    Row,
    affected_totals,
    groups,
    run_lines,
    total_cells,
)
from harness.compare.wording import count, headline, within

LIMIT = 60_000
"""GitHub refuses comments of more than 65,536 characters."""

MARKER = "<!-- raster-harness compare -->"
"""Last line of the text, by which a comment is found and replaced."""


def to_markdown(comparison: Comparison, limit: int = LIMIT) -> str:
    """Return the verdict in the first line, then what differs, then all else folded.

    What does not fit into `limit` characters is cut by whole tables, and the cut is said.
    """
    verdict, _, rest = headline(comparison).partition(": ")
    text = f"**{escape(verdict)}:** {escape(rest)}\n"
    tables = groups(comparison)
    blocks = [_totals(comparison, counted=True), *(_affected(group) for group in tables)]
    blocks += [_folded(f"All cases: {group.title}", _table(group, group.rows)) for group in tables]
    opinions = _totals(comparison, counted=False)
    blocks.append(opinions and _folded("Predictions and a driver's own counts", opinions))
    blocks.append(_folded("Runs, machines and settings", _facts(comparison)))
    for position, block in enumerate(blocks):
        if len(text) + len(block) > limit - 200:
            left = sum(1 for other in blocks[position:] if other)
            text += f"\n{count(left, 'table')} left out: too long for a comment; see --html.\n"
            break
        text += f"\n{block}" if block else ""
    return f"{text}\n{MARKER}\n"


def escape(text: str) -> str:
    """Make `text` appear as it is in a paragraph or a cell of a table."""
    return re.sub(r"([\\`*_\[\]<>|~#!$])", r"\\\1", _quiet(text))


def _quiet(text: str) -> str:
    """Return one line that names nobody, with nothing in it that a terminal would obey."""
    return printable(text).replace("@", "@\u200b")


def _totals(comparison: Comparison, *, counted: bool) -> str:
    totals = affected_totals(comparison, counted=counted)
    rows = (map(escape, total_cells(total)) for total in totals)
    return _rows(TOTALS_HEADING, (0,), rows) if totals else ""


def _affected(group: Group) -> str:
    rows = [row for row in group.rows if row.affected]
    title = f"**{escape(group.title)}**: {len(rows)} of {count(len(group.rows), 'case')}"
    return f"{title}\n\n{_table(group, rows)}" if rows else ""


def _table(group: Group, rows: Sequence[Row]) -> str:
    cells = []
    for row in rows:
        *others, verdict = map(escape, row.cells)
        cells.append([*others, f"**{verdict}**" if row.kind == "bad" else verdict])
    text = _rows(group.heading, (0, len(group.heading) - 1), cells)
    return f"{text}\n{escape(group.drift)}\n" if group.drift else text


def _rows(heading: Sequence[str], words: Sequence[int], rows: Iterable[Iterable[str]]) -> str:
    """Write a table, columns `words` aligned left; cells in `rows` are escaped already."""
    rule = ["---" if n in words else "--:" for n in range(len(heading))]
    lines = [heading, rule, *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _folded(summary: str, content: str) -> str:
    title = html.escape(_quiet(summary), quote=False).replace("#", "#\u200b")
    return f"<details><summary>{title}</summary>\n\n{content}\n</details>\n"


def _facts(comparison: Comparison) -> str:
    settings = comparison.settings
    lines = [*run_lines(comparison), *comparison.changes, *comparison.notes]
    lines.append(f"gate: {', '.join(settings.gates)}; threshold of time {within(comparison)}")
    others = [(name, value) for name, value in settings.thresholds.items() if name != "time"]
    lines += [f"threshold of {name}: {value * 100:g} %" for name, value in others]
    return "".join(f"- {escape(line)}\n" for line in lines)
