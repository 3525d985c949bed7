"""D against A: the front, what programs use, and how long each takes to draw."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.figures.ratios import FASTER
from harness.pictures.style import draw
from harness.study.pareto import NAMED, NORMALISED, WHOLE, MeasuredFront

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

COLOURS_OF_TIME = "PuOr_r"
"""Purple is faster, orange slower: told apart with any kind of colour vision."""

NUMBERS = {name: number for number, name in enumerate(NAMED, start=1)}
"""What stands for a name where there is no room for it."""

MARKS = {"front": "o", "sweep": "o", "named": "D"}

LINE = "#777777"

SIDE = 0.6
"""Marks to the right of this share of the panel have their labels on the left."""

TEXT = 0.045
"""Height of a line of text, as a share of the panel's height."""


def plot(
    table: pd.DataFrame, fronts: Mapping[str, MeasuredFront], scene: str, folder: Path
) -> list[Path]:
    """Draw one figure for each rasteriser and device, PNG and SVG, into `folder`."""
    files = []
    for (rasteriser, device), part in table.groupby(["rasteriser", "device"], sort=False):
        size = part["resolution"].iloc[0]
        title = f"{scene}, {size} px: {rasteriser} on {device}"
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

    parts = [part for _, part in rows.groupby("polygon", sort=False)]
    across = min(3, len(parts))
    down = -(-len(parts) // across)
    size = (5.6, 4.2) if len(parts) == 1 else (2.6 * across + 0.8, 2.6 * down + 0.6)
    figure = Figure(figsize=size)
    panels = np.atleast_1d(figure.subplots(down, across, squeeze=False)).ravel()
    norm = _norm(rows)
    known = {str(front.polygon): front for front in fronts.values()}
    for panel, part in zip(panels, parts, strict=False):
        number = str(part["polygon"].iloc[0])
        front = known.get(number)
        _panel(panel, part, front, norm, large=len(parts) == 1)
    for panel in panels[len(parts) :]:
        panel.set_visible(False)
    if norm is not None:
        _colour_bar(figure, panels[: len(parts)].tolist(), norm)
    if len(parts) > 1:
        texts = [f"{number} {name}" for name, number in NUMBERS.items()]
        lines = ["    ".join(texts[: len(texts) // 2]), "    ".join(texts[len(texts) // 2 :])]
        figure.supxlabel("\n".join(lines), fontsize=7)
    figure.suptitle(title, fontsize=9)
    return figure


def _norm(rows: pd.DataFrame) -> Normalize | None:
    """Return a scale of log time ratios with 1 in its middle, None where nothing was timed."""
    from matplotlib.colors import Normalize

    other = rows.loc[~rows["same_as_end"], "time_ratio"].dropna()
    if rows["time_ratio"].notna().sum() == 0:
        return None
    # Nine tenths of the ratios set the scale: one slow fan must not make all others look alike.
    limit = float(np.quantile(np.abs(np.log(other)), 0.9)) if len(other) else 0.0
    return Normalize(-max(limit, 0.01), max(limit, 0.01))


def _panel(
    panel: Axes,
    part: pd.DataFrame,
    front: MeasuredFront | None,
    norm: Normalize | None,
    *,
    large: bool,
) -> None:
    if front is not None and front.everything is not None:
        cloud = front.everything / _scale(part)
        panel.scatter(cloud[:, 0], cloud[:, 1], s=6, color="#BBBBBB", linewidths=0, zorder=1)
    _line(panel, part, front)
    for kind, mark in MARKS.items():
        _marks(panel, part[part["kind"] == kind], mark, norm, size=30 if large else 22)
    panel.set_xlabel("A over the area" if front else "A over the area, mean of the polygons")
    panel.set_ylabel("D per triangle (degrees)")
    panel.margins(0.08)
    if large:
        _name(panel, part)
        _legend(panel, front)
    else:
        beyond = ", ".join(_number(panel, part))
        title = f"polygon {part['polygon'].iloc[0]}: front of {_points(front)}"
        panel.set_title(title + (f"\nbeyond: {beyond}" if beyond else ""), fontsize=7)


def _scale(part: pd.DataFrame) -> NDArray[np.float64]:
    """Return the polygon's area (px^2) and number of triangles."""
    first = part.iloc[0]
    area = first["overdraw"] / first["overdraw_over_area"]
    return np.array([area, first["shape"] / first["shape_a_triangle"]])


def _legend(panel: Axes, front: MeasuredFront | None) -> None:
    """Say what the marks are."""
    if front is None:
        line = "alpha to beta swept from A alone to D alone"
    else:
        line = f"Pareto front: {_points(front)}"
    marks = [
        _key("o", line, "white", "-"),
        _key("D", "named", "white", ""),
    ]
    if front is not None and front.everything is not None:
        marks.append(_key("o", f"all {len(front.everything)} triangulations", "#BBBBBB", ""))
    place: Literal["lower right", "center right"] = "lower right" if front else "center right"
    panel.legend(handles=marks, loc=place, fontsize=6.5)


def _points(front: MeasuredFront | None) -> str:
    size = 0 if front is None else len(front.costs)
    return f"{size} {'point' if size == 1 else 'points'}"


def _key(mark: str, text: str, fill: str, line: Literal["-", ""]) -> Line2D:
    from matplotlib.lines import Line2D

    return Line2D(
        [],
        [],
        marker=mark,
        label=text,
        color=LINE,
        markerfacecolor=fill,
        markersize=4,
        linewidth=1,
        linestyle=line,
    )


def _number(panel: Axes, part: pd.DataFrame) -> list[str]:
    """Show a front's neighbourhood; number what is named there, and return what lies beyond."""
    front = part[part["kind"] != "named"]
    rows = part[part["kind"] == "named"]
    inside = pd.Series(True, index=rows.index)
    limits = []
    for column in NORMALISED:
        low, high = float(front[column].min()), float(front[column].max())
        room = max(0.6 * (high - low), 0.06 * high)
        limits.append((low - 0.25 * room, high + room))
        inside &= rows[column] <= high + room
    panel.set_xlim(*limits[0])
    panel.set_ylim(*limits[1])
    names = rows["triangulator"].tolist()
    at: dict[tuple[float, float], list[str]] = {}
    for name, x, y in zip(names, *(rows[n] for n in NORMALISED), strict=True):
        at.setdefault((round(x, 6), round(y, 6)), []).append(str(NUMBERS[name]))
    for (x, y), numbers in at.items():
        panel.annotate(
            ",".join(numbers),
            (x, y),
            (3, 3),
            textcoords="offset points",
            fontsize=6,
            annotation_clip=True,
        )
    return [str(NUMBERS[name]) for name in rows.loc[~inside, "triangulator"]]


def _line(panel: Axes, part: pd.DataFrame, front: MeasuredFront | None) -> None:
    """Draw the front: of a polygon as its steps, of a scene as the hull that the sweep reaches."""
    if front is None:
        sweep = part[(part["kind"] == "sweep") & (part["gamma"] == 0)]
        ordered = sweep.sort_values(NORMALISED[0], kind="stable")
        panel.plot(ordered[NORMALISED[0]], ordered[NORMALISED[1]], color=LINE, linewidth=1)
        return
    a, d = (front.costs / _scale(part)).T
    panel.step(a, d, where="post", color=LINE, linewidth=1)


def _marks(
    panel: Axes, rows: pd.DataFrame, mark: str, norm: Normalize | None, *, size: float
) -> None:
    timed = rows["time_ratio"].notna()
    for own, colours in ((rows[~timed], None), (rows[timed], COLOURS_OF_TIME)):
        if own.empty:
            continue
        faster = (own["verdict"] == FASTER).tolist()
        panel.scatter(
            own[NORMALISED[0]],
            own[NORMALISED[1]],
            s=size,
            marker=mark,
            zorder=3,
            c="#CCCCCC" if colours is None else np.log(own["time_ratio"].to_numpy(float)),
            cmap=colours,
            norm=None if colours is None else norm,
            edgecolors=["black" if ringed else LINE for ringed in faster],
            linewidths=[1.3 if ringed else 0.5 for ringed in faster],
        )


def _name(panel: Axes, part: pd.DataFrame) -> None:
    """Write each named triangulator beside its mark; labels do not overlap."""
    rows = part[part["kind"] == "named"]
    left, right = panel.get_xlim()
    low, high = panel.get_ylim()
    at: dict[tuple[float, float], list[str]] = {}
    for name, x, y in zip(rows["triangulator"], *(rows[n] for n in NORMALISED), strict=True):
        place = round((x - left) / (right - left), 3), round((y - low) / (high - low), 3)
        at.setdefault(place, []).append(str(name))
    for side in (False, True):
        ours = sorted((p for p in at if (p[0] > SIDE) == side), key=lambda place: place[1])
        heights = _apart([(place[1], len(at[place])) for place in ours])
        for (x, y), height in zip(ours, heights, strict=True):
            panel.annotate(
                "\n".join(at[x, y]),
                (x, y),
                (x + (-0.05 if side else 0.05), height),
                xycoords="axes fraction",
                textcoords="axes fraction",
                ha="right" if side else "left",
                va="center",
                fontsize=6.5,
                arrowprops={"arrowstyle": "-", "color": LINE, "linewidth": 0.4, "shrinkB": 3},
            ).set_in_layout(False)


def _apart(texts: list[tuple[float, int]]) -> list[float]:
    """Return the middles of texts, (height, lines), ascending: moved up until they are apart."""
    moved: list[float] = []
    top = 0.0
    for height, lines in texts:
        moved.append(max(height, top + TEXT * lines / 2))
        top = moved[-1] + TEXT * lines / 2
    return moved


def _colour_bar(figure: Figure, panels: list[Axes], norm: Normalize) -> None:
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(
        ScalarMappable(norm, COLOURS_OF_TIME), ax=panels, extend="both", shrink=0.8
    )
    ticks = np.linspace(float(norm.vmin or 0), float(norm.vmax or 0), 5)
    bar.set_ticks(ticks.tolist(), labels=[f"{ratio:.2f}" for ratio in np.exp(ticks)])
    bar.set_label("time in ratio to the least-A end (ringed: faster)")
