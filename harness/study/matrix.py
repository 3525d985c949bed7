"""The criteria x measurements matrix: as a table, as a heatmap, and the scatter behind it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from rich.console import Console

from harness.pictures.style import draw, look_of, looks, plain_table, scatter
from harness.study.analysis import TIME, column, label, predictors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAPER = "overdraw"

CENTRED: Any = {"ha": "center", "va": "center", "fontsize": 6}

OVER_RESOLUTION = ("expected_quads", "half_perimeter", "edge_length", "overdraw", "shape")
"""Criteria whose correlations are drawn over the resolution; more would hide each other."""


def select(correlations: pd.DataFrame, statistic: str) -> dict[tuple[str, str], pd.DataFrame]:
    """Return, for each rasteriser and device, criteria x measures of one statistic's rows."""
    wanted = correlations[correlations["statistic"] == statistic]
    return {
        (str(rasteriser), str(device)): part
        for (rasteriser, device), part in wanted.groupby(["rasteriser", "device"], sort=False)
    }


def print_matrix(correlations: pd.DataFrame, console: Console) -> None:
    """Print Spearman's rank correlation within polygons, one table per device."""
    for (rasteriser, device), part in select(correlations, "spearman_within").items():
        measures = list(dict.fromkeys(part["measure"]))
        title = f"rank correlation within polygons: {rasteriser} on {device}"
        headings = (f">{label(measure)}" for measure in measures)
        table = plain_table(title, "criterion", *headings)
        for criterion in dict.fromkeys(part["criterion"]):
            row = part[part["criterion"] == criterion].set_index("measure")["value"]
            cells = [row.get(measure, np.nan) for measure in measures]
            table.add_row(criterion, *("-" if np.isnan(c) else f"{c:.3f}" for c in cells))
        console.print(table)


def plot_study(
    correlations: pd.DataFrame, sizes: pd.DataFrame, table: pd.DataFrame, folder: Path
) -> list[Path]:
    """Draw each device's matrix and scatter plots into `folder`/plots.

    sizes : what `analysis.by_resolution` gives: how criteria's rank correlations depend on the
        resolution; a panel for the main counter and one for each time
    """
    files = []
    by_size = {} if sizes.empty else select(sizes, "spearman_within")
    for (rasteriser, device), part in select(correlations, "spearman_within").items():
        rows = table[(table["rasteriser"] == rasteriser) & (table["device"] == device)]
        title, name = f"{rasteriser} on {device}", f"{rasteriser}-{device}"
        figures: list[tuple[str, Callable[..., Figure | None], tuple[Any, ...]]] = [
            ("matrix", _heatmap, (part,)),
            ("predicted-vs-measured", _scatter, (rows, part)),
        ]
        if (own := by_size.get((rasteriser, device))) is not None:
            wanted = _main(list(dict.fromkeys(own["measure"])))
            figures.append(("criteria-over-resolution", _lines, (own, wanted)))
        for kind, make, content in figures:
            files += draw(folder / "plots", f"{kind}-{name}", make, *content, title)
    return files


