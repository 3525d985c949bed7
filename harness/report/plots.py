"""What criteria predict against what was measured, as a picture for papers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.metrics.groups import RecordGroup, groups_of
from harness.metrics.per_polygon import (
    Columns,
    columns_of,
    error_of,
    rank_correlation,
    ratio_pairs,
    ratios,
)
from harness.metrics.registry import PREDICTED, find_metric, measures, predictions
from harness.rasterisers.counters import ESTIMATES
from harness.results.run_folder import Run
from harness.style import (
    COLOURS,
    MAX_VECTOR_MARKS,
    TWO_COLUMNS,
    draw,
    grid,
    legend_below,
    looks,
    scatter,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Marks = NDArray[np.float64]

NAME = "predicted-vs-measured"
"""Of the files."""

PAPER = "overdraw"
"""Column of the criterion that the paper minimises."""


def plot_run(run: Run) -> list[Path]:
    """Draw the plots of a run folder into its `plots`; returns the files written."""
    files = []
    chosen = [group for group in groups_of(run) if group.measured]
    position = {id(record): number for number, record in enumerate(run.records)}
    chosen.sort(key=lambda group: min(position[id(record)] for record in group.records))
    for number, group in enumerate(chosen):
        case = group.id
        names = (case.rasteriser, case.device_name, case.view.resolution)
        view = "-".join(map(str, (*names, f"{case.view.rotation:g}")))
        stem = f"{NAME}-{view}" if number else NAME
        files += draw(run.path / "plots", stem, predicted_against_measured, run, group)
    return files


def predicted_against_measured(run: Run, group: RecordGroup) -> Figure | None:
    """Draw, for each polygon, what criteria and cost are against the base triangulator's.

    Predictions in the unit of the cost have a panel each; where there are none or one, the paper's
    criterion and the one that ranks best fill up. The last panel shows how well every criterion
    ranks. Dividing by the base's value on the same polygon takes the polygon's size out, which
    would otherwise make every criterion look good. None where there is nothing to draw.
    """
    columns = {
        record.name: arrays
        for record in group.measured
        if (arrays := columns_of(run, record)) is not None
    }
    base = group.base.name if group.base and group.base.name in columns else None
    base = base or next(iter(columns), None)
    measure = next(iter(measures(columns[base])), None) if base else None
    if base is None or measure is None or len(columns) < 2:
        return None
    ranks = {
        name: rank
        for name in predictions()
        if (rank := rank_correlation(*ratio_pairs(columns, base, name, measure))) is not None
    }
    best = max((n for n in ranks if n != PAPER), key=ranks.__getitem__, default=PAPER)
    of_it = [name for name, each in ESTIMATES.items() if each.measure == measure]
    estimates = [name for name in of_it if PREDICTED + name in columns[base]]
    panels = list(dict.fromkeys([*estimates, PAPER, best]))[:2]
    figure, axes = grid((TWO_COLUMNS, 3.6), columns=len(panels) + 1)
    for panel, criterion in zip(axes, panels, strict=False):
        _scatter(panel, columns, base, criterion, measure)
        in_unit = criterion in estimates
        pairs = ratio_pairs(columns, base, criterion, measure)
        panel.set_title(_fit(*pairs, in_unit=in_unit), fontsize=7)
        words = "predicted" if in_unit else "predicted by"
        panel.set_xlabel(f"{words}\n{find_metric(criterion).title},\nratio to {base}")
    axes[0].set_ylabel(f"counted {find_metric(measure).label},\nratio to {base}")
    _share_axes(axes[: len(panels)])
    _rank_bars(axes[-1], ranks, measure)
    where = group.id
    figure.suptitle(
        f"Which criterion predicts {find_metric(measure).label}? {where.scene}, "
        f"{where.condition},\n{where.rasteriser} on {where.device_name}; "
        "one mark per polygon and triangulator",
        fontsize=9,
    )
    legend_below(figure, axes[:1], min(4, len(columns) - 1))
    return figure


def _fit(x: Marks, y: Marks, *, in_unit: bool) -> str:
    """Say how well marks are ranked and, in one unit, by how many per cent they are off."""
    rank, error = rank_correlation(x, y), error_of(x, y)
    words = "" if rank is None else f"rank correlation {rank:.2f}"
    if not in_unit or error is None:
        return words
    return f"{words},\na polygon's ratio off by {100 * error:.1f} %"


def _scatter(
    panel: Axes, columns: dict[str, Columns], base: str, criterion: str, measure: str
) -> None:
    shown = looks(list(columns))
    for name in (name for name in columns if name != base):
        x = ratios(columns[name], columns[base], PREDICTED + criterion)
        y = ratios(columns[name], columns[base], measure)
        fits = np.isfinite(x) & np.isfinite(y)
        many = (len(columns) - 1) * len(x) > MAX_VECTOR_MARKS
        scatter(panel, x[fits], y[fits], shown[name], name, rasterized=many)


def _share_axes(panels: Sequence[Axes]) -> None:
    """Give scatter plots the same logarithmic axes, so that their dashed lines can be compared."""
    from matplotlib.ticker import LogLocator, NullFormatter

    marks = [np.asarray(each.get_offsets()) for panel in panels for each in panel.collections]
    ends = [1.0, *(float(end) for each in marks if len(each) for end in (each.min(), each.max()))]
    low, high = min(ends) / 1.05, max(ends) * 1.05
    for panel in panels:
        panel.set_xscale("log", base=2)
        panel.set_yscale("log", base=2)
        panel.set_xlim(low, high)
        panel.set_ylim(low, high)
        for axis in (panel.xaxis, panel.yaxis):
            axis.set_major_locator(LogLocator(base=2, numticks=6))
            axis.set_major_formatter("{x:.3g}")
            axis.set_minor_formatter(NullFormatter())
        panel.plot([low, high], [low, high], color="black", linewidth=0.8, linestyle="--")
    words: Any = {"textcoords": "offset points", "fontsize": 6, "ha": "right", "va": "top"}
    panels[0].annotate("equal ratios", (high, high), (-3, -8), **words)


def _rank_bars(panel: Axes, ranks: Mapping[str, float], measure: str) -> None:
    """Draw how well each criterion ranks, the best on top."""
    names = sorted(ranks, key=lambda name: ranks[name])
    colours = [COLOURS[1] if name == PAPER else COLOURS[0] for name in names]
    panel.barh(range(len(names)), [ranks[name] for name in names], color=colours, height=0.6)
    panel.set_yticks(range(len(names)), [find_metric(name).title for name in names], fontsize=6.5)
    panel.set_xlim(min(0.0, *ranks.values()) if ranks else 0.0, 1.0)
    panel.set_xlabel(f"rank correlation\nwith {find_metric(measure).label}")
    panel.grid(visible=False, axis="y")
