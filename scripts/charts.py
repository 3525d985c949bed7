"""Charts of docs/findings.md, drawn as SVG from the files of results.

The same file serves light and dark pages: the background is transparent, and the text turns light
if the reader's system prefers dark colours.
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
CHARTED = [*(ALIASES[key] for key in ("H", "refined", "Q", "A")), "delaunay"]
"""Triangulators in the charts of devices."""

STAGES = {
    "vertices": "vertex batches",
    "triangles": "covering triangles, helper lanes",
    "pixels": "quads, helper lanes",
}
"""Titles of the stages of `scripts/studies/gpu.py`."""

_DARK = (
    "<style>@media (prefers-color-scheme: dark) {"
    f'[style*="fill: {INK}"]{{fill:#e6edf3 !important}}'
    f'[style*="stroke: {INK}"]{{stroke:#e6edf3 !important}}'
    "}</style>"
)


def _short_labels(names: Iterable[str]) -> list[str]:
    return [NAMES[name].strip("`") for name in names]


def _scene_labels(*names: str) -> dict[str, str]:
    return {name: LABELS["scene"][name] for name in names}


def plot_choice() -> Figure:
    """Plot draw times relative to ear clipping, with confidence intervals."""
    names = [*CHARTED, "greedy"]
    figure, panels = _make_panels(_scene_labels(*SCENES), "draw time, ear clipping = 1")
    for scene, ax in panels.items():
        rows = select(f"llvmpipe/gains-{scene}/summary.csv", resolution=1024)
        rows = rows.set_index("triangulator")
        points = [(i, *time_ratio(rows.loc[n]), i) for i, n in enumerate(names) if n in rows.index]
        _plot_dots(ax, _short_labels(names), points)
    return figure


def plot_predicted() -> Figure:
    """Plot counted helper lanes against predicted helper lanes, both relative to ear clipping."""
    figure = Figure(figsize=(6.4, 4.6))
    ax = figure.subplots()
    lanes = predicted_lanes()
    for scene, label in _scene_labels(*SCENES).items():
        rows = lanes[lanes["scene"] == scene]
        ax.plot(rows["by_quads"], rows["counted"], linestyle="none", alpha=0.8, label=label)
    ends = [lanes["by_quads"].min() * 0.97, lanes["by_quads"].max() * 1.03]
    ax.plot(ends, ends, marker="", **FAINT)
    ax.set_xlabel("predicted: 4Q - S, ear clipping = 1")
    ax.set_ylabel("counted helper lanes, ear clipping = 1")
    ax.legend()
    return figure


def plot_regret() -> Figure:
    """Plot helper lanes above the minimum, by criterion."""
    title = "helper lanes above the minimum, 1024 px"
    figure, panels = _make_panels(_scene_labels(*SCENES), title, one_scale=False)
    names = {
        "Q": "expected-quads",
        "H": "half-perimeter",
        "E": "edge-length",
        "A": "overdraw",
        "D": "shape",
    }
    for scene, ax in panels.items():
        columns = "mean/ci_low/ci_high"
        filters = {"resolution": 1024, "measure": "helper_lanes", "scene": scene}
        points = []
        for row, name in enumerate(names.values()):
            (interval,) = csv("cpu/regret-{scene}/regret.csv", columns, name=name, **filters)
            ends = (interval.value if np.isnan(end) else end for end in interval)
            points.append((row, *(100 * end for end in ends), row))
        _plot_dots(ax, list(names), points, reference=None)
        ax.xaxis.set_major_formatter(lambda value, _: f"{value:g} %")
        ax.set_xlim(left=min(0.0, ax.get_xlim()[0]))
    return figure


def plot_devices() -> Figure:
    """Plot draw times on four rasterisers."""
    title = "draw time, ear clipping = 1; in each row city above, Helsinki below"
    figure, panels = _make_panels(LABELS["summary"], title)
    for device, ax in panels.items():
        points = []
        for shift, scene in ((-0.14, "city"), (0.14, "helsinki")):
            times = _read_triangulators(device, scene)
            points += [(i + shift, *times[n]["time"], i) for i, n in enumerate(CHARTED)]
        _plot_dots(ax, _short_labels(CHARTED), points)
    return figure


def _read_triangulators(device: str, scene: str) -> Any:
    """Return the metrics by triangulator of a scene at 1024 px on a device."""
    views = json_values(f"devices/{device}.json", "views.*")
    (view,) = (view for view in views if (view["scene"], view["resolution"]) == (scene, 1024))
    return view["triangulators"]


def plot_gpu() -> Figure:
    """Plot draw times on a GPU at three resolutions."""
    title = (
        "draw time on an H200, ear clipping = 1; in each row 256 px above, then 1024 and 4096 px"
    )
    figure, panels = _make_panels(_scene_labels("city", "glyphs"), title)
    for scene, ax in panels.items():
        points = []
        for _, row in select(f"h200/gains-{scene}/summary.csv").iterrows():
            if (name := row["triangulator"]) in CHARTED:
                index = CHARTED.index(name)
                shift = {256: -0.2, 1024: 0.0, 4096: 0.2}[row["resolution"]]
                interval = row[["time_ratio", "time_ratio_low", "time_ratio_high"]]
                points.append((index + shift, *interval, index))
        _plot_dots(ax, _short_labels(CHARTED), points)
    return figure


def plot_stages() -> Figure:
    """Plot each case's time on a GPU against the time of the law, coloured by the binding stage."""
    figure = Figure(figsize=(9.0, 3.6))
    axes = figure.subplots(1, len(STAGES), sharex=True, sharey=True)
    table = select("h200/judged.csv", work=0, samples=1)
    ends = [0.9 * table["measured_ns"].min() / 1e3, 1.1 * table["measured_ns"].max() / 1e3]
    for ax, (stage, title) in zip(axes, STAGES.items(), strict=True):
        for binding, colours in zip(STAGES, matplotlib.rcParams["axes.prop_cycle"], strict=False):
            rows = table[table["stage"] == binding]
            line_style: Any = {**colours, "linestyle": "none", "alpha": 0.6}
            line_style["label"] = f"{binding} bind"
            ax.plot(rows[f"{stage}_ns"] / 1e3, rows["measured_ns"] / 1e3, **line_style)
        ax.plot(ends, ends, marker="", **FAINT)
        ax.set_xscale("log")
        ax.set_yscale("log")
        ax.set_title(title)
    axes[0].set_ylabel("measured time, us")
    axes[0].legend()
    figure.supxlabel("time that the law gives to the stage, us")
    return figure


