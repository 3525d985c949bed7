"""HEAD's figures as the action github-action-benchmark reads them."""

from __future__ import annotations

from typing import Any

from harness.compare.model import Comparison
from harness.compare.rows import ORDER, kind
from harness.metrics import METRICS

FORMAT = "github-action-benchmark"


def to_benchmark_action(comparison: Comparison) -> list[dict[str, Any]]:
    """Return entries for its tool `customSmallerIsBetter`: name, unit, value, range, extra.

    Only what is better when smaller is in them, since the tool takes all entries that way.
    """
    entries = []
    for case in sorted(comparison.compared(), key=lambda c: ORDER.index(kind(comparison, c))):
        where = f"{case.name.triangulator}, {case.name.where}"
        entries += [
            {
                "name": f"{where}: {change.metric}",
                "unit": METRICS[change.metric].unit or "count",
                "value": change.head,
                "extra": f"BASE {change.base:g}",
            }
            for change in case.counters
            if change.threshold is not None and METRICS[change.metric].better == "lower"
        ]
        time = case.time
        if time is None or time.head_median_s is None:
            continue
        entry = {"name": f"{where}: draw", "unit": "ms", "value": time.head_median_s * 1e3}
        if time.ratio and time.low and time.high:
            half = time.head_median_s * 1e3 * (time.high - time.low) / (2 * time.ratio)
            entry |= {"range": f"± {half:.3g}", "extra": f"HEAD/BASE {time.ratio:.3f}"}
        entries.append(entry)
    return entries
