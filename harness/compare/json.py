"""The comparison, and a run for the action github-action-benchmark, as JSON-ready values."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from harness.compare.exact_figures import exact_figures
from harness.compare.gate_settings import is_cost
from harness.compare.matching import case_name
from harness.compare.model import CaseChange, Comparison
from harness.compare.wording import headline
from harness.figures.registry import find
from harness.stored.folder import Record, Run

SCHEMA_VERSION = 2


def to_json(comparison: Comparison) -> dict[str, Any]:
    """Return all that `comparison` found; docs/ci/compare.schema.json describes it."""
    return {
        "schema_version": SCHEMA_VERSION,
        "verdict": comparison.verdict,
        "exit_code": comparison.exit_code,
        "headline": headline(comparison),
        "base": asdict(comparison.base),
        "head": asdict(comparison.head),
        "settings": comparison.settings.to_json(),
        "machines_differ": comparison.machines_differ,
        "totals": [asdict(total) for total in comparison.totals],
        "drifts": [asdict(drift) for drift in comparison.drifts],
        "cases": [_case(comparison, case) for case in comparison.cases],
        "notes": list(comparison.notes),
        "changes": list(comparison.changes),
    }


def _case(comparison: Comparison, case: CaseChange) -> dict[str, Any]:
    values = asdict(case)
    values["name"]["options"] = dict(case.name.options)
    values["counters"] = list(values["counters"])
    values["lost"] = list(values["lost"])
    return {**values, "regressed": comparison.is_regressed(case)}


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
        if is_cost(metric) and find(metric).better == "lower"
    ]
    milliseconds = find("draw_ms")(record)
    if milliseconds is not None:
        entry = {"name": f"{case}: draw", "unit": "ms", "value": milliseconds}
        low, high = (record.get("time") or {}).get("ci95_s") or (None, None)
        if low is not None and high is not None:
            entry["range"] = f"± {(high - low) / 2 * 1e3:.3g}"
        entries.append(entry)
    return entries
