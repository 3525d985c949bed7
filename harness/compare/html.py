"""The comparison as one HTML file that asks for nothing from outside, with its plots."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from harness.compare.gate_settings import is_cost
from harness.compare.model import CaseChange, Comparison
from harness.compare.rows import (
    ORDER,
    TOTALS_HEADING,
    affected_totals,
    groups,
    kind,
    run_lines,
    total_cells,
)
from harness.compare.wording import NOT_GATED, headline, in_order
from harness.pictures.style import COLOURS, MARKERS, STYLE
from harness.webpages.templates import template

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 60
"""Cases in a plot; those that regressed come first."""

OUTCOMES = {
    "regressed": (COLOURS[1], "s"),
    "improved": (COLOURS[2], "^"),
    "unchanged": (COLOURS[0], "o"),
    "inconclusive": (COLOURS[7], "D"),
}

UNGATED = {
    "regressed": f"slower, {NOT_GATED}",
    "improved": f"faster, {NOT_GATED}",
    "unchanged": "unchanged",
    "inconclusive": "too noisy to say",
}
"""The same where times do not decide the exit code."""


def time_figure(comparison: Comparison) -> Figure | None:
    """Draw each case's ratio of times with its interval; None where nothing was timed."""
    timed: list[Any] = [c for c in _chosen(comparison) if c.time and c.time.ratio is not None]
    if not timed:
        return None
    figure, axes = _axes(len(timed))
    threshold = max(case.time.threshold or 0.0 for case in timed)
    axes.axvspan(1 / (1 + threshold), 1 + threshold, color=COLOURS[5], alpha=0.15, linewidth=0)
    axes.axvline(1, color="black", linewidth=0.8)
    for outcome, (colour, marker) in OUTCOMES.items():
        places = [n for n, case in enumerate(timed) if case.time.outcome == outcome]
        times = [timed[n].time for n in places]
        if not places:
            continue
        ratios = [time.ratio for time in times]
        below = [time.ratio - time.low for time in times]
        above = [time.high - time.ratio for time in times]
        axes.errorbar(
            ratios,
            places,
            xerr=[below, above],
            fmt=marker,
            markersize=4,
            color=colour,
            elinewidth=1.2,
            label=outcome if comparison.settings.gates_time else UNGATED[outcome],
        )
    _finish(axes, timed, f"time, HEAD over BASE; the band is the threshold, ±{threshold:.3g}")
    return figure


def counter_figure(comparison: Comparison) -> Figure | None:
    """Draw how much each case's main counters grew; None where none differs."""
    cases = [c for c in _chosen(comparison) if any(x.exact != "equal" for x in c.counters)]
    counted = (x.metric for c in cases for x in c.counters if is_cost(x.metric))
    names = [n for n in in_order(counted) if any(_growth(c, n) for c in cases)][: len(MARKERS)]
    if not names:
        return None
    figure, axes = _axes(len(cases))
    axes.axvline(0, color="black", linewidth=0.8)
    for number, name in enumerate(names):
        growths = [_growth(case, name) for case in cases]
        known = [(n, 100 * growth) for n, growth in enumerate(growths) if growth is not None]
        axes.plot(
            [growth for _, growth in known],
            [n for n, _ in known],
            marker=MARKERS[number],
            color=COLOURS[number],
            linestyle="none",
            markersize=4,
            label=name.replace("_", " "),
        )
    _finish(axes, cases, "growth of counters from BASE to HEAD, %")
    return figure


def to_svg(figure: Figure, name: str) -> str:
    """Return the figure as an `<svg>` element, the same at every call; `name` keeps ids apart."""
    import matplotlib

    with io.StringIO() as text, matplotlib.rc_context({**STYLE, "svg.hashsalt": name}):
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
        content = text.getvalue()
    return content[content.index("<svg") :]


def _chosen(comparison: Comparison) -> list[CaseChange]:
    """Return the compared cases, what regressed first."""
    cases = comparison.compared()
    return sorted(cases, key=lambda case: ORDER.index(kind(comparison, case)))[:MOST]


def _growth(case: CaseChange, metric: str) -> float | None:
    return next((c.change for c in case.counters if c.metric == metric), None)


def _axes(rows: int) -> tuple[Figure, Axes]:
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 1.2 + 0.2 * rows))
        return figure, figure.subplots()


def _finish(axes: Axes, cases: Sequence[CaseChange], label: str) -> None:
    several = len({case.name.where for case in cases}) > 1
    labels = [
        f"{case.name.triangulator}, {case.name.where}" if several else case.name.triangulator
        for case in cases
    ]
    axes.set_yticks(range(len(cases)), labels)
    axes.set_ylim(len(cases) - 0.5, -0.5)
    axes.set_xlabel(label)
    axes.figure.legend(loc="outside upper center", ncols=4, frameon=False)


PLOTS = (
    ("time", "Times", time_figure),
    ("counters", "Counters that differ", counter_figure),
)

TOTALS = (
    ("Counters over all compared cases", True),
    ("Predictions and a driver's own counts", False),
)


def to_html(comparison: Comparison) -> str:
    """Return a page with verdict, plots and tables; no script, no font, no address."""
    plots = []
    for name, title, draw in PLOTS:
        figure = draw(comparison)
        if figure is not None:
            # Matplotlib escapes what it writes, so its SVG may stand as it is.
            plots.append((title, Markup(to_svg(figure, name))))
    return template("harness.compare", "compare.html.j2").render(
        comparison=comparison,
        headline=headline(comparison),
        plots=plots,
        runs=run_lines(comparison),
        groups=groups(comparison),
        totals_heading=TOTALS_HEADING,
        totals=[
            (title, [total_cells(t) for t in affected_totals(comparison, counted=counted)])
            for title, counted in TOTALS
        ],
    )
