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
    Group,
    Row,
    counter_text,
    groups,
    grown_text,
    headline,
    judged,
    run_lines,
    time_text,
    totals,
    within,
)
from harness.results.record import CaseGroup, CaseId, printable
from harness.style import count, plain_table
from harness.webpages import template

if TYPE_CHECKING:
    from rich.console import Console

    from harness.compare.polygons import Grown


SCHEMA_VERSION = 2


def to_json(comparison: Comparison) -> dict[str, Any]:
    """Return the content of the JSON report; docs/ci/compare.schema.json is its schema."""
    found = asdict(comparison)
    for case, told in zip(comparison.cases, found["cases"], strict=True):
        told["name"] = _name_to_json(case.id)
        del told["id"]
        told["regressed"] = comparison.is_regressed(case)
    for drift, told in zip(comparison.drifts, found["drifts"], strict=True):
        told["where"] = str(drift.group)
        del told["group"]
    return {
        "schema_version": SCHEMA_VERSION,
        "verdict": comparison.verdict,
        "exit_code": comparison.exit_code,
        "headline": headline(comparison),
        **found,
    }


def _name_to_json(case: CaseId) -> dict[str, Any]:
    names = {"scene": case.scene, "triangulator": case.name}
    names |= {"rasteriser": case.rasteriser, "device": case.device_name}
    printed = {name: printable(text) for name, text in names.items()}
    return {**printed, **vars(case.view), "options": case.options.to_json()}


STYLES = {"bad": "red", "good": "green", "unsure": "yellow", "plain": ""}
VERDICT_STYLES = {"regression": "bold red", "good": "bold green"}


def print_comparison(comparison: Comparison, console: Console) -> None:
    """Print the verdict, the totals of counters, a table of each group, and what else differs."""
    from rich.text import Text

    def line(text: str, style: str = "dim") -> None:
        console.print(Text(text, style=style), soft_wrap=True)

    def table(title: str, heading: Sequence[str], rows: Iterable[tuple[Any, str]]) -> None:
        first, *numbers, last = heading
        shown = plain_table(Text(title), first, *(f">{name}" for name in numbers), last)
        for cells, style in rows:
            shown.add_row(*map(Text, cells), style=style)
        console.print(shown)

    line(headline(comparison), VERDICT_STYLES.get(comparison.verdict, "bold yellow"))
    for text in run_lines(comparison):
        line(text)
    if differing := totals(comparison, counted=True):
        table("counters that differ", TOTALS_HEADING, ((cells, "") for cells in differing))
    for group in groups(comparison, counters=1):
        table(group.title, group.heading, ((row.cells, STYLES[row.kind]) for row in group.rows))
        if group.drift:
            line(group.drift, "red" if group.drifted else "dim")
    for text in (*comparison.changes, *comparison.notes):
        line(text)


LIMIT = 60_000
"""GitHub refuses comments of more than 65,536 characters."""

MARKER = "<!-- raster-harness compare -->"
"""Last line of the text, by which a comment is found and replaced."""


def to_markdown(comparison: Comparison, limit: int = LIMIT, grown: Sequence[Grown] = ()) -> str:
    """Return the verdict in the first line, then what differs, then all else folded.

    grown : polygons that grew most, which are named
    What does not fit into `limit` characters is cut by whole tables, and the cut is said.
    """
    verdict, _, rest = headline(comparison).partition(": ")
    text = f"**{escape(verdict)}:** {escape(rest)}\n"
    tables = groups(comparison)
    where = [f"- {escape(grown_text(each))}\n" for each in grown]
    if where:
        where.insert(0, "**Where it grew most** (heatmaps: compare.html)\n\n")
    blocks = ["".join(where), _totals(comparison, counted=True)]
    blocks += [*(_affected(group) for group in tables)]
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
    rows = totals(comparison, counted=counted)
    return _rows(TOTALS_HEADING, [map(escape, cells) for cells in rows]) if rows else ""


def _affected(group: Group) -> str:
    rows = [row for row in group.rows if row.affected]
    title = f"**{escape(group.title)}**: {len(rows)} of {count(len(group.rows), 'case')}"
    return f"{title}\n\n{_table(group, rows)}" if rows else ""


def _table(group: Group, rows: Sequence[Row]) -> str:
    cells = []
    for row in rows:
        *others, verdict = map(escape, row.cells)
        cells.append([*others, f"**{verdict}**" if row.kind == "bad" else verdict])
    text = _rows(group.heading, cells)
    return f"{text}\n{escape(group.drift)}\n" if group.drift else text