def plot_thin() -> Figure:
    """Plot the times of sliver triangles of equal area, by device."""
    profiles = {
        label: json_values(f"reference/profiles/{name}.json", "aspects.*")
        for name, label in LABELS["profile"].items()
        if name != "webgpu-swiftshader-chromium"
    }
    first = next(iter(profiles.values()))
    titles = {aspect["area"]: f"triangles of {aspect['area']} px^2" for aspect in first}
    figure, panels = _make_panels(titles, "base relative to height")
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
    "findings-choice": plot_choice,
    "findings-predicted": plot_predicted,
    "findings-regret": plot_regret,
    "findings-devices": plot_devices,
    "findings-gpu": plot_gpu,
    "gpu-stages": plot_stages,
    "devices-thin": plot_thin,
}


def _make_panels(
    titles: Mapping[K, str], unit: str, one_scale: bool = True
) -> tuple[Figure, dict[K, Axes]]:
    figure = Figure(figsize=(9.0, 2.9))
    axes = figure.subplots(1, len(titles), sharey=True, sharex=one_scale)
    for ax, title in zip(axes, titles.values(), strict=True):
        ax.set_title(title)
    figure.supxlabel(unit)
    return figure, dict(zip(titles, axes, strict=True))


def _plot_dots(
    ax: Axes,
    names: Sequence[str],
    points: Iterable[tuple[float, ...]],
    reference: float | None = 1.0,
) -> None:
    """Plot points (row, value, low, high, kind) with intervals.

    reference : position of a dashed vertical line, or None
    """
    for row, value, low, high, kind in points:
        line_style: Any = list(matplotlib.rcParams["axes.prop_cycle"])[int(kind)]
        ax.errorbar(value, row, xerr=[[value - low], [high - value]], markersize=5, **line_style)
    if reference is not None:
        ax.axvline(reference, **FAINT)
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.5, -0.5)


def render_svg(draw: Callable[[], Figure]) -> str:
    """Return a chart as the text of an SVG file."""
    stream = io.StringIO()
    with style.context(Path(__file__).with_suffix(".mplstyle")):
        draw().savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    position = text.index("<defs>")
    lines = (text[:position] + _DARK + "\n" + text[position:]).splitlines()
    return "\n".join(line.rstrip() for line in lines) + "\n"
