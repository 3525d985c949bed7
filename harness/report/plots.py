"""Plots of predictions against measurements, for papers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import View
from harness.metrics.groups import (
    Columns,
    RecordGroup,
    compute_ratios,
    group_run,
    pair_ratios,
    read_columns,
)
from harness.metrics.registry import PREDICTED, find_metric, list_costs, list_predictions
from harness.metrics.statistics import compute_rank_correlation, compute_rms_error
from harness.rasterisers.base import Options
from harness.rasterisers.counters import ESTIMATES
from harness.results.run_folder import Run
from harness.study.correlations import PAPER
from harness.style import (
    COLOURS,
    MAX_VECTOR_MARKS,
    TWO_COLUMNS,
    add_legend_below,
    choose_looks,
    draw_figure,
    draw_scatter,
    make_figure,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Marks = NDArray[np.float64]

NAME = "predicted-vs-measured"  # stem of the file names


def plot_run(run: Run) -> list[Path]:
    """Draw the plots of a run into its folder `plots`; return the files."""
    files = []
    groups = [group for group in group_run(run) if group.measured]
    defaults = {"fit": View().fit, **vars(Options())}
    position = {id(record): number for number, record in enumerate(run.records)}
    groups.sort(key=lambda group: min(position[id(record)] for record in group.records))
    for number, group in enumerate(groups):
        case = group.id
        names = (case.rasteriser, case.device_name, case.view.resolution)
        conditions = {**vars(case.view), **vars(case.options)}
        unusual = [
            f"{n}-{conditions[n]}" for n, value in defaults.items() if conditions[n] != value
        ]
        view = "-".join(map(str, (*names, f"{case.view.rotation:g}", *unusual)))
        stem = f"{NAME}-{view}" if number else NAME
        files += draw_figure(run.folder / "plots", stem, draw_predictions, run, group)
    return files


def draw_predictions(run: Run, group: RecordGroup) -> Figure | None:
    """Draw each polygon's criteria and cost relative to the base, or return None without data.

    Up to two panels show estimates in the unit of the cost, then the paper's criterion and the one
    with the best rank correlation. Division by the base's value on the same polygon removes the
    polygon's size, which would make every criterion look good.
    """
    columns = {
        record.name: arrays
        for record in group.measured
        if (arrays := read_columns(run, record)) is not None
    }
    base = group.base.name if group.base and group.base.name in columns else None
    base = base or next(iter(columns), None)
    measure = next(iter(list_costs(columns[base])), None) if base else None
    if base is None or measure is None or len(columns) < 2:
        return None
    ranks = {
        name: rank
        for name in list_predictions()
        if (rank := compute_rank_correlation(*pair_ratios(columns, base, name, measure)))
        is not None
    }
    best = max((n for n in ranks if n != PAPER), key=ranks.__getitem__, default=PAPER)
    estimates = [
        name
        for name, estimate in ESTIMATES.items()
        if estimate.measure == measure and PREDICTED + name in columns[base]
    ]
    panels = list(dict.fromkeys([*estimates, PAPER, best]))[:2]
    figure, axes = make_figure((TWO_COLUMNS, 3.6), columns=len(panels) + 1)
    for panel, criterion in zip(axes, panels, strict=False):
        _draw_scatter(panel, columns, base, criterion, measure)
        in_unit = criterion in estimates
        pairs = pair_ratios(columns, base, criterion, measure)
        panel.set_title(_format_fit(*pairs, in_unit=in_unit), fontsize=7)
        verb = "predicted" if in_unit else "predicted by"
        panel.set_xlabel(f"{verb}\n{find_metric(criterion).title},\nratio to {base}")
    axes[0].set_ylabel(f"counted {find_metric(measure).label},\nratio to {base}")
    _share_axes(axes[: len(panels)])
    _draw_rank_bars(axes[-1], ranks, measure)
    case = group.id
    figure.suptitle(
        f"Which criterion predicts {find_metric(measure).label}? {case.scene}, "
        f"{case.condition},\n{case.rasteriser} on {case.device_name}; "
        "one mark per polygon and triangulator",
        fontsize=9,
    )
    add_legend_below(figure, axes[:1], min(4, len(columns) - 1))
    return figure


def _format_fit(x: Marks, y: Marks, *, in_unit: bool) -> str:
    """Return the rank correlation of x and y and, if `in_unit`, the RMS error in per cent."""
    rank, error = compute_rank_correlation(x, y), compute_rms_error(x, y)
    text = "" if rank is None else f"rank correlation {rank:.2f}"
    if not in_unit or error is None:
        return text
    return f"{text},\nRMS error of a polygon's ratio {100 * error:.1f} %"


def _draw_scatter(
    panel: Axes, columns: dict[str, Columns], base: str, criterion: str, measure: str
) -> None:
    styles = choose_looks(list(columns))
    for name in (name for name in columns if name != base):
        x = compute_ratios(columns[name], columns[base], PREDICTED + criterion)
        y = compute_ratios(columns[name], columns[base], measure)
        finite = np.isfinite(x) & np.isfinite(y)
        is_large = (len(columns) - 1) * len(x) > MAX_VECTOR_MARKS
        draw_scatter(panel, x[finite], y[finite], styles[name], name, rasterized=is_large)


def _share_axes(panels: Sequence[Axes]) -> None:
    """Give scatter plots the same logarithmic axes and a dashed line of equal ratios."""
    from matplotlib.ticker import LogLocator, NullFormatter

    marks = [np.asarray(c.get_offsets()).ravel() for panel in panels for c in panel.collections]
    ends = np.concatenate([[1.0], *marks])
    low, high = float(ends.min()) / 1.05, float(ends.max()) * 1.05
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
    style: Any = {"textcoords": "offset points", "fontsize": 6, "ha": "right", "va": "top"}
    panels[0].annotate("equal ratios", (high, high), (-3, -8), **style)


def _draw_rank_bars(panel: Axes, ranks: Mapping[str, float], measure: str) -> None:
    names = sorted(ranks, key=lambda name: ranks[name])
    colours = [COLOURS[1] if name == PAPER else COLOURS[0] for name in names]
    panel.barh(range(len(names)), [ranks[name] for name in names], color=colours, height=0.6)
    panel.set_yticks(range(len(names)), [find_metric(name).title for name in names], fontsize=6.5)
    panel.set_xlim(min(0.0, *ranks.values()) if ranks else 0.0, 1.0)
    panel.set_xlabel(f"rank correlation\nwith {find_metric(measure).label}")
    panel.grid(visible=False, axis="y")
