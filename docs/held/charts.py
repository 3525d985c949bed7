"""The charts of docs/findings.md, drawn from the files of results as SVG.

One file serves light and dark pages: it has no background, and its text turns light where the
reader's system prefers dark.
"""

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import matplotlib
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from docs.held import findings, profiles, simulated
from docs.held.findings import SCENES
from docs.held.lookups import some
from docs.held.names import CALLED, NAMES, scenes
from docs.held.tables import ON_DEVICES, device_view

K = TypeVar("K")

INK, SOFT = "#24292f", "#8c959f"
FAINT: dict[str, Any] = {"color": SOFT, "linewidth": 1, "linestyle": "--", "zorder": 0}

LABELS = {name: NAMES[name].strip("`") for name in (*ON_DEVICES, "greedy")}

_DARK = (
    "<style>@media (prefers-color-scheme: dark) {"
    f'[style*="fill: {INK}"]{{fill:#e6edf3 !important}}'
    f'[style*="stroke: {INK}"]{{stroke:#e6edf3 !important}}'
    "}</style>"
)


def choice() -> Figure:
    """Draw times in ratio to ear clipping's, with their intervals."""
    figure, panels = _panels(SCENES, "draw time, ear clipping = 1")
    for scene, ax in panels.items():
        rows = some(findings.run_of(scene), resolution=1024).set_index("triangulator")
        drawn = {place: name for place, name in enumerate(LABELS) if name in rows.index}
        points = [(at, *findings.time_ratio(rows.loc[drawn[at]]), at) for at in drawn]
        _dots(ax, list(LABELS.values()), points)
    return figure


def predicted() -> Figure:
    """Draw predicted and counted helper lanes, in one unit."""
    figure = Figure(figsize=(6.4, 4.6))
    ax = figure.subplots()
    lanes = findings.predicted_lanes()
    for scene, label in SCENES.items():
        mine = lanes[lanes["scene"] == scene]
        ax.plot(mine["by_quads"], mine["counted"], linestyle="none", alpha=0.8, label=label)
    ends = [lanes["by_quads"].min() * 0.97, lanes["by_quads"].max() * 1.03]
    ax.plot(ends, ends, marker="", **FAINT)
    ax.set_xlabel("predicted: 4Q - S, ear clipping = 1")
    ax.set_ylabel("counted helper lanes, ear clipping = 1")
    ax.legend()
    return figure


def regret() -> Figure:
    """Draw helper lanes above the fewest there are, by criterion."""
    figure, panels = _panels(SCENES, "helper lanes above the fewest, 1024 px", one_scale=False)
    chosen = ["Q", "H", "E", "A", "D"]
    for scene, ax in panels.items():
        rows = [findings.regret(scene, 1024, who)[["mean", "ci_low", "ci_high"]] for who in chosen]
        points = [(at, *(100 * row.fillna(row["mean"])), at) for at, row in enumerate(rows)]
        _dots(ax, chosen, points, one=None)
        ax.xaxis.set_major_formatter(lambda value, _: f"{value:g} %")
        ax.set_xlim(left=min(0.0, ax.get_xlim()[0]))
    return figure


def devices() -> Figure:
    """Draw times on four rasterisers."""
    unit = "draw time, ear clipping = 1; in each row city above, Helsinki below"
    figure, panels = _panels(CALLED["devices"], unit)
    for device, ax in panels.items():
        points = [
            (place + shift, *device_view(device, scene)["triangulators"][name]["time"], place)
            for shift, scene in ((-0.14, "city"), (0.14, "helsinki"))
            for place, name in enumerate(ON_DEVICES)
        ]
        _dots(ax, [LABELS[name] for name in ON_DEVICES], points)
    return figure


def gpu() -> Figure:
    """Draw times on a GPU at its sizes."""
    unit = "draw time on an H200, ear clipping = 1; in each row 256 px above, then 1024 and 4096 px"
    figure, panels = _panels(scenes("city", "glyphs"), unit)
    for scene, ax in panels.items():
        for _, row in some(f"h200/gains-{scene}/summary.csv").iterrows():
            if (name := row["triangulator"]) in ON_DEVICES:
                at = ON_DEVICES.index(name)
                shift = {256: -0.2, 1024: 0.0, 4096: 0.2}[row["resolution"]]
                ends = row[["time_ratio", "time_ratio_low", "time_ratio_high"]]
                _dots(ax, [LABELS[each] for each in ON_DEVICES], [(at + shift, *ends, at)])
    return figure


def thin() -> Figure:
    """Draw thin triangles' times on devices, at equal area."""
    first = profiles.profile(next(iter(profiles.TIMED)))["aspects"]
    titles = {each["area"]: f"triangles of {each['area']} px^2" for each in first}
    figure, panels = _panels(titles, "base in ratio to height")
    for ax, each in zip(panels.values(), first, strict=True):
        for name, label in profiles.TIMED.items():
            (its,) = (a for a in profiles.profile(name)["aspects"] if a["area"] == each["area"])
            ax.plot(its["aspects"], its["ratios"], label=label)
        lanes = FAINT | {"label": "lanes shaded, counted", "marker": ""}
        ax.plot(each["aspects"], each["lanes"], **lanes)
        ax.set_xscale("log", base=2)
        ax.set_xticks(each["aspects"], [f"{aspect}:1" for aspect in each["aspects"]])
        ax.set_yscale("log", base=2)
        ax.set_yticks([1, 2, 4, 8], ["1", "2", "4", "8"])
        ax.minorticks_off()
    figure.axes[0].set_ylabel("time, 1:1 = 1")
    figure.axes[0].legend()
    return figure


def hardware() -> Figure:
    """Draw cycles in ratio to ear clipping's on simulated designs."""
    unit = "cycles at 256 px, ear clipping = 1"
    figure, panels = _panels(scenes("helsinki", "glyphs", "cad"), unit)
    designs: dict[str, Callable[[str, str], float]] = {
        "Skybox's raster slice": simulated.saved,
        "and 8 cycles a quad": lambda *of: simulated.saved(*of, "skybox:shader=8"),
        "ATTILA, a whole GPU": lambda *of: simulated.in_whole(of[0], "shipped", of[1])["ratio"],
    }
    names = simulated.LABELS
    for scene, ax in panels.items():
        for label, ratio in designs.items():
            values = [ratio(scene, name) for name in names]
            ax.plot(values, range(len(names)), label=label, linestyle="none")
        _dots(ax, [label.strip("`") for label in names.values()], ())
        ax.set_ylim(top=-2.7)  # room for the legend
    panels["cad"].legend(loc="upper left")
    return figure


CHARTS: dict[str, Callable[[], Figure]] = {
    "findings-choice": choice,
    "findings-predicted": predicted,
    "findings-regret": regret,
    "findings-devices": devices,
    "findings-gpu": gpu,
    "devices-thin": thin,
    "simulated-choice": hardware,
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
