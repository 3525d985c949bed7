"""D against A: the front, what programs use, and how long each takes to draw."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pandas as pd

from harness.figures.ratios import FASTER
from harness.pictures.style import draw
from harness.study.pareto import NAMED, NORMALISED, WHOLE, MeasuredFront

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

COLOURS_OF_TIME = "PuOr_r"
"""Purple is faster, orange slower: told apart with any kind of colour vision."""

NUMBERS = {name: str(number) for number, name in enumerate(NAMED, start=1)}
"""What stands for a name beside its mark; the names are below the panels."""

KINDS = {"front": ("o", "of the front"), "sweep": ("o", "of the sweep"), "named": ("D", "named")}
"""Mark and words of each kind of triangulation."""

LINE, UNTIMED = "#777777", (0.8, 0.8, 0.8, 1.0)


def plot(
    table: pd.DataFrame, fronts: Mapping[str, MeasuredFront], scene: str, folder: Path
) -> list[Path]:
    """Draw one figure for each rasteriser and device, PNG and SVG, into `folder`."""
    files = []
    for (rasteriser, device), part in table.groupby(["rasteriser", "device"], sort=False):
        title = f"{scene}, {part['resolution'].iloc[0]} px: {rasteriser} on {device}"
        whole = part["polygon"] == WHOLE
        chosen = {"pareto": part[whole] if whole.any() else part}
        if whole.any() and not whole.all():
            chosen["pareto-polygons"] = part[~whole]
        for kind, rows in chosen.items():
            name = f"{kind}-{scene}-{rasteriser}-{device}"
            files += draw(folder, name, _figure, rows, fronts, title)
    return files


def _figure(rows: pd.DataFrame, fronts: Mapping[str, MeasuredFront], title: str) -> Figure:
    from matplotlib.figure import Figure

    parts = {str(polygon): part for polygon, part in rows.groupby("polygon", sort=False)}
    across = min(3, len(parts))
    down = -(-len(parts) // across)
    size = (5.6, 4.6) if len(parts) == 1 else (2.6 * across + 0.8, 2.6 * down + 0.6)
    figure = Figure(figsize=size)
    panels = figure.subplots(down, across, squeeze=False).ravel().tolist()
    norm = _norm(rows)
    known = {str(front.polygon): front for front in fronts.values()}
    for panel, (polygon, part) in zip(panels, parts.items(), strict=False):
        _panel(panel, part, known.get(polygon), norm)
        if len(parts) > 1:
            beyond = ", ".join(NUMBERS[name] for name in _beyond(panel, part))
            words = f"polygon {polygon}" + (f"\nbeyond: {beyond}" if beyond else "")
            panel.set_title(words, fontsize=7)
    for panel in panels[len(parts) :]:
        panel.set_visible(False)
    panels[0].legend(fontsize=6.5)
    if norm is not None:
        _colour_bar(figure, panels[: len(parts)], norm)
    texts = [f"{number} {name}" for name, number in NUMBERS.items()]
    half = len(texts) // 2
    figure.supxlabel("\n".join("    ".join(part) for part in (texts[:half], texts[half:])), size=7)
    figure.suptitle(title, fontsize=9)
    return figure


def _norm(rows: pd.DataFrame) -> Normalize | None:
    """Return a scale of log time ratios with 1 in its middle, None where nothing was timed."""
    from matplotlib.colors import Normalize

    if rows["time_ratio"].isna().all():
        return None
    other = rows.loc[~rows["same_as_end"], "time_ratio"].dropna()
    # Nine tenths of the ratios set the scale: one slow fan must not make all others look alike.
    limit = max(0.01, float(np.quantile(np.abs(np.log(other)), 0.9)) if len(other) else 0.0)
    return Normalize(-limit, limit)


def _panel(
    panel: Axes, part: pd.DataFrame, front: MeasuredFront | None, norm: Normalize | None
) -> None:
    """Draw a polygon's front as its steps, or of a scene the hull that the sweep reaches."""
    x, y = NORMALISED
    if front is None:
        sweep = part[(part["kind"] == "sweep") & (part["gamma"] == 0)].sort_values(x, kind="stable")
        panel.plot(sweep[x], sweep[y], color=LINE, linewidth=1, label="from A alone to D alone")
    else:
        first = part.iloc[0]  # its area (px^2) and number of triangles turn costs into the axes'
        scale = np.array([first["overdraw"] / first[x], first["shape"] / first[y]])
        if front.everything is not None:
            words = f"all {len(front.everything)} triangulations"
            cloud = front.everything / scale
            panel.scatter(cloud[:, 0], cloud[:, 1], s=6, color="#BBBBBB", label=words)
        points = f"Pareto front, {len(front.costs)} point{'s' * (len(front.costs) > 1)}"
        panel.step(*(front.costs / scale).T, where="post", color=LINE, linewidth=1, label=points)
    for kind, (mark, words) in KINDS.items():
        _marks(panel, part[part["kind"] == kind], mark, norm, words)
    named = part[part["kind"] == "named"]
    at = named.groupby([named[x].round(6), named[y].round(6)], sort=False)["triangulator"]
    near: Any = {"textcoords": "offset points", "fontsize": 6, "annotation_clip": True}
    for place, names in at:
        panel.annotate(",".join(names.map(NUMBERS)), cast("Any", place), (3, 3), **near)
    panel.set_xlabel("A over the area" if front else "A over the area, mean of the polygons")
    panel.set_ylabel("D per triangle (degrees)")
    panel.margins(0.08)


