"""Fixtures of the endurance tests: the number of inputs, and a summary of counts.

`make endurance` runs all tests; ENDURANCE=0.01 reduces the number of inputs to 1 %.
"""

import os
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import pytest

SCALE = float(os.environ.get("ENDURANCE", "1"))
_COUNTS = "counted"


@pytest.fixture
def scale_count() -> Callable[[int], int]:
    """Return a function that scales a number of inputs by ENDURANCE."""
    return lambda count: max(1, round(count * SCALE))


@pytest.fixture
def report_counts(record_property: Any) -> Callable[[Mapping[str, Any]], None]:
    """Return a function that adds counts to the summary of the test, over all seeds."""
    return lambda counts: record_property(_COUNTS, dict(counts))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the counts of each test, summed over its seeds."""
    sums: dict[str, Counter[str]] = {}
    for report in terminalreporter.getreports("passed"):
        for name, counts in report.user_properties:
            if name == _COUNTS:
                test = report.nodeid.rpartition("::")[2].partition("[")[0]
                sums.setdefault(test, Counter()).update(counts)
    for test, counts in sums.items():
        terminalreporter.section(test.removeprefix("test_").replace("_", " "))
        for label, count in counts.items():
            terminalreporter.line(f"{count:>12,} {label}")
