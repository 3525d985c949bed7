"""Plots of a history: a panel for each group of cases, a line for each triangulator."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.figures.registry import find
from harness.history.series import TIME, TOGETHER, Series
from harness.machine.environment import commit_of
from harness.stored.folder import Run
from harness.style import COLOURS, MARKERS, draw

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LABELS = 12
"""Most runs that are named along the axis."""


def plot_history(runs: Sequence[Run], series: Sequence[Series], folder: Path) -> list[Path]:
    """Draw each metric into `folder` as PNG and SVG; returns the files written."""
    files = []
    for metric in dict.fromkeys(entry.metric for entry in series):
        chosen = [entry for entry in series if entry.metric == metric]
        files += draw(folder, metric, metric_figure, runs, chosen)
    return files


def metric_figure(runs: Sequence[Run], series: Sequence[Series]) -> Figure:
    """Draw the series of one metric, changes marked by a ring and the content's by a line."""
    from matplotlib.figure import Figure

    titles = list(dict.fromkeys(entry.name.where for entry in series))
    names = list(dict.fromkeys(entry.name.triangulator for entry in series))
    figure = Figure(figsize=(7.0, 0.8 + 2.4 * len(titles)))
    panels = figure.subplots(len(titles), 1, sharex=True, squeeze=False)[:, 0]
    for panel, title in zip(panels, titles, strict=True):
        for entry in series:
            if entry.name.where == title:
                _line(panel, entry, names.index(entry.name.triangulator))
        _content(panel, next(entry for entry in series if entry.name.where == title))
        panel.set_title(title, fontsize=8, loc="left")
        panel.set_ylabel(label(series[0].metric))
    _name_runs(panels[-1], runs)
    told = (panel.get_legend_handles_labels() for panel in panels)
    handles = {text: each for two in told for each, text in zip(*two, strict=True)}
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def label(metric: str) -> str:
    """Return what a metric's axis is called."""
    if metric == TIME:
        return "time, relative"
    figure = find(metric)
    return f"{figure.title}, {figure.unit}"


def _line(panel: Axes, entry: Series, number: int) -> None:
    together = entry.name.triangulator == TOGETHER
    colour = "#999999" if together else COLOURS[number % (len(COLOURS) - 1)]
    places = np.arange(len(entry.values))
    style = (":" if together else "-") + MARKERS[number % len(MARKERS)]
    label = entry.name.triangulator
    panel.plot(places, entry.values, style, color=colour, markersize=3, linewidth=1, label=label)
    for place in entry.changes:
        ring: Any = {"markersize": 9, "markerfacecolor": "none", "markeredgewidth": 1.5}
        panel.plot(place, entry.values[place], "o", markeredgecolor=colour, **ring)
        panel.axvline(place - 0.5, color=colour, linewidth=0.8, linestyle="--")


def _content(panel: Axes, entry: Series) -> None:
    """Mark where the scene's content changed, so that no one takes it for a change of code."""
    known = [(n, text) for n, text in enumerate(entry.content) if text]
    for (_, before), (place, now) in pairwise(known):
        if before != now:
            panel.axvline(place - 0.5, color="black", linewidth=1.2)
            look: Any = {"rotation": 90, "fontsize": 6, "va": "top", "ha": "right"}
            coordinates = ("data", "axes fraction")
            panel.annotate("content changed", (place - 0.5, 1), xycoords=coordinates, **look)


def _name_runs(panel: Axes, runs: Sequence[Run]) -> None:
    step = max(1, -(-len(runs) // LABELS))
    places = range(0, len(runs), step)
    panel.set_xticks(list(places), [run_label(runs[place]) for place in places], rotation=30)
    panel.tick_params(axis="x", labelsize=6)


def run_label(run: Run) -> str:
    """Return a run's commit if known, else the name of its folder, and its day."""
    name = commit_of(run.facts)[:8] or run.path.name
    day = str(run.facts.get("created") or "")[:10]
    return f"{name}\n{day}" if day else name
