"""The picture of a profile: time against aspect at equal area."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.pictures.style import draw, look_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plot(profile: Mapping[str, Any], file: Path) -> Path:
    """Draw the picture beside a profile's file, as PNG and SVG; returns the PNG."""
    return draw(file.parent, file.stem, _figure, profile)[0]


def _figure(profile: Mapping[str, Any]) -> Figure:
    from matplotlib.figure import Figure

    areas = profile["aspects"]
    figure = Figure(figsize=(2.6 * len(areas) + 0.6, 2.9))
    row = figure.subplots(1, len(areas), sharey=True, squeeze=False)[0]
    for panel, each in zip(row, areas, strict=True):
        _panel(panel, each)
    row[0].set_ylabel("time of a triangle,\nin ratio to aspect 1:1")
    handles, labels = row[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    name = profile["device"]["name"]
    figure.suptitle(
        f"Are thin triangles slow on {name}? Equal area, mean of four angles", fontsize=9
    )
    return figure


def _panel(panel: Axes, each: Mapping[str, Any]) -> None:
    measured, lanes = look_of(0), look_of(1)
    x, y = each["aspects"], each["ratios"]
    error = [
        [value - low for value, low in zip(y, each["low"], strict=True)],
        [high - value for value, high in zip(y, each["high"], strict=True)],
    ]
    style: Any = {"color": measured.colour, "marker": measured.marker, "markersize": 4}
    panel.errorbar(x, y, yerr=error, label="measured", capsize=2, linewidth=1.3, **style)
    style = {"color": lanes.colour, "linestyle": "--", "linewidth": 1.3}
    panel.plot(x, each["lanes_alone"], label="if helper lanes alone took more", **style)
    style = {"color": look_of(2).colour, "linestyle": "-.", "linewidth": 1.3}
    panel.plot(x, each["lanes"], label="lanes shaded", **style)
    panel.axhline(2.0, color="#777777", linewidth=0.8, linestyle=":")
    if each["doubled_at"]:
        at = each["doubled_at"][0]
        panel.axvline(at, color="#777777", linewidth=0.8, linestyle=":")
        near: Any = {"textcoords": "offset points", "fontsize": 7}
        panel.annotate(f"twice at {at:.0f}:1", (at, 2.0), (-4, 5), ha="right", **near)
    panel.set_xscale("log", base=2)
    panel.set_yscale("log", base=2)
    panel.set_xticks(x, [f"{aspect}:1" for aspect in x])
    top = max(4.0, *each["high"])
    ticks = [value for value in (1, 2, 4, 8, 16, 32, 64) if value <= 1.1 * top]
    panel.set_yticks(ticks, [f"{value}" for value in ticks])
    panel.minorticks_off()
    panel.set_ylim(0.85, 1.15 * top)
    panel.set_xlabel("base in ratio to height")
    panel.set_title(f"{each['area']} px$^2$", fontsize=8)
