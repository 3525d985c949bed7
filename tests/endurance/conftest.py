"""One frame for what runs for long: how much of it, and what it counted.

`make endurance` runs everything; ENDURANCE=0.01 makes each count a hundredth.
"""

import os
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import pytest

TIMES = float(os.environ.get("ENDURANCE", "1"))
_COUNTED = "counted"


@pytest.fixture
def times() -> Callable[[int], int]:
    """Return how often to do what is done so often in a whole run."""
    return lambda often: max(1, round(often * TIMES))


@pytest.fixture
def tell(record_property: Any) -> Callable[[Mapping[str, Any]], None]:
    """Return what keeps figures for the summary; those of one test with several seeds add up."""
    return lambda figures: record_property(_COUNTED, dict(figures))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print what each test counted, all its seeds together."""
    sums: dict[str, Counter[str]] = {}
    for report in terminalreporter.getreports("passed"):
        for name, figures in report.user_properties:
            if name == _COUNTED:
                test = report.nodeid.rpartition("::")[2].partition("[")[0]
                sums.setdefault(test, Counter()).update(figures)
    for test, figures in sums.items():
        terminalreporter.section(test.removeprefix("test_").replace("_", " "))
        for what, count in figures.items():
            terminalreporter.line(f"{count:>12,} {what}")
