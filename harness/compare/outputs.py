"""A comparison as it is written: for a terminal, as Markdown, as JUnit XML and as JSON."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from harness.compare.matching import printable
from harness.compare.model import BROKEN, STATUS_TEXT, CaseChange, Comparison, Drift, TimeChange
from harness.compare.wording import (
    NOT_GATED,
    TOTALS_HEADING,
    Group,
    Row,
    affected_totals,
    counter_text,
    groups,
    grown_text,
    headline,
    run_lines,
    time_text,
    total_cells,
    within,
)
from harness.style import count

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from harness.compare.polygons import Grown


SCHEMA_VERSION = 2


def to_json(comparison: Comparison) -> dict[str, Any]:
    """Return all that `comparison` found; docs/ci/compare.schema.json describes it."""
    found = asdict(comparison)
    for case, told in zip(comparison.cases, found["cases"], strict=True):
        told["name"]["options"] = dict(case.name.options)
        told["regressed"] = comparison.is_regressed(case)
    return {
        "schema_version": SCHEMA_VERSION,
        "verdict": comparison.verdict,
        "exit_code": comparison.exit_code,
        "headline": headline(comparison),
        **found,
    }


STYLES = {"bad": "red", "good": "green", "unsure": "yellow", "plain": ""}
VERDICT_STYLES = {"regression": "bold red", "good": "bold green"}


def print_comparison(comparison: Comparison, console: Console) -> None:
    """Print the verdict, the totals of counters, a table of each group, and what else differs."""
    from rich.text import Text

    style = VERDICT_STYLES.get(comparison.verdict, "bold yellow")
    console.print(Text(headline(comparison), style=style), soft_wrap=True)
    for line in run_lines(comparison):
        console.print(Text(line, style="dim"), soft_wrap=True)
    differing = affected_totals(comparison, counted=True)
    if differing:
        table = _rich_table("counters that differ", TOTALS_HEADING, words=(0,))
        for total in differing:
            table.add_row(*total_cells(total))
        console.print(table)
    for group in groups(comparison, counters=1):
        _print_group(group, console)
    for line in (*comparison.changes, *comparison.notes):
        console.print(Text(line, style="dim"), soft_wrap=True)


def _print_group(group: Group, console: Console) -> None:
    from rich.text import Text

    last = len(group.heading) - 1
    table = _rich_table(group.title, group.heading, words=(0, last))
    for row in group.rows:
        table.add_row(*(Text(cell) for cell in row.cells), style=STYLES[row.kind])
    console.print(table)
    if group.drift:
        style = "red" if group.drifted else "dim"
        console.print(Text(group.drift, style=style), soft_wrap=True)


def _rich_table(title: str, heading: tuple[str, ...], words: tuple[int, ...]) -> Table:
    from rich.text import Text

    from harness.style import plain_table

    names = (name if number in words else f">{name}" for number, name in enumerate(heading))
    return plain_table(Text(title), *names)


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


FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold."""


def to_junit(comparison: Comparison) -> str:
    """Return a test suite for each group of cases, and in it two tests a case.

    `counters` and `time` are tests of their own, as their verdicts are. What cannot be compared,
    what is inconclusive and times that are not gated are skipped, with the reason: JUnit knows no
    other word for it.
    """
    suites = Element("testsuites", name="raster-harness compare")
    titles = dict.fromkeys(case.name.where for case in comparison.cases)
    for title in titles:
        cases = [case for case in comparison.cases if case.name.where == title]
        suites.append(_suite(comparison, title, cases))
    if not titles:
        suite = SubElement(suites, "testsuite", name="comparison")
        _note(_test(suite, "comparison", "cases"), "skipped", headline(comparison))
        _count_tests(suite)
    indent(suites)
    text = tostring(suites, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _suite(comparison: Comparison, title: str, cases: Sequence[CaseChange]) -> Element:
    suite = Element("testsuite", name=_clean(title))
    for case in cases:
        name = case.name.triangulator
        if case.status != "compared":
            _uncompared(comparison, case, _test(suite, title, f"{name}: measured"))
            continue
        _counters(case, _test(suite, title, f"{name}: counters"))
        if (time := case.time) is not None:
            message = f"time {time_text(time)}" if time.ratio is not None else "time"
            test = _test(suite, title, f"{name}: time", time.head_median_s)
            _time(test, message, time, gated=comparison.settings.gates_time)
    for drift in comparison.drifts:
        if drift.where == title:
            message = f"time {drift.ratio:.3f} ({drift.low:.3f}-{drift.high:.3f})"
            test = _test(suite, title, "all cases together: time")
            _time(test, message, drift, gated=drift.gated and comparison.settings.gates_time)
    _count_tests(suite)
    return suite


def _test(suite: Element, group: str, name: str, seconds: float | None = None) -> Element:
    test = SubElement(suite, "testcase", classname=_clean(group), name=_clean(name))
    if seconds is not None:
        test.set("time", f"{seconds:.9f}")
    return test


def _note(test: Element, tag: str, message: str, **kind: str) -> None:
    """Say what became of a test: `failure`, `error` or `skipped`, or else what it printed."""
    if tag == "system-out":
        SubElement(test, tag).text = _clean(message)
    else:
        SubElement(test, tag, {**kind, "message": _clean(message)})


def _uncompared(comparison: Comparison, case: CaseChange, test: Element) -> None:
    message = ": ".join(part for part in (STATUS_TEXT[case.status][0], case.reason) if part)
    wrong = "error" if case.status in BROKEN else "failure"
    if comparison.is_regressed(case):
        _note(test, wrong, message, type=case.status)
    else:
        _note(test, "skipped", message)


def _counters(case: CaseChange, test: Element) -> None:
    wrong = [f"{change.metric} {counter_text(change)}" for change in case.regressions()]
    wrong += [f"{name} no longer counted" for name in case.lost]
    if wrong:
        _note(test, "failure", "; ".join(wrong), type="counters")
    changed = [change for change in case.counters if change.exact != "equal"]
    if changed:
        lines = [f"{change.metric}: {change.exact}, {counter_text(change)}" for change in changed]
        _note(test, "system-out", "\n".join(lines))


def _time(test: Element, message: str, found: TimeChange | Drift, *, gated: bool) -> None:
    if not gated:
        _note(test, "skipped", f"{NOT_GATED}: {message}")
    elif found.outcome == "regressed":
        _note(test, "failure", message, type="time")
    elif found.outcome == "inconclusive":
        _note(test, "skipped", f"inconclusive, {message}: {found.reason}")
    else:
        _note(test, "system-out", f"{found.outcome}: {message}")


def _count_tests(suite: Element) -> None:
    suite.set("tests", str(len(suite.findall("testcase"))))
    for attribute, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(attribute, str(len(suite.findall(f"testcase/{tag}"))))


def _clean(text: str) -> str:
    return FORBIDDEN.sub("\ufffd", text)
