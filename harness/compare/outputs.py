"""Format a comparison for a terminal and as Markdown, JUnit XML, JSON and HTML."""

from __future__ import annotations

import html
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Literal
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from harness.compare.model import BROKEN, CaseChange, Comparison, Drift, TimeChange
from harness.compare.wording import (
    NOT_GATED,
    TOTALS_HEADING,
    CaseTable,
    Row,
    build_tables,
    build_totals,
    describe_case,
    format_counter,
    format_grown,
    format_headline,
    format_thresholds,
    format_time,
    list_runs,
)
from harness.results.record import CaseGroup, make_printable
from harness.style import format_count, make_plain_table
from harness.webpages import load_template

if TYPE_CHECKING:
    from rich.console import Console

    from harness.compare.polygons import GrownPolygon


SCHEMA_VERSION = 2


def to_json(comparison: Comparison) -> dict[str, Any]:
    """Return the content of the JSON report; schema: docs/ci/compare.schema.json."""
    content = asdict(comparison)
    for case, entry in zip(comparison.cases, content["cases"], strict=True):
        names = {"scene": case.id.scene, "triangulator": case.id.name}
        names |= {"rasteriser": case.id.rasteriser, "device": case.id.device_name}
        printed = {name: make_printable(text) for name, text in names.items()}
        entry["name"] = {**printed, **vars(case.id.view), "options": case.id.options.to_json()}
        del entry["id"]
        entry["regressed"] = comparison.is_regressed(case)
    for drift, entry in zip(comparison.drifts, content["drifts"], strict=True):
        entry["where"] = str(drift.group)
        del entry["group"]
    return {
        "schema_version": SCHEMA_VERSION,
        "verdict": comparison.verdict,
        "exit_code": comparison.exit_code,
        "headline": format_headline(comparison),
        **content,
    }


STYLES = {"bad": "red", "good": "green", "unsure": "yellow", "plain": ""}
VERDICT_STYLES = {"regression": "bold red", "good": "bold green"}


def print_comparison(comparison: Comparison, console: Console) -> None:
    """Print the verdict, the totals of counters, a table per group, and other differences."""
    from rich.text import Text

    def print_line(text: str, style: str = "dim") -> None:
        console.print(Text(text, style=style), soft_wrap=True)

    def print_table(title: str, heading: Sequence[str], rows: Iterable[tuple[Any, str]]) -> None:
        first, *numbers, last = heading
        grid = make_plain_table(Text(title), first, *(f">{name}" for name in numbers), last)
        for cells, style in rows:
            grid.add_row(*map(Text, cells), style=style)
        console.print(grid)

    print_line(format_headline(comparison), VERDICT_STYLES.get(comparison.verdict, "bold yellow"))
    for text in list_runs(comparison):
        print_line(text)
    if differing := build_totals(comparison, counted=True):
        print_table("counters that differ", TOTALS_HEADING, ((cells, "") for cells in differing))
    for group in build_tables(comparison, max_counters=1):
        print_table(
            group.title, group.heading, ((row.cells, STYLES[row.kind]) for row in group.rows)
        )
        if group.drift:
            print_line(group.drift, "red" if group.drifted else "dim")
    for text in (*comparison.changes, *comparison.notes):
        print_line(text)


MAX_COMMENT_LENGTH = 60_000  # GitHub rejects comments of more than 65,536 characters

MARKER = "<!-- raster-harness compare -->"  # identifies an earlier comment, to be replaced


def to_markdown(
    comparison: Comparison, limit: int = MAX_COMMENT_LENGTH, grown: Sequence[GrownPolygon] = ()
) -> str:
    """Return the verdict, then differences, then other facts in collapsed sections.

    Tables beyond `limit` characters are omitted and counted.
    """
    verdict, _, details = format_headline(comparison).partition(": ")
    text = f"**{escape_markdown(verdict)}:** {escape_markdown(details)}\n"
    tables = build_tables(comparison)
    lines = [f"- {escape_markdown(format_grown(polygon))}\n" for polygon in grown]
    if lines:
        lines.insert(0, "**Largest growth** (heatmaps: compare.html)\n\n")
    blocks = ["".join(lines), _format_totals(comparison, counted=True)]
    blocks += [*(_format_affected_cases(group) for group in tables)]
    blocks += [
        _make_collapsed_section(f"All cases: {group.title}", _format_table(group, group.rows))
        for group in tables
    ]
    predictions = _format_totals(comparison, counted=False)
    blocks.append(
        predictions and _make_collapsed_section("Predictions and driver counters", predictions)
    )
    blocks.append(_make_collapsed_section("Runs, machines and settings", _format_facts(comparison)))
    for position, block in enumerate(blocks):
        if len(text) + len(block) > limit - 200:  # leaves room for the note and the marker
            omitted = sum(map(bool, blocks[position:]))
            text += (
                f"\n{format_count(omitted, 'table')} omitted: too long for a comment; see --html.\n"
            )
            break
        text += f"\n{block}" if block else ""
    return f"{text}\n{MARKER}\n"


def escape_markdown(text: str) -> str:
    """Escape `text` for a paragraph or a table cell."""
    return re.sub(r"([\\`*_\[\]<>|~#!$])", r"\\\1", _sanitise(text))


def _sanitise(text: str) -> str:
    """Return `text` as one line, in which `@name` is not a mention of a GitHub user."""
    return make_printable(text).replace("@", "@\u200b")


def _format_totals(comparison: Comparison, *, counted: bool) -> str:
    rows = build_totals(comparison, counted=counted)
    return (
        _format_rows(TOTALS_HEADING, [map(escape_markdown, cells) for cells in rows])
        if rows
        else ""
    )


