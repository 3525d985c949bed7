"""The criteria x measurements matrix: as a table, as a heatmap, and the scatter behind it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from harness.plots import COLOURS, STYLE, marker, save
from harness.study.analysis import CRITERIA

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LABELS = {
    "helper_lanes": "helper lanes",
    "quads": "quads",
    "bbox_tests": "box tests",
    "rows": "rows",
    "tiles_16": "tiles 16",
    "tiles_32": "tiles 32",
    "tiles_64": "tiles 64",
}

MATCHING = {
    "helper_lanes": "half_perimeter",
    "quads": "expected_quads",
    "bbox_tests": "bbox_area",
    "time_work_0": "expected_blocks",
}
"""Measure -> the prediction of the same thing, for the scatter plots' ideal line."""


OVER_RESOLUTION = ("expected_quads", "half_perimeter", "edge_length", "overdraw", "shape")
"""Criteria whose correlations are drawn over the resolution."""


def label(measure: str) -> str:
    """Return a measure's name as a reader wants it."""
    return LABELS.get(measure, measure.replace("time_work_", "time, work "))


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
        table = Table(
            title=f"rank correlation within polygons: {rasteriser} on {device}",
            title_justify="left",
            box=None,
            pad_edge=False,
            header_style="bold",
        )
        table.add_column("criterion", no_wrap=True)
        for measure in measures:
            table.add_column(label(measure), justify="right")
        for criterion in CRITERIA:
            row = part[part["criterion"] == criterion].set_index("measure")["value"]
            cells = [row.get(measure, np.nan) for measure in measures]
            table.add_row(criterion, *("-" if np.isnan(c) else f"{c:.3f}" for c in cells))
        console.print(table)


