"""A run's figures as the action github-action-benchmark reads them."""

from __future__ import annotations

from typing import Any

from harness.compare import deciding_figures
from harness.compare.exact_figures import exact_figures
from harness.compare.matching import case_name
from harness.figures.registry import find
from harness.stored.folder import Record, Run


def to_benchmark_action(run: Run) -> list[dict[str, Any]]:
    """Return entries for its tool `customSmallerIsBetter`: name, unit, value, range.

    Only counters and times that are better when smaller are in them, since the tool takes all
    entries that way; it keeps a history of its own, so BASE is not in them.
    """
    entries = []
    for record in run.records:
        if record.get("status") == "ok":
            name = case_name(record)
            entries += _entries(f"{name.triangulator}, {name.where}", record)
    return entries


def _entries(case: str, record: Record) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = [
        {"name": f"{case}: {metric}", "unit": find(metric).unit, "value": value}
        for metric, value in exact_figures(record).items()
        if deciding_figures.is_cost(metric) and find(metric).better == "lower"
    ]
    milliseconds = find("draw_ms")(record)
    if milliseconds is not None:
        entry = {"name": f"{case}: draw", "unit": "ms", "value": milliseconds}
        low, high = (record.get("time") or {}).get("ci95_s") or (None, None)
        if low is not None and high is not None:
            entry["range"] = f"± {(high - low) / 2 * 1e3:.3g}"
        entries.append(entry)
    return entries
