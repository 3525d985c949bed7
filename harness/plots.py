"""Static plots of a run, in one style that colour-blind readers can use."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.figures.groups import BASE, groups
from harness.figures.polygons import (
    CRITERIA,
    MEASURES,
    PREDICTED,
    Columns,
    columns_of,
    measures_in,
    rank_correlation,
    ratios,
)
from harness.stored.folder import Record, Run, file_stem

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

ONE_COLUMN, TWO_COLUMNS = 3.4, 7.0
"""Widths in inches of one and of two columns of a paper."""

MOST_VECTOR_MARKS = 20_000
"""Marks beyond which a panel's marks become a picture inside the SVG, to keep it small."""

PANELS = ("overdraw", "half_perimeter")
"""Criteria that get a panel each."""


def plot_run(run: Run) -> list[Path]:
    """Draw the plots of a run folder into its `plots`; returns the files written."""
    import matplotlib

    matplotlib.use("Agg", force=False)
    folder = run.path / "plots"
    folder.mkdir(exist_ok=True)
    files = []
    chosen = [m for m in groups(run.records) if any(r["status"] == "ok" for r in m)]
    place = {record["key"]: number for number, record in enumerate(run.records)}
    chosen.sort(key=lambda members: min(place[record["key"]] for record in members))
    for number, members in enumerate(chosen):
        for name, draw in (
            ("predicted-vs-measured", predicted_against_measured),
            ("ranking", ranking),
        ):
            with matplotlib.rc_context(STYLE):
                figure = draw(run, members)
                if figure is None:
                    continue
                stem = name if number == 0 else f"{name}-{_view_of(members[0])}"
                files += save(figure, folder, stem)
    return files


def marker(index: int) -> str:
    """Return the marker of series `index`: another one when the colours begin anew."""
    return MARKERS[(index + index // len(COLOURS)) % len(MARKERS)]


def save(figure: Figure, folder: Path, name: str) -> list[Path]:
    """Write a figure into `folder` as PNG and as SVG; returns the files.

    name : any text; the files' names are its `store.file_stem` with their endings
    """
    import matplotlib

    files = [folder / f"{file_stem(name)}.{suffix}" for suffix in ("png", "svg")]
    with matplotlib.rc_context(STYLE):  # it says how files are written, too
        for file in files:
            figure.savefig(file)
    return files


def _view_of(record: Record) -> str:
    names = ("rasteriser", "device", "resolution")
    return "-".join([*(str(record[name]) for name in names), f"{record['rotation']:g}"])


def predicted_against_measured(run: Run, members: Sequence[Record]) -> Figure | None:
    """Draw, for each polygon, what a triangulator's criterion and cost are against the base's.

    Dividing by the base's value on the same polygon takes the polygon's size out, which would
    otherwise make every criterion look good. None where there is nothing to draw.
    """
    from matplotlib.figure import Figure

    columns = {
        record["triangulator"]: arrays
        for record in members
        if record["status"] == "ok" and (arrays := columns_of(run, record)) is not None
    }
    base = BASE if BASE in columns else next(iter(columns), None)
    measure = next(iter(measures_in(columns[base])), None) if base else None
    if base is None or measure is None or len(columns) < 2:
        return None
    figure = Figure(figsize=(TWO_COLUMNS, 3.6))
    panels = figure.subplots(1, len(PANELS), sharey=True)
    for panel, criterion in zip(panels, PANELS, strict=True):
        _scatter(panel, columns, base, criterion, measure)
        panel.set_xlabel(f"predicted {CRITERIA[criterion]}, ratio to {base}")
    title = MEASURES.get(measure, measure.replace("_", " "))
    panels[0].set_ylabel(f"counted {title}, ratio to {base}")
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
    xs, ys = [], []
    others = [name for name in columns if name != base]
    for index, name in enumerate(others):
        x = ratios(columns[name], columns[base], PREDICTED + criterion)
        y = ratios(columns[name], columns[base], measure)
        fits = np.isfinite(x) & np.isfinite(y)
        xs.append(x[fits])
        ys.append(y[fits])
        panel.scatter(
            x[fits],
            y[fits],
            s=7,
            alpha=0.5,
            linewidths=0,
            color=COLOURS[index % len(COLOURS)],
            marker=marker(index),
            label=name,
            rasterized=len(others) * len(x) > MOST_VECTOR_MARKS,
        )
    every_x, every_y = np.concatenate(xs), np.concatenate(ys)
    panel.set_xscale("log", base=2)
    panel.set_yscale("log", base=2)
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_formatter("{x:.2g}")
    if len(every_x):
        low, high = min(every_y.min(), 1.0), max(every_y.max(), 1.0)
        panel.plot([low, high], [low, high], color="black", linewidth=0.8, linestyle="--")
        panel.annotate("as predicted", (high, high), fontsize=6, ha="right", va="bottom")
    rank = rank_correlation(every_x, every_y)
    if rank is not None:
        panel.set_title(f"rank correlation {rank:.3f}", fontsize=8)


def ranking(_: Run, members: Sequence[Record]) -> Figure | None:
    """Draw the median time of each complete triangulation with its 95 % interval, fastest on top.

    None where fewer than two were timed.
    """
    from matplotlib.figure import Figure

    timed = [record for record in members if record["status"] == "ok" and record.get("time")]
    most = max((record["polygons"] for record in timed), default=0)
    timed = [record for record in timed if record["polygons"] == most]
    if len(timed) < 2:
        return None
    timed.sort(key=lambda record: record["time"]["median_s"], reverse=True)
    figure = Figure(figsize=(ONE_COLUMN, 1.1 + 0.22 * len(timed)))
    panel = figure.subplots()
    for place, record in enumerate(timed):
        low, high = (1e3 * bound for bound in record["time"]["ci95_s"])
        colour = COLOURS[1] if record["triangulator"] == BASE else COLOURS[0]
        panel.plot([low, high], [place, place], color=colour, linewidth=2)
        panel.plot(1e3 * record["time"]["median_s"], place, "o", color=colour, markersize=4)
    panel.set_yticks(range(len(timed)), [record["triangulator"] for record in timed])
    panel.set_ylim(-0.6, len(timed) - 0.4)
    panel.set_xlabel("draw time [ms], 95 % interval")
    first = timed[0]
    figure.suptitle(
        f"{first['scene']}, {first['resolution']} px, {first['rasteriser']} on {first['device']}",
        fontsize=8,
    )
    return figure


PLOTS = {"predicted-vs-measured": predicted_against_measured, "ranking": ranking}
"""Names of files, and what draws them."""