def _format_affected_cases(group: CaseTable) -> str:
    rows = [row for row in group.rows if row.affected]
    cases = format_count(len(group.rows), "case")
    title = f"**{escape_markdown(group.title)}**: {len(rows)} of {cases}"
    return f"{title}\n\n{_format_table(group, rows)}" if rows else ""


def _format_table(group: CaseTable, rows: Sequence[Row]) -> str:
    lines = []
    for row in rows:
        *cells, verdict = map(escape_markdown, row.cells)
        lines.append([*cells, f"**{verdict}**" if row.kind == "bad" else verdict])
    text = _format_rows(group.heading, lines)
    return f"{text}\n{escape_markdown(group.drift)}\n" if group.drift else text


def _format_rows(heading: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Format escaped cells as a table; all columns but the first and last have numbers."""
    rule = ["---", *["--:"] * (len(heading) - 2), "---"]
    return "".join(f"| {' | '.join(line)} |\n" for line in (heading, rule, *rows))


def _make_collapsed_section(summary: str, content: str) -> str:
    title = html.escape(_sanitise(summary), quote=False).replace("#", "#\u200b")
    return f"<details><summary>{title}</summary>\n\n{content}\n</details>\n"


def _format_facts(comparison: Comparison) -> str:
    settings = comparison.settings
    lines = [*list_runs(comparison), *comparison.changes, *comparison.notes]
    gates, time = ", ".join(settings.gates), format_thresholds(comparison)
    lines.append(f"gate: {gates}; threshold of time {time}")
    thresholds = [(name, value) for name, value in settings.thresholds.items() if name != "time"]
    lines += [f"threshold of {name}: {value * 100:g} %" for name, value in thresholds]
    return "".join(f"- {escape_markdown(line)}\n" for line in lines)


TestOutcome = Literal["failure", "error", "skipped", "system-out"]
"""Outcome of a test as a JUnit element; a test with `system-out` passed."""

FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 excludes."""


def to_junit(comparison: Comparison) -> str:
    """Return a test suite per group of cases, with two tests per case: `counters` and `time`.

    Inconclusive times, and changes that are not gated, are skipped tests, with the reason.
    """
    suites = Element("testsuites", name="raster-harness compare")
    groups: dict[CaseGroup | None, None] = dict.fromkeys(case.id.group for case in comparison.cases)
    for group in groups or (None,):
        title = "comparison" if group is None else str(group)
        tests = list(_list_tests(comparison, group)) or [
            ("cases", "skipped", format_headline(comparison))
        ]
        numbers = Counter(outcome for _, outcome, _ in tests)
        suite = SubElement(
            suites,
            "testsuite",
            name=title,
            tests=str(len(tests)),
            failures=str(numbers["failure"]),
            errors=str(numbers["error"]),
            skipped=str(numbers["skipped"]),
        )
        for name, outcome, message in tests:
            test = SubElement(suite, "testcase", classname=title, name=name)
            if outcome == "system-out":
                SubElement(test, outcome).text = message
            else:
                SubElement(test, outcome, message=message)
    indent(suites)
    text = FORBIDDEN.sub("\ufffd", tostring(suites, encoding="unicode"))
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _list_tests(
    comparison: Comparison, group: CaseGroup | None
) -> Iterator[tuple[str, TestOutcome, str]]:
    gated = comparison.settings.gates_time
    for case in comparison.cases:
        name = make_printable(case.id.name)
        if case.id.group == group and case.status != "compared":
            wrong: TestOutcome = "error" if case.status in BROKEN else "failure"
            outcome = wrong if comparison.is_regressed(case) else "skipped"
            yield f"{name}: measured", outcome, describe_case(comparison, case)[1]
        elif case.id.group == group:
            yield f"{name}: counters", *_make_counter_test(case)
            if case.time is not None:
                yield f"{name}: time", *_make_time_test(case.time, gated=gated)
    for drift in comparison.drifts:
        if drift.group == group:
            yield "all cases together: time", *_make_time_test(drift, gated=drift.gated and gated)


def _make_counter_test(case: CaseChange) -> tuple[TestOutcome, str]:
    lines = [f"{name} no longer counted" for name in case.lost]
    changed = (change for change in case.counters if change.exact != "equal")
    lines += [f"{change.metric}: {change.exact}, {format_counter(change)}" for change in changed]
    is_wrong = case.lost or case.list_regressed_counters()
    return "failure" if is_wrong else "system-out", "\n".join(lines) or "equal"


def _make_time_test(change: TimeChange | Drift, *, gated: bool) -> tuple[TestOutcome, str]:
    message = f"time {format_time(change)}".rstrip()
    if not gated:
        return "skipped", f"{NOT_GATED}: {message}"
    if change.outcome == "regressed":
        return "failure", message
    text = f"{change.outcome}: {message}"
    if change.outcome == "inconclusive":
        return "skipped", f"{text}: {change.reason}"
    return "system-out", text


def to_html(comparison: Comparison, grown: Sequence[GrownPolygon] = ()) -> str:
    """Return a self-contained page without scripts: the verdict, tables, plots and heatmaps."""
    times = [case.time for case in comparison.cases if case.time and case.time.ratio]
    ends = [abs(end - 1.0) for time in times for end in (time.low, time.high) if end]
    return load_template("harness.compare", "compare.html.j2").render(
        comparison=comparison,
        reach=max([0.01, *ends, *(time.threshold for time in times if time.threshold)]),
        headline=format_headline(comparison),
        grown=grown,
        format_grown=format_grown,
        runs=list_runs(comparison),
        groups=build_tables(comparison),
        totals_heading=TOTALS_HEADING,
        totals=[
            ("Counters over all compared cases", build_totals(comparison, counted=True)),
            ("Predictions and driver counters", build_totals(comparison, counted=False)),
        ],
    )