def _rows(heading: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Write a table of cells that are escaped already, numbers between two columns of words."""
    rule = ["---", *["--:"] * (len(heading) - 2), "---"]
    return "".join(f"| {' | '.join(line)} |\n" for line in (heading, rule, *rows))


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


Outcome = Literal["failure", "error", "skipped", "system-out"]
"""What became of a test, by the names of JUnit's elements; the last is of one that passed."""

COUNTED: dict[Outcome, str] = {"failure": "failures", "error": "errors", "skipped": "skipped"}
"""The attributes of a suite that count its tests."""

FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold."""


def to_junit(comparison: Comparison) -> str:
    """Return a test suite for each group of cases, and in it two tests a case.

    `counters` and `time` are tests of their own, as their verdicts are. What cannot be compared,
    what is inconclusive and times that are not gated are skipped, with the reason: JUnit knows no
    other word for it.
    """
    suites = Element("testsuites", name="raster-harness compare")
    groups: dict[CaseGroup | None, None] = dict.fromkeys(case.id.group for case in comparison.cases)
    for group in groups or (None,):
        title = "comparison" if group is None else str(group)
        tests = list(_tests(comparison, group)) or [("cases", "skipped", headline(comparison))]
        numbers = Counter(outcome for _, outcome, _ in tests)
        counts = {name: str(numbers[outcome]) for outcome, name in COUNTED.items()}
        attributes = {"name": title, "tests": str(len(tests)), **counts}
        suite = SubElement(suites, "testsuite", attributes)
        for name, outcome, message in tests:
            test = SubElement(suite, "testcase", classname=title, name=name)
            if outcome == "system-out":
                SubElement(test, outcome).text = message
            else:
                SubElement(test, outcome, message=message)
    indent(suites)
    text = FORBIDDEN.sub("\ufffd", tostring(suites, encoding="unicode"))
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _tests(comparison: Comparison, group: CaseGroup | None) -> Iterator[tuple[str, Outcome, str]]:
    """Yield the tests of a group: name, what became of it, and why or what was found."""
    gated = comparison.settings.gates_time
    for case in comparison.cases:
        name = printable(case.id.name)
        if case.id.group == group and case.status != "compared":
            wrong: Outcome = "error" if case.status in BROKEN else "failure"
            outcome = wrong if comparison.is_regressed(case) else "skipped"
            yield f"{name}: measured", outcome, judged(comparison, case)[1]
        elif case.id.group == group:
            yield f"{name}: counters", *_of_counters(case)
            if case.time is not None:
                yield f"{name}: time", *_of_time(case.time, gated=gated)
    for drift in comparison.drifts:
        if drift.group == group:
            yield "all cases together: time", *_of_time(drift, gated=drift.gated and gated)


def _of_counters(case: CaseChange) -> tuple[Outcome, str]:
    lines = [f"{name} no longer counted" for name in case.lost]
    changed = (change for change in case.counters if change.exact != "equal")
    lines += [f"{each.metric}: {each.exact}, {counter_text(each)}" for each in changed]
    wrong = case.lost or case.regressions()
    return "failure" if wrong else "system-out", "\n".join(lines) or "equal"


def _of_time(found: TimeChange | Drift, *, gated: bool) -> tuple[Outcome, str]:
    message = f"time {time_text(found)}".rstrip()
    if not gated:
        return "skipped", f"{NOT_GATED}: {message}"
    if found.outcome == "regressed":
        return "failure", message
    told = f"{found.outcome}: {message}"
    if found.outcome == "inconclusive":
        return "skipped", f"{told}: {found.reason}"
    return "system-out", told


TOTALS = (
    ("Counters over all compared cases", True),
    ("Predictions and a driver's own counts", False),
)


def to_html(comparison: Comparison, grown: Sequence[Grown] = ()) -> str:
    """Return a page with verdict and tables, times drawn; no script, no font, no address.

    grown : polygons that grew most, whose heatmaps are shown
    """
    times = [case.time for case in comparison.cases if case.time and case.time.ratio]
    ends = [abs(end - 1.0) for each in times for end in (each.low, each.high) if end]
    return template("harness.compare", "compare.html.j2").render(
        comparison=comparison,
        reach=max([0.01, *ends, *(each.threshold for each in times if each.threshold)]),
        headline=headline(comparison),
        grown=grown,
        grown_text=grown_text,
        runs=run_lines(comparison),
        groups=groups(comparison),
        totals_heading=TOTALS_HEADING,
        totals=[(title, totals(comparison, counted=counted)) for title, counted in TOTALS],
    )
