"""The comparison as JUnit XML, which every CI system can show."""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree

from harness.compare.model import BROKEN, STATUS_TEXT, CaseChange, Comparison
from harness.compare.wording import NOT_GATED, counter_text, headline, time_text

FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold."""


def to_junit(comparison: Comparison) -> str:
    """Return a test suite for each group of cases, and in it two tests a case.

    `counters` and `time` are tests of their own, as their verdicts are. What cannot be compared,
    what is inconclusive and times that are not gated are skipped, with the reason: JUnit knows no
    other word for it.
    """
    suites = ElementTree.Element("testsuites", name="raster-harness compare")
    titles = dict.fromkeys(case.name.where for case in comparison.cases)
    for title in titles:
        cases = [case for case in comparison.cases if case.name.where == title]
        suites.append(_suite(comparison, title, cases))
    if not titles:
        suite = ElementTree.SubElement(suites, "testsuite", name="comparison")
        test = ElementTree.SubElement(suite, "testcase", classname="comparison", name="cases")
        ElementTree.SubElement(test, "skipped", message=_clean(headline(comparison)))
        _count(suite)
    ElementTree.indent(suites)
    text = ElementTree.tostring(suites, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _suite(comparison: Comparison, title: str, cases: Sequence[CaseChange]) -> ElementTree.Element:
    suite = ElementTree.Element("testsuite", name=_clean(title))
    for case in cases:
        name = f"{case.name.triangulator}"
        if case.status != "compared":
            _uncompared(comparison, case, _test(suite, title, f"{name}: measured"))
            continue
        _counters(case, _test(suite, title, f"{name}: counters"))
        if case.time is not None:
            _time(comparison, case, _test(suite, title, f"{name}: time", case.time.head_median_s))
    if any(drift.where == title for drift in comparison.drifts):
        _drift(comparison, title, _test(suite, title, "all cases together: time"))
    _count(suite)
    return suite


def _test(
    suite: ElementTree.Element, group: str, name: str, seconds: float | None = None
) -> ElementTree.Element:
    test = ElementTree.SubElement(suite, "testcase", classname=_clean(group), name=_clean(name))
    if seconds is not None:
        test.set("time", f"{seconds:.9f}")
    return test


def _uncompared(comparison: Comparison, case: CaseChange, test: ElementTree.Element) -> None:
    message = ": ".join(part for part in (STATUS_TEXT[case.status], case.reason) if part)
    if case.status in BROKEN:
        ElementTree.SubElement(test, "error", type=case.status, message=_clean(message))
    elif comparison.is_regressed(case):
        ElementTree.SubElement(test, "failure", type=case.status, message=_clean(message))
    else:
        ElementTree.SubElement(test, "skipped", message=_clean(message))


def _counters(case: CaseChange, test: ElementTree.Element) -> None:
    wrong = [f"{change.metric} {counter_text(change)}" for change in case.regressions()]
    wrong += [f"{name} no longer counted" for name in case.lost]
    if wrong:
        message = "; ".join(wrong)
        ElementTree.SubElement(test, "failure", type="counters", message=_clean(message))
    changed = [change for change in case.counters if change.exact != "equal"]
    if changed:
        lines = [f"{change.metric}: {change.exact}, {counter_text(change)}" for change in changed]
        ElementTree.SubElement(test, "system-out").text = _clean("\n".join(lines))


def _time(comparison: Comparison, case: CaseChange, test: ElementTree.Element) -> None:
    time = case.time
    if time is None:
        return
    message = f"time {time_text(time)}" if time.ratio is not None else "time"
    if not comparison.settings.gates_time:
        ElementTree.SubElement(test, "skipped", message=_clean(f"{NOT_GATED}: {message}"))
    elif time.outcome == "regressed":
        ElementTree.SubElement(test, "failure", type="time", message=_clean(message))
    elif time.outcome == "inconclusive":
        ElementTree.SubElement(
            test, "skipped", message=_clean(f"inconclusive, {message}: {time.reason}")
        )
    else:
        ElementTree.SubElement(test, "system-out").text = _clean(f"{time.outcome}: {message}")


def _drift(comparison: Comparison, title: str, test: ElementTree.Element) -> None:
    drift = next(drift for drift in comparison.drifts if drift.where == title)
    message = f"time {drift.ratio:.3f} ({drift.low:.3f}-{drift.high:.3f})"
    if not (drift.gated and comparison.settings.gates_time):
        ElementTree.SubElement(test, "skipped", message=f"{NOT_GATED}: {message}")
    elif drift in comparison.drifted():
        ElementTree.SubElement(test, "failure", type="time", message=message)
    elif drift.outcome == "inconclusive":
        text = _clean(f"inconclusive, {message}: {drift.reason}")
        ElementTree.SubElement(test, "skipped", message=text)
    else:
        ElementTree.SubElement(test, "system-out").text = f"{drift.outcome}: {message}"


def _count(suite: ElementTree.Element) -> None:
    suite.set("tests", str(len(suite.findall("testcase"))))
    for attribute, tag in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(attribute, str(len(suite.findall(f"testcase/{tag}"))))


def _clean(text: str) -> str:
    return FORBIDDEN.sub("\ufffd", text)
