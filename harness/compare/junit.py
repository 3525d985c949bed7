"""The comparison as JUnit XML, which every CI system can show."""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from harness.compare.model import BROKEN, STATUS_TEXT, CaseChange, Comparison, Drift, TimeChange
from harness.compare.wording import NOT_GATED, counter_text, headline, time_text

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
        _count(suite)
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
    _count(suite)
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
    message = ": ".join(part for part in (STATUS_TEXT[case.status], case.reason) if part)
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


def _count(suite: Element) -> None:
    suite.set("tests", str(len(suite.findall("testcase"))))
    for attribute, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(attribute, str(len(suite.findall(f"testcase/{tag}"))))


def _clean(text: str) -> str:
    return FORBIDDEN.sub("\ufffd", text)
