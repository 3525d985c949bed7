"""A run as one table: Markdown, LaTeX (booktabs), or the JSON of Bencher."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from harness import atomic
from harness.errors import InputError
from harness.metrics.decision import Decided, Decision
from harness.style import format_latex_table, format_markdown_table
from harness.summary import format_title, make_combined_table


def write_table(decided: Sequence[Decided], file: Path) -> None:
    """Write a run's table in the format of the file's suffix, one of `FORMATS`.

    Raises
    ------
    InputError
        If the run has no measured case.
    """
    decisions = [decision for _, decision in decided if decision]
    if not decisions:
        raise InputError(f"{file}: table not written (no case was measured); see cases.jsonl")
    atomic.write(file, FORMATS[file.suffix.lower()](decisions).encode())


def _format_bencher(decisions: Sequence[Decision]) -> str:
    """Return the Bencher Metric Format: a benchmark per case, `latency` in ns, and all counters."""
    benchmarks = {}
    for decision in decisions:
        for standing in decision.standings:
            record, measures = standing.record, {}
            if record.time and record.time.median_s is not None:
                measures["latency"] = {"value": record.time.median_s * 1e9}
                if ends := record.time.ci95_s:
                    names = ("lower_value", "upper_value")
                    measures["latency"] |= dict(
                        zip(names, (end * 1e9 for end in ends), strict=True)
                    )
            measures |= {name: {"value": value} for name, value in record.counters.items()}
            benchmarks[f"{format_title(decision)}: {standing.name}"] = measures
    return json.dumps(benchmarks, indent=1) + "\n"


FORMATS: dict[str, Callable[[Sequence[Decision]], str]] = {
    ".md": lambda decisions: format_markdown_table(*make_combined_table(decisions)),
    ".tex": lambda decisions: format_latex_table(*make_combined_table(decisions)),
    ".json": _format_bencher,
}
"""Format of a table, by the suffix of its file."""