def plot_study(correlations: pd.DataFrame, table: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw each device's matrix and scatter plots into `folder`/plots."""
    import matplotlib

    plots = folder / "plots"
    plots.mkdir(exist_ok=True)
    files = []
    for (rasteriser, device), part in select(correlations, "spearman_within").items():
        rows = table[(table["rasteriser"] == rasteriser) & (table["device"] == device)]
        with matplotlib.rc_context(STYLE):
            figures = {
                "matrix": _heatmap(part, f"{rasteriser} on {device}"),
                "predicted-vs-measured": _scatter(rows, f"{rasteriser} on {device}"),
            }
        for kind, figure in figures.items():
            if figure is not None:
                files += save(figure, plots, f"{kind}-{rasteriser}-{device}")
    return files


def plot_sizes(sizes: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw how the criteria's rank correlations depend on the resolution, one figure per device.

    sizes : what `analysis.by_resolution` gives; one panel for helper lanes and one for each time
    """
    import matplotlib

    files: list[Path] = []
    if sizes.empty:
        return files
    for (rasteriser, device), part in select(sizes, "spearman_within").items():
        # Quads rank as helper lanes do, because all triangulations have the same fragments.
        wanted = [m for m in dict.fromkeys(part["measure"]) if m in MATCHING and m != "quads"]
        with matplotlib.rc_context(STYLE):
            figure = _lines(part, wanted, f"{rasteriser} on {device}")
        if figure is not None:
            name = f"criteria-over-resolution-{rasteriser}-{device}"
            files += save(figure, folder / "plots", name)
    return files


def _lines(part: pd.DataFrame, measures: list[str], title: str) -> Figure | None:
    from matplotlib.figure import Figure

    if not measures:
        return None
    figure = Figure(figsize=(max(3.4 * len(measures), 4.6), 3.4))
    row = figure.subplots(1, len(measures), squeeze=False)[0]
    for axes, measure in zip(row, measures, strict=True):
        for index, criterion in enumerate(OVER_RESOLUTION):
            line = part[(part["criterion"] == criterion) & (part["measure"] == measure)]
            # Beside each other, so that intervals can be told apart.
            aside = 1 + 0.03 * (index - len(OVER_RESOLUTION) // 2)
            axes.errorbar(
                line["resolution"] * aside,
                line["value"],
                yerr=[line["value"] - line["ci_low"], line["ci_high"] - line["value"]],
                color=COLOURS[index % len(COLOURS)],
                marker=marker(index),
                markersize=4,
                linewidth=1,
                elinewidth=0.7,
                label=CRITERIA[criterion],
            )
        axes.set_xscale("log", base=2)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("viewport that a polygon fills (px)")
        axes.set_ylabel(f"rank correlation with {label(measure)}")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    figure.suptitle(f"{title}: medians over polygons, 95 % intervals", fontsize=9)
    return figure


def _heatmap(part: pd.DataFrame, title: str) -> Figure:
    from matplotlib.figure import Figure

    measures = list(dict.fromkeys(part["measure"]))
    cells = part.set_index(["criterion", "measure"])
    figure = Figure(figsize=(2.4 + 0.9 * len(measures), 0.45 * len(CRITERIA) + 1.0))
    axes = figure.subplots()
    values = np.array([[cells["value"].get((c, m), np.nan) for m in measures] for c in CRITERIA])
    axes.imshow(np.abs(values), cmap="cividis", vmin=0, vmax=1, aspect="auto")
    for row, criterion in enumerate(CRITERIA):
        for column, measure in enumerate(measures):
            _annotate(axes, row, column, cells.loc[(criterion, measure)])
    axes.set_xticks(range(len(measures)), [label(m) for m in measures], rotation=20, ha="right")
    axes.set_yticks(range(len(CRITERIA)), list(CRITERIA.values()))
    axes.grid(visible=False)
    axes.set_title(f"rank correlation within a polygon: {title}", fontsize=8)
    return figure


def _annotate(axes: Axes, row: int, column: int, cell: Any) -> None:
    value = float(cell["value"])
    if np.isnan(value):
        axes.text(column, row, "constant", ha="center", va="center", fontsize=6, color="#777777")
        return
    dark = abs(value) < 0.6
    interval = f"\n{cell['ci_low']:.2f} to {cell['ci_high']:.2f}" if cell["polygons"] > 2 else ""
    axes.text(
        column,
        row,
        f"{value:.3f}{interval}",
        ha="center",
        va="center",
        fontsize=6,
        color="white" if dark else "black",
    )


def _scatter(rows: pd.DataFrame, title: str) -> Figure | None:
    """Draw measures against predictions, both over the polygon's median, to remove its size."""
    from matplotlib.figure import Figure

    known = [m for m in MATCHING if m in rows and rows[m].notna().any()]
    if not known:
        return None
    figure = Figure(figsize=(3.5 * len(known), 3.6))
    panels = np.atleast_1d(figure.subplots(1, len(known)))
    kinds = rows["triangulator"].str.replace(r"[:#].*", "", regex=True)
    names = [*(kind for kind in kinds.unique() if kind != "random"), "random"]
    by_polygon = rows.groupby(["polygon", "resolution"])
    for panel, measure in zip(panels, known, strict=True):
        criterion = MATCHING[measure]
        x = rows[criterion] / by_polygon[criterion].transform("median")
        y = rows[measure] / by_polygon[measure].transform("median")
        for index, name in reversed(list(enumerate(names))):
            own = kinds == name
            panel.scatter(
                x[own],
                y[own],
                s=6,
                linewidths=0,
                alpha=0.6,
                color="#BBBBBB" if name == "random" else COLOURS[index % len(COLOURS)],
                marker=marker(index),
                label=name,
                rasterized=True,
            )
        ends = [float(np.nanmin(x)), float(np.nanmax(x))]
        panel.plot(ends, ends, color="black", linewidth=0.8, linestyle="--")
        panel.set_xlabel(f"predicted {criterion.replace('_', ' ')}, over median")
        panel.set_ylabel(f"measured {label(measure)}, over median")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles[::-1], labels[::-1], loc="outside lower center", ncols=5, markerscale=2)
    figure.suptitle(
        f"{title}: one mark per triangulation, over its polygon's median; dashed: as predicted",
        fontsize=9,
    )
    return figure
