"""The comparison as JSON-ready values."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from harness.compare.model import CaseChange, Comparison
from harness.compare.wording import headline

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