def _lines(part: pd.DataFrame, measures: list[str], title: str) -> Figure | None:
    from matplotlib.figure import Figure

    if not measures:
        return None
    figure = Figure(figsize=(max(3.4 * len(measures), 4.6), 3.4))
    row = figure.subplots(1, len(measures), squeeze=False)[0]
    for axes, measure in zip(row, measures, strict=True):
        for index, criterion in enumerate(OVER_RESOLUTION):
            known = part["criterion"].map(column) == criterion
            line = part[known & (part["measure"] == measure)]
            # Beside each other, so that intervals can be told apart.
            aside = 1 + 0.03 * (index - len(OVER_RESOLUTION) // 2)
            below, above = line["value"] - line["ci_low"], line["ci_high"] - line["value"]
            style: Any = {"markersize": 4, "linewidth": 1, "elinewidth": 0.7}
            axes.errorbar(
                line["resolution"] * aside,
                line["value"],
                yerr=[below.fillna(0.0), above.fillna(0.0)],
                color=look_of(index).colour,
                marker=look_of(index).marker,
                label=predictors()[criterion],
                **style,
            )
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("viewport that a polygon fills (px)")
        axes.set_ylabel(f"rank correlation with {label(measure)}")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    figure.suptitle(f"{title}: medians over polygons, 95 % intervals", fontsize=9)
    return figure


def _main(measures: list[str]) -> list[str]:
    """Return the measures that get a panel: the main counter, and the time of the least work."""
    times = [name for name in measures if name.startswith(TIME)]
    # Quads are ranked as helper lanes are: all triangulations have the same fragments.
    return [name for name in measures if name not in times][:1] + times[:1]


def _heatmap(part: pd.DataFrame, title: str) -> Figure:
    from matplotlib.figure import Figure

    measures = list(dict.fromkeys(part["measure"]))
    criteria = list(dict.fromkeys(part["criterion"]))
    cells = part.set_index(["criterion", "measure"])
    figure = Figure(figsize=(2.4 + 0.9 * len(measures), 0.45 * len(criteria) + 1.0))
    axes = figure.subplots()
    values = np.array([[cells["value"].get((c, m), np.nan) for m in measures] for c in criteria])
    axes.imshow(np.abs(values), cmap="cividis", vmin=0, vmax=1, aspect="auto")
    for row, criterion in enumerate(criteria):
        for place, measure in enumerate(measures):
            _annotate(axes, row, place, cells.loc[(criterion, measure)])
    axes.set_xticks(range(len(measures)), [label(m) for m in measures], rotation=20, ha="right")
    axes.set_yticks(range(len(criteria)), [predictors()[column(name)] for name in criteria])
    axes.grid(visible=False)
    axes.set_title(f"Which criterion predicts what? {title}: rank correlation", fontsize=8)
    return figure


def _annotate(axes: Axes, row: int, column: int, cell: Any) -> None:
    value = float(cell["value"])
    if np.isnan(value):
        axes.text(column, row, "constant", color="#777777", **CENTRED)
        return
    dark = abs(value) < 0.6
    told = not np.isnan(cell["ci_low"])
    interval = f"\n{cell['ci_low']:.2f} to {cell['ci_high']:.2f}" if told else ""
    colour = "white" if dark else "black"
    axes.text(column, row, f"{value:.3f}{interval}", color=colour, **CENTRED)


def _scatter(rows: pd.DataFrame, part: pd.DataFrame, title: str) -> Figure | None:
    """Draw measures against predictions, both over the polygon's median, to remove its size.

    One row for the paper's criterion, one for the criterion that ranks best; a column per measure.
    """
    from matplotlib.figure import Figure

    measures = _main([m for m in dict.fromkeys(part["measure"]) if rows[m].notna().any()])
    if not measures:
        return None
    ranks = part.set_index([part["criterion"].map(column), "measure"])["value"]
    figure = Figure(figsize=(0.8 + 3.2 * len(measures), 6.4))
    grid = figure.subplots(2, len(measures), squeeze=False, sharex="col", sharey="col")
    for across, measure in enumerate(measures):
        known = ranks.xs(measure, level="measure").dropna().drop(PAPER, errors="ignore")
        chosen = [PAPER, str(known.idxmax())] if len(known) else [PAPER]
        for panel, criterion in zip(grid[:, across], chosen, strict=False):
            _marks(panel, rows, criterion, measure)
            rank = ranks.get((criterion, measure), np.nan)
            panel.set_title(f"rank correlation {rank:.3f}", fontsize=8)
            panel.set_xlabel(f"predicted by {predictors()[criterion]}, over median")
            panel.set_ylabel(f"measured {label(measure)},\nover median")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    look: Any = {"loc": "outside lower center", "ncols": 2 * len(measures), "markerscale": 2}
    figure.legend(handles[::-1], labels[::-1], **look)
    figure.suptitle(
        f"How well do the paper's A and the best criterion predict? {title}\n"
        "one mark per triangulation, over its polygon's median; dashed: as predicted",
        fontsize=9,
    )
    return figure


def _marks(panel: Axes, rows: pd.DataFrame, criterion: str, measure: str) -> None:
    """Draw one panel's marks, random triangulations below all others."""
    kinds = rows["triangulator"].str.replace("#.*", "", regex=True)
    names = [*(kind for kind in kinds.unique() if kind != "random"), "random"]
    by_polygon = rows.groupby(["polygon", "resolution"])
    x = rows[criterion] / by_polygon[criterion].transform("median")
    y = rows[measure] / by_polygon[measure].transform("median")
    shown = looks(names)
    for name in reversed(names):
        own = kinds == name
        scatter(panel, x[own], y[own], shown[name], name, size=6, alpha=0.6, rasterized=True)
    panel.axline((1, 1), slope=1, color="black", linewidth=0.8, linestyle="--")
