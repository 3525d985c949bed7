"""The comparison as one HTML file that asks for nothing from outside, with its plots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from harness.compare.model import CaseChange, Comparison, Outcome
from harness.compare.wording import (
    NOT_GATED,
    ORDER,
    TOTALS_HEADING,
    affected_totals,
    groups,
    grown_text,
    headline,
    in_order,
    kind,
    run_lines,
    total_cells,
)
from harness.figures.registry import find
from harness.webpages import template

if TYPE_CHECKING:
    from harness.compare.polygons import Grown

MOST = 60
"""Cases in a plot; those that regressed come first."""

SIGNS = ("●", "■", "▲", "◆", "▼", "★", "✚", "○")
"""What stands for a counter, or an outcome, at the place of its value."""

OUTCOMES: dict[Outcome, str] = {
    "regressed": f"slower, {NOT_GATED}",
    "improved": f"faster, {NOT_GATED}",
    "unchanged": "unchanged",
    "inconclusive": "too noisy to say",
}
"""What a time did, in words where times do not decide the exit code."""

TOTALS = (
    ("Counters over all compared cases", True),
    ("Predictions and a driver's own counts", False),
)


@dataclass(frozen=True)
class Mark:
    """A value with its interval in row `row` of a plot, of the series at place `series`."""

    row: int
    series: int
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Plot:
    """A panel with a row for each case.

    axis : what values are; nothing : the value of no change; band : what is let pass
    """

    title: str
    axis: str
    rows: tuple[str, ...]
    series: tuple[str, ...]
    marks: tuple[Mark, ...]
    nothing: float
    band: tuple[float, float] | None = None

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the greatest value shown, with some room."""
        shown = [end for mark in self.marks for end in (mark.low, mark.high)]
        shown += [self.nothing, *(self.band or ())]
        room = 0.05 * (max(shown) - min(shown)) or 1.0
        return min(shown) - room, max(shown) + room

    @property
    def shown(self) -> list[int]:
        """The places of the series that have marks."""
        return sorted({mark.series for mark in self.marks})

    @property
    def ticks(self) -> list[float]:
        """Five values along the axis."""
        low, high = self.ends
        return [low + (high - low) * step / 4 for step in range(5)]


def time_plot(comparison: Comparison) -> Plot | None:
    """Return each case's ratio of times with its interval; None where nothing was timed."""
    timed = [(case, case.time) for case in _chosen(comparison) if case.time and case.time.ratio]
    if not timed:
        return None
    threshold = max(time.threshold or 0.0 for _, time in timed)
    ends = [[float(end or 0.0) for end in (t.ratio, t.low, t.high)] for _, t in timed]
    gated = comparison.settings.gates_time
    return Plot(
        "Times",
        f"time, HEAD over BASE; the band is the threshold, ±{threshold:.3g}",
        _labels([case for case, _ in timed]),
        tuple(outcome if gated else words for outcome, words in OUTCOMES.items()),
        tuple(
            Mark(row, list(OUTCOMES).index(time.outcome), *ends[row])
            for row, (_, time) in enumerate(timed)
        ),
        1.0,
        (1 / (1 + threshold), 1 + threshold),
    )


def counter_plot(comparison: Comparison) -> Plot | None:
    """Return how much each case's main counters grew, in per cent; None where none differs."""
    cases = [c for c in _chosen(comparison) if any(x.exact != "equal" for x in c.counters)]
    growth = [{c.metric: c.change for c in case.counters} for case in cases]
    counted = (c.metric for case in cases for c in case.counters if find(c.metric).is_cost)
    names = [n for n in in_order(counted) if any(each.get(n) for each in growth)][: len(SIGNS)]
    if not names:
        return None
    marks = [
        Mark(row, names.index(name), *[100 * change] * 3)
        for row, each in enumerate(growth)
        for name, change in each.items()
        if name in names and change is not None
    ]
    words = tuple(name.replace("_", " ") for name in names)
    axis = "growth of counters from BASE to HEAD, %"
    return Plot("Counters that differ", axis, _labels(cases), words, tuple(marks), 0.0)


def _chosen(comparison: Comparison) -> list[CaseChange]:
    """Return the compared cases, what regressed first."""
    cases = comparison.compared()
    return sorted(cases, key=lambda case: ORDER.index(kind(comparison, case)))[:MOST]


def _labels(cases: Sequence[CaseChange]) -> tuple[str, ...]:
    several = len({case.name.where for case in cases}) > 1
    names = (case.name for case in cases)
    return tuple(f"{n.triangulator}, {n.where}" if several else n.triangulator for n in names)


def to_html(comparison: Comparison, grown: Sequence[Grown] = ()) -> str:
    """Return a page with verdict, plots and tables; no script, no font, no address.

    grown : polygons that grew most, whose heatmaps are shown
    """
    return template("harness.compare", "compare.html.j2").render(
        comparison=comparison,
        headline=headline(comparison),
        plots=[plot for make in (time_plot, counter_plot) if (plot := make(comparison))],
        signs=SIGNS,
        grown=grown,
        grown_text=grown_text,
        runs=run_lines(comparison),
        groups=groups(comparison),
        totals_heading=TOTALS_HEADING,
        totals=[
            (title, [total_cells(t) for t in affected_totals(comparison, counted=counted)])
            for title, counted in TOTALS
        ],
    )
