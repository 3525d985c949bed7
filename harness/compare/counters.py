"""Sets exact figures against each other: any difference is real."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

from harness.compare.model import CounterChange, Exact, Total
from harness.compare.settings import Settings
from harness.figures.registry import PREDICTED, figures_of, find
from harness.stored.folder import Record


def exact_figures(record: Record) -> dict[str, float]:
    """Return all exact figures that the record holds, by name: whatever any rasteriser counted."""
    figures = {name: f for name, f in figures_of([record]).items() if f.exact}
    features = {PREDICTED + name for name in record.get("predicted") or () if name not in figures}
    figures |= {name: find(name) for name in sorted(features)}
    return {name: v for name, figure in figures.items() if (v := figure(record)) is not None}


def compare_counters(base: Record, head: Record, settings: Settings) -> tuple[CounterChange, ...]:
    """Compare every exact figure that both records have."""
    before, after = exact_figures(base), exact_figures(head)
    return tuple(
        _change(name, before[name], after[name], settings) for name in after if name in before
    )


def _change(name: str, base: float, head: float, settings: Settings) -> CounterChange:
    better = find(name).better
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
            if find(change.metric).adds_up:
                columns[change.metric].append(change)
    return tuple(_total(name, changes) for name, changes in columns.items())


def _total(name: str, changes: Sequence[CounterChange]) -> Total:
    base, head = sum(c.base for c in changes), sum(c.head for c in changes)
    kinds = [change.exact for change in changes]
    return Total(
        metric=name,
        unit=find(name).unit,
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
