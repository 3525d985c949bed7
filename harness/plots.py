"""Static plots of a run, in one style that colour-blind readers can use."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from harness.store import Record, Run, read_arrays
from harness.summary import BASE, groups

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's eight colours, told apart with any kind of colour vision.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#999999")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")

STYLE: Any = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "figure.constrained_layout.use": True,
    "font.size": 8.0,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "savefig.dpi": 200,
    "svg.fonttype": "none",
    "svg.hashsalt": "raster-harness",
}

MEASURES = {"helper_lanes": "helper lanes", "bbox_tests": "bounding-box tests"}
"""Counters worth predicting, the first that a rasteriser has is plotted."""

CRITERIA = {"overdraw": "the paper's A", "half_perimeter": "half-perimeter H"}

Columns = dict[str, NDArray[Any]]


def plot_run(run: Run) -> list[Path]:
    """Draw the plots of a run folder into its `plots`; returns the files written."""
    import matplotlib

    matplotlib.use("Agg", force=False)
    folder = run.path / "plots"
    folder.mkdir(exist_ok=True)
    files = []
    chosen = [m for m in groups(run.records) if any(r["status"] == "ok" for r in m)]
    for number, members in enumerate(chosen):
        with matplotlib.rc_context(STYLE):
            figure = predicted_against_measured(run, members)
        if figure is None:
            continue
        name = "predicted-vs-measured" if number == 0 else _file_name(members[0])
        for suffix in ("png", "svg"):
            figure.savefig(folder / f"{name}.{suffix}")
            files.append(folder / f"{name}.{suffix}")
    return files


def _file_name(record: Record) -> str:
    parts = (
        record["rasteriser"],
        record["device"],
        record["resolution"],
        f"{record['rotation']:g}",
    )
    words = "-".join(["predicted-vs-measured", *(str(part) for part in parts)])
    return "".join(letter if letter.isalnum() or letter in "-_." else "-" for letter in words)


def predicted_against_measured(run: Run, members: Sequence[Record]) -> Figure | None:
    """Draw, for each polygon, what a triangulator's criterion and cost are against the base's.

    Dividing by the base's value on the same polygon takes the polygon's size out, which would
    otherwise make every criterion look good. None where there is nothing to draw.
    """
    from matplotlib.figure import Figure

    columns = {
        record["triangulator"]: arrays
        for record in members
        if record["status"] == "ok" and (arrays := read_arrays(run, record["key"])) is not None
    }
    base = BASE if BASE in columns else next(iter(columns), None)
    measure = next((m for m in MEASURES if base and m in columns[base]), None)
    if base is None or measure is None or len(columns) < 2:
        return None
    figure = Figure(figsize=(7.0, 3.6))
    panels = figure.subplots(1, len(CRITERIA), sharey=True)
    for panel, (criterion, title) in zip(panels, CRITERIA.items(), strict=True):
        _scatter(panel, columns, base, criterion, measure)
        panel.set_xlabel(f"predicted {title}, against {base}")
    panels[0].set_ylabel(f"counted {MEASURES[measure]}, against {base}")
    first = members[0]
    figure.suptitle(
        f"{first['scene']} at {first['resolution']} px, {first['rasteriser']} on "
        f"{first['device']}: one mark a polygon",
        fontsize=9,
    )
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(labels)))
    return figure


def _scatter(
    panel: Axes, columns: dict[str, Columns], base: str, criterion: str, measure: str
) -> None:
    from scipy.stats import spearmanr

    xs, ys = [], []
    others = [name for name in columns if name != base]
    for index, name in enumerate(others):
        x = _against(columns[name], columns[base], f"predicted_{criterion}")
        y = _against(columns[name], columns[base], measure)
        fits = np.isfinite(x) & np.isfinite(y) & (x > 0) & (y > 0)
        xs.append(x[fits])
        ys.append(y[fits])
        panel.scatter(
            x[fits],
            y[fits],
            s=7,
            alpha=0.5,
            linewidths=0,
            color=COLOURS[index % len(COLOURS)],
            marker=MARKERS[index % len(MARKERS)],
            label=name,
            rasterized=True,
        )
    every_x, every_y = np.concatenate(xs), np.concatenate(ys)
    panel.set_xscale("log", base=2)
    panel.set_yscale("log", base=2)
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_formatter("{x:g}")
    if len(every_x):
        low, high = min(every_y.min(), 1.0), max(every_y.max(), 1.0)
        panel.plot([low, high], [low, high], color="black", linewidth=0.8, linestyle="--")
        panel.annotate("as predicted", (high, high), fontsize=6, ha="right", va="bottom")
    if len(set(every_x)) > 1 and len(set(every_y)) > 1:
        rank = float(spearmanr(every_x, every_y).statistic)
        panel.set_title(f"rank correlation {rank:.3f}", fontsize=8)


def _against(columns: Columns, base: Columns, name: str) -> NDArray[np.float64]:
    drawn = (columns["predicted_triangles"] > 0) & (base["predicted_triangles"] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = columns[name].astype(float) / base[name].astype(float)
    return np.where(drawn, ratio, np.nan)
