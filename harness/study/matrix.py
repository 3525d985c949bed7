"""The matrix of criteria and measurements: as a table, and the scatter behind it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from rich.console import Console

from harness.pictures.style import draw, legend_below, panels, plain_table, scatter_over_medians
from harness.study.correlations import TIME, column, label, predictors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAPER = "overdraw"


def print_matrix(correlations: pd.DataFrame, console: Console) -> None:
    """Print Spearman's rank correlation within polygons, one table per device."""
    for (rasteriser, device), part in _by_device(correlations):
        measures = list(dict.fromkeys(part["measure"]))
        title = f"rank correlation within polygons: {rasteriser} on {device}"
        headings = (f">{label(measure)}" for measure in measures)
        table = plain_table(title, "criterion", *headings)
        for criterion in dict.fromkeys(part["criterion"]):
            row = part[part["criterion"] == criterion].set_index("measure")["value"]
            cells = [row.get(measure, np.nan) for measure in measures]
            table.add_row(criterion, *("-" if np.isnan(c) else f"{c:.3f}" for c in cells))
        console.print(table)


def plot_study(correlations: pd.DataFrame, table: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw predicted against measured into `folder`/plots, one figure a device."""
    files = []
    for (rasteriser, device), part in _by_device(correlations):
        rows = table[(table["rasteriser"] == rasteriser) & (table["device"] == device)]
        name = f"predicted-vs-measured-{rasteriser}-{device}"
        title = f"{rasteriser} on {device}"
        files += draw(folder / "plots", name, _scatter, rows, part, title)
    return files


def _by_device(correlations: pd.DataFrame) -> list[tuple[tuple[str, str], pd.DataFrame]]:
    wanted = correlations[correlations["statistic"] == "spearman_within"]
    parts = wanted.groupby(["rasteriser", "device"], sort=False)
    return [((str(rasteriser), str(device)), part) for (rasteriser, device), part in parts]


def _scatter(rows: pd.DataFrame, part: pd.DataFrame, title: str) -> Figure | None:
    """Draw measures against predictions, both over the polygon's median, to remove its size.

    For the main counter and the time of the least work, a panel for the paper's criterion and one
    for the criterion that ranks best.
    """
    measured = [m for m in dict.fromkeys(part["measure"]) if rows[m].notna().any()]
    times = [name for name in measured if name.startswith(TIME)]
    # Quads are ranked as helper lanes are: all triangulations have the same fragments.
    measures = [name for name in measured if name not in times][:1] + times[:1]
    if not measures:
        return None
    ranks = part.set_index([part["criterion"].map(column), "measure"])["value"]
    chosen = []
    for measure in measures:
        known = ranks.xs(measure, level="measure").dropna().drop(PAPER, errors="ignore")
        chosen += [(PAPER, measure), *([(str(known.idxmax()), measure)] if len(known) else [])]
    words = (
        f"How well do the paper's A and the best criterion predict? {title}\n"
        "one mark per triangulation, over its polygon's median; dashed: as predicted"
    )
    figure, places = panels(len(chosen), (3.2, 3.1), words, across=2)
    for panel, (criterion, measure) in zip(places, chosen, strict=True):
        scatter_over_medians(panel, rows, criterion, measure, ["polygon", "resolution"])
        panel.axline((1, 1), slope=1, color="black", linewidth=0.8, linestyle="--")
        panel.set_title(
            f"rank correlation {ranks.get((criterion, measure), np.nan):.3f}", fontsize=8
        )
        panel.set_xlabel(f"predicted by {predictors()[criterion]}, over median")
        panel.set_ylabel(f"measured {label(measure)},\nover median")
    legend_below(figure, places, columns=4)
    return figure
