"""Sets exact figures against each other: any difference is real."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

from harness.compare.model import CounterChange, Exact, Total
from harness.compare.settings import Settings
from harness.figures.registry import METRICS
from harness.stored.folder import Record


def exact_figures(record: Record) -> dict[str, float]:
    """Return the record's exact figures: the registered ones, then all other counters it has."""
    figures = {}
    for name, metric in METRICS.items():
        value = metric(record) if metric.exact else None
        if value is not None:
            figures[name] = value
    raw = {**(record.get("counters") or {}), **_predictions(record)}
    return figures | {name: value for name, value in raw.items() if name not in figures}


def _predictions(record: Record) -> dict[str, float]:
    """Return what the criteria predict, in the names of the registry or as `predicted_...`."""
    predicted = record.get("predicted") or {}
    return {f"predicted_{name}": value for name, value in predicted.items() if name not in METRICS}


def compare_counters(base: Record, head: Record, settings: Settings) -> tuple[CounterChange, ...]:
    """Compare every exact figure that both records have."""
    before, after = exact_figures(base), exact_figures(head)
    return tuple(
        _change(name, before[name], after[name], settings) for name in after if name in before
    )


def _change(name: str, base: float, head: float, settings: Settings) -> CounterChange:
    better = METRICS[name].better if name in METRICS else "none"
    exact: Exact = "equal"
    if not _equal(base, head):
        worse_up = {"lower": True, "higher": False}.get(better)
        exact = (
            "changed" if worse_up is None else "worse" if (head > base) == worse_up else "better"
        )
    threshold = settings.threshold(name)
    beyond = threshold is not None and abs(head - base) > threshold * abs(base)
    return CounterChange(
        metric=name,
        base=base,
        head=head,
        change=relative(base, head),
        exact=exact,
        threshold=threshold,
        regressed=beyond and exact == "worse",
    )


def _equal(base: float, head: float) -> bool:
    """Whether two figures agree; sums of square roots may differ in their last digits."""
    if float(base).is_integer() and float(head).is_integer():
        return base == head
    return math.isclose(base, head, rel_tol=1e-12)


def totals(cases: Sequence[Sequence[CounterChange]]) -> tuple[Total, ...]:
    """Sum each figure over the compared cases; ratios, which have no sum, are left out."""
    columns = defaultdict(list)
    for changes in cases:
        for change in changes:
            if change.metric not in METRICS or METRICS[change.metric].unit != "x":
                columns[change.metric].append(change)
    return tuple(_total(name, changes) for name, changes in columns.items())


def _total(name: str, changes: Sequence[CounterChange]) -> Total:
    base, head = sum(c.base for c in changes), sum(c.head for c in changes)
    kinds = [change.exact for change in changes]
    return Total(
        metric=name,
        unit=METRICS[name].unit if name in METRICS else "",
        cases=len(changes),
        affected=len(kinds) - kinds.count("equal"),
        better=kinds.count("better"),
        worse=kinds.count("worse"),
        base=base,
        head=head,
        change=relative(base, head),
    )


def relative(base: float, head: float) -> float | None:
    """Return the growth from `base` to `head` relative to `base`; None where that is 0."""
    if base == 0:
        return 0.0 if head == 0 else None
    return head / base - 1
