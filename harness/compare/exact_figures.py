"""Sets exact figures against each other: any difference is real."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

from harness.compare.gate_settings import Settings, is_shared
from harness.compare.model import CounterChange, Exact, Total
from harness.figures.registry import METRICS, PREDICTED, find, in_order, predictions
from harness.stored.folder import Record


def exact_figures(record: Record) -> dict[str, float]:
    """Return the record's exact figures: the registered ones, then all else that it counted.

    What somebody's rasteriser counts under the name of a figure that is none of its counters is
    called `counted_...` here, and what a criterion predicts `predicted_...` where no metric does.
    """
    counted = record.get("counters") or {}
    found = {counter_name(name): counted[name] for name in in_order(counted)}
    for name, figure in {**METRICS, **predictions()}.items():
        value = figure(record) if figure.exact else None
        if value is not None:
            found[name] = value
    predicted = record.get("predicted") or {}
    features = (name for name in sorted(predicted) if name not in found)
    return found | {f"{PREDICTED}{name}": predicted[name] for name in features}


def counter_name(name: str) -> str:
    """Return what a comparison calls the counter `name`."""
    return name if find(name).kind == "counter" else f"counted_{name}"


def compare_counters(base: Record, head: Record, settings: Settings) -> tuple[CounterChange, ...]:
    """Compare every exact figure that both records have."""
    before, after = exact_figures(base), exact_figures(head)
    return tuple(
        _change(name, before[name], after[name], settings) for name in after if name in before
    )


def lost_counters(base: Record, head: Record, settings: Settings) -> tuple[str, ...]:
    """Return the gated counters that BASE has and HEAD does not: of these nothing can be said."""
    before, after = base.get("counters") or {}, head.get("counters") or {}
    lost = [counter_name(name) for name in before if name not in after]
    return tuple(name for name in lost if settings.threshold(name) is not None)


def _change(name: str, base: float, head: float, settings: Settings) -> CounterChange:
    exact: Exact = "equal"
    if not _equal(base, head):
        worse_up = {"lower": True, "higher": False}.get(find(name).better)
        exact = (
            "changed" if worse_up is None else "worse" if (head > base) == worse_up else "better"
        )
    threshold = settings.threshold(name)
    beyond = threshold is not None and abs(head - base) > threshold * abs(base)
    wrong = exact == "worse" or (exact == "changed" and is_shared(name))
    change = relative(base, head)
    return CounterChange(name, base, head, change, exact, threshold, beyond and wrong)


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
    better, worse, equal = (kinds.count(kind) for kind in ("better", "worse", "equal"))
    cases = len(changes)
    change = relative(base, head)
    return Total(name, find(name).unit, cases, cases - equal, better, worse, base, head, change)


def relative(base: float, head: float) -> float | None:
    """Return the growth from `base` to `head` relative to `base`; None where that is 0."""
    if base == 0:
        return 0.0 if head == 0 else None
    return head / base - 1
