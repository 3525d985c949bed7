"""The charts of docs/findings.md, drawn from the files of results as SVG.

One file serves light and dark pages: it has no background, and its text turns light where the
reader's system prefers dark.
"""

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import matplotlib
import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from docs.figures import ALIASES, LABELS
from docs.results import SCENES, csv, json_values, predicted_lanes, select, time_ratio

K = TypeVar("K")

INK, SOFT = "#24292f", "#8c959f"
FAINT: dict[str, Any] = {"color": SOFT, "linewidth": 1, "linestyle": "--", "zorder": 0}

NAMES = LABELS["triangulator"]
COMPARED = [*(ALIASES[key] for key in ("H", "refined", "Q", "A")), "delaunay"]
"""Triangulators of the charts of devices."""

_DARK = (
    "<style>@media (prefers-color-scheme: dark) {"
    f'[style*="fill: {INK}"]{{fill:#e6edf3 !important}}'
    f'[style*="stroke: {INK}"]{{stroke:#e6edf3 !important}}'
    "}</style>"
)


def _labels(names: Iterable[str]) -> list[str]:
    return [NAMES[name].strip("`") for name in names]


def _scenes(*names: str) -> dict[str, str]:
    return {name: LABELS["scene"][name] for name in names}


def choice() -> Figure:
    """Draw times relative to ear clipping, with their intervals."""
    names = [*COMPARED, "greedy"]
    figure, panels = _panels(_scenes(*SCENES), "draw time, ear clipping = 1")
    for scene, ax in panels.items():
        rows = select(f"llvmpipe/gains-{scene}/summary.csv", resolution=1024)
        rows = rows.set_index("triangulator")
        points = [(i, *time_ratio(rows.loc[n]), i) for i, n in enumerate(names) if n in rows.index]
        _dots(ax, _labels(names), points)
    return figure


def predicted() -> Figure:
    """Draw predicted and counted helper lanes, in one unit."""
    figure = Figure(figsize=(6.4, 4.6))
    ax = figure.subplots()
    lanes = predicted_lanes()
    for scene, label in _scenes(*SCENES).items():
        rows = lanes[lanes["scene"] == scene]
        ax.plot(rows["by_quads"], rows["counted"], linestyle="none", alpha=0.8, label=label)
    ends = [lanes["by_quads"].min() * 0.97, lanes["by_quads"].max() * 1.03]
    ax.plot(ends, ends, marker="", **FAINT)
    ax.set_xlabel("predicted: 4Q - S, ear clipping = 1")
    ax.set_ylabel("counted helper lanes, ear clipping = 1")
    ax.legend()
    return figure


def regret() -> Figure:
    """Draw helper lanes above the minimum, by criterion."""
    title = "helper lanes above the minimum, 1024 px"
    figure, panels = _panels(_scenes(*SCENES), title, one_scale=False)
    names = {
        "Q": "expected-quads",
        "H": "half-perimeter",
        "E": "edge-length",
        "A": "overdraw",
        "D": "shape",
    }
    for scene, ax in panels.items():
        columns = "mean/ci_low/ci_high"
        where = {"resolution": 1024, "measure": "helper_lanes", "scene": scene}
        points = []
        for row, name in enumerate(names.values()):
            (found,) = csv("cpu/regret-{scene}/regret.csv", columns, name=name, **where)
            ends = (found.value if np.isnan(end) else end for end in found)
            points.append((row, *(100 * end for end in ends), row))
        _dots(ax, list(names), points, one=None)
        ax.xaxis.set_major_formatter(lambda value, _: f"{value:g} %")
        ax.set_xlim(left=min(0.0, ax.get_xlim()[0]))
    return figure


def devices() -> Figure:
    """Draw times on four rasterisers."""
    title = "draw time, ear clipping = 1; in each row city above, Helsinki below"
    figure, panels = _panels(LABELS["summary"], title)
    for device, ax in panels.items():
        points = []
        for shift, scene in ((-0.14, "city"), (0.14, "helsinki")):
            times = _views(device, scene)
            points += [(i + shift, *times[n]["time"], i) for i, n in enumerate(COMPARED)]
        _dots(ax, _labels(COMPARED), points)
    return figure


