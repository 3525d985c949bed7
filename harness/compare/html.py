"""The comparison as one HTML file that asks for nothing from outside."""

from __future__ import annotations

from markupsafe import Markup

from harness.compare.model import Comparison
from harness.compare.plots import counter_figure, time_figure, to_svg
from harness.compare.rows import TOTALS_HEADING, affected_totals, groups, run_lines, total_cells
from harness.compare.wording import headline
from harness.webpages.templates import template

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