def _beyond(panel: Axes, part: pd.DataFrame) -> list[str]:
    """Show a front's neighbourhood; return what is named and lies beyond, to the right or above."""
    named = part["kind"] == "named"
    left_out = np.zeros(int(named.sum()), np.bool_)
    limits: tuple[Any, ...] = (panel.set_xlim, panel.set_ylim)
    for column, limit in zip(NORMALISED, limits, strict=True):
        low, high = part.loc[~named, column].agg(["min", "max"])
        room = max(0.6 * (high - low), 0.06 * high)
        limit(low - 0.25 * room, high + room)
        left_out |= (part.loc[named, column] > high + room).to_numpy()
    return part.loc[named, "triangulator"][left_out].tolist()


def _marks(panel: Axes, rows: pd.DataFrame, mark: str, norm: Normalize | None, words: str) -> None:
    """Draw triangulations in the colour of their times; those that are faster are ringed."""
    from matplotlib import colormaps

    if rows.empty:
        return
    logs = np.log(rows["time_ratio"].to_numpy(float))
    shown = colormaps[COLOURS_OF_TIME](np.zeros(len(rows)) if norm is None else norm(logs))
    shown[np.isnan(logs)] = UNTIMED
    faster = (rows["verdict"] == FASTER).to_numpy()
    panel.scatter(
        rows[NORMALISED[0]],
        rows[NORMALISED[1]],
        marker=mark,
        label=words,
        zorder=3,
        c=shown,
        edgecolors=np.where(faster, "black", LINE).tolist(),
        linewidths=np.where(faster, 1.3, 0.5).tolist(),
    )


def _colour_bar(figure: Figure, panels: list[Axes], norm: Normalize) -> None:
    from matplotlib.cm import ScalarMappable

    colours = ScalarMappable(norm, COLOURS_OF_TIME)
    bar = figure.colorbar(colours, ax=panels, extend="both", shrink=0.8)
    ticks = np.linspace(float(norm.vmin or 0), float(norm.vmax or 0), 5)
    bar.set_ticks(ticks.tolist(), labels=[f"{ratio:.2f}" for ratio in np.exp(ticks)])
    bar.set_label("time in ratio to the least-A end (ringed: faster)")