def _views(device: str, scene: str) -> Any:
    """Return the triangulators of a device's view of a scene at 1024 px."""
    views = json_values(f"devices/{device}.json", "views.*")
    (view,) = (view for view in views if (view["scene"], view["resolution"]) == (scene, 1024))
    return view["triangulators"]


def gpu() -> Figure:
    """Draw times on a GPU at three sizes."""
    title = (
        "draw time on an H200, ear clipping = 1; in each row 256 px above, then 1024 and 4096 px"
    )
    figure, panels = _panels(_scenes("city", "glyphs"), title)
    for scene, ax in panels.items():
        points = []
        for _, row in select(f"h200/gains-{scene}/summary.csv").iterrows():
            if (name := row["triangulator"]) in COMPARED:
                index = COMPARED.index(name)
                shift = {256: -0.2, 1024: 0.0, 4096: 0.2}[row["resolution"]]
                ends = row[["time_ratio", "time_ratio_low", "time_ratio_high"]]
                points.append((index + shift, *ends, index))
        _dots(ax, _labels(COMPARED), points)
    return figure


def thin() -> Figure:
    """Draw thin triangles' times on devices, at equal area."""
    profiles = {
        label: json_values(f"reference/profiles/{name}.json", "aspects.*")
        for name, label in LABELS["profile"].items()
        if name != "webgpu-swiftshader-chromium"
    }
    first = next(iter(profiles.values()))
    titles = {aspect["area"]: f"triangles of {aspect['area']} px^2" for aspect in first}
    figure, panels = _panels(titles, "base relative to height")
    for index, (ax, reference) in enumerate(zip(panels.values(), first, strict=True)):
        for label, aspects in profiles.items():
            ax.plot(aspects[index]["aspects"], aspects[index]["ratios"], label=label)
        lanes = FAINT | {"label": "lanes shaded, counted", "marker": ""}
        ax.plot(reference["aspects"], reference["lanes"], **lanes)
        ax.set_xscale("log", base=2)
        ax.set_xticks(reference["aspects"], [f"{aspect}:1" for aspect in reference["aspects"]])
        ax.set_yscale("log", base=2)
        ax.set_yticks([1, 2, 4, 8], ["1", "2", "4", "8"])
        ax.minorticks_off()
    figure.axes[0].set_ylabel("time, 1:1 = 1")
    figure.axes[0].legend()
    return figure


CHARTS: dict[str, Callable[[], Figure]] = {
    "findings-choice": choice,
    "findings-predicted": predicted,
    "findings-regret": regret,
    "findings-devices": devices,
    "findings-gpu": gpu,
    "devices-thin": thin,
}


def _panels(
    titles: Mapping[K, str], unit: str, one_scale: bool = True
) -> tuple[Figure, dict[K, Axes]]:
    figure = Figure(figsize=(9.0, 2.9))
    axes = figure.subplots(1, len(titles), sharey=True, sharex=one_scale)
    for ax, title in zip(axes, titles.values(), strict=True):
        ax.set_title(title)
    figure.supxlabel(unit)
    return figure, dict(zip(titles, axes, strict=True))


def _dots(
    ax: Axes,
    names: Sequence[str],
    points: Iterable[tuple[float, ...]],
    one: float | None = 1.0,
) -> None:
    """Draw (row, value, low, high, kind) as marks with intervals."""
    for row, value, low, high, kind in points:
        look: Any = list(matplotlib.rcParams["axes.prop_cycle"])[int(kind)]
        ax.errorbar(value, row, xerr=[[value - low], [high - value]], markersize=5, **look)
    if one is not None:
        ax.axvline(one, **FAINT)
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.5, -0.5)


def svg(draw: Callable[[], Figure]) -> str:
    """Return a chart as the text of its file."""
    stream = io.StringIO()
    with style.context(Path(__file__).with_suffix(".mplstyle")):
        draw().savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    at = text.index("<defs>")
    lines = (text[:at] + _DARK + "\n" + text[at:]).splitlines()
    return "\n".join(line.rstrip() for line in lines) + "\n"
