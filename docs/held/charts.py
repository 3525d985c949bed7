"""The charts of docs/findings.md, drawn from the files of results as SVG.

One file serves light and dark pages: it has no background, and its text turns light where the
reader's system prefers dark.
"""

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from docs.held import findings, profiles, simulated
from docs.held.findings import SCENES
from docs.held.lookups import some
from docs.held.names import BEST_FOR_A, BEST_FOR_H, CALLED, NAMES, scenes
from docs.held.tables import ON_DEVICES, device_view

K = TypeVar("K")

INK = "#24292f"
SOFT = "#8c959f"
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Those of Okabe and Ito, which colour-blind readers can tell apart."""
MARKS = ("o", "s", "D", "^", "v", "P")

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
        points = [
            (place, *findings.time_ratio(rows.loc[name]), place)
            for place, name in enumerate(LABELS)
            if name in rows.index
        ]
        _dots(ax, list(LABELS.values()), points)
    return figure


def predicted() -> Figure:
    """Draw predicted and counted helper lanes, in one unit."""
    figure = Figure(figsize=(6.4, 4.6))
    ax = figure.subplots()
    lanes = findings.predicted_lanes()
    for place, (scene, label) in enumerate(SCENES.items()):
        mine = lanes[lanes["scene"] == scene]
        style = {"marker": MARKS[place], "color": COLOURS[place], "alpha": 0.8, "linewidths": 0}
        ax.scatter(mine["by_quads"], mine["counted"], s=22, label=label, **style)
    ends = [lanes["by_quads"].min() * 0.97, lanes["by_quads"].max() * 1.03]
    ax.plot(ends, ends, color=SOFT, linewidth=1, linestyle="--", zorder=0)
    ax.set_xlabel("predicted: 4Q - S, ear clipping = 1", color=INK)
    ax.set_ylabel("counted helper lanes, ear clipping = 1", color=INK)
    ax.legend(frameon=False, labelcolor=INK)
    _plain(ax)
    return figure


def regret() -> Figure:
    """Draw helper lanes above the fewest there are, by criterion."""
    figure, panels = _panels(SCENES, "helper lanes above the fewest, 1024 px", one_scale=False)
    chosen = ["Q", "H", "E", "A", "D"]
    for scene, ax in panels.items():
        points = []
        for place, who in enumerate(chosen):
            row = findings.regret(scene, 1024, who)[["mean", "ci_low", "ci_high"]]
            points.append((place, *(100 * row.fillna(row["mean"])), place))
        _dots(ax, chosen, points, one=None)
        ax.xaxis.set_major_formatter(lambda value, _: f"{value:g} %")
        ax.set_xlim(left=min(0.0, ax.get_xlim()[0]))
    return figure


def devices() -> Figure:
    """Draw times on four rasterisers."""
    unit = "draw time, ear clipping = 1; in each row city above, Helsinki below"
    figure, panels = _panels(CALLED["devices"], unit)
    for device, ax in panels.items():
        views = {
            shift: device_view(device, scene)["triangulators"]
            for shift, scene in ((-0.14, "city"), (0.14, "helsinki"))
        }
        points = [
            (place + shift, *view[name]["time"], place)
            for place, name in enumerate(ON_DEVICES)
            for shift, view in views.items()
        ]
        _dots(ax, [LABELS[name] for name in ON_DEVICES], points)
    return figure


def thin() -> Figure:
    """Draw thin triangles' times on devices, at equal area."""
    first = profiles.profile(next(iter(profiles.TIMED)))["aspects"]
    titles = {each["area"]: f"triangles of {each['area']} px^2" for each in first}
    figure, panels = _panels(titles, "base in ratio to height")
    axes = list(panels.values())
    for place, (name, label) in enumerate(profiles.TIMED.items()):
        for ax, each in zip(axes, profiles.profile(name)["aspects"], strict=True):
            ax.plot(each["aspects"], each["ratios"], label=label, linewidth=1.5, **_line(place))
    for ax, each in zip(axes, first, strict=True):
        lanes = {"color": SOFT, "linestyle": "--", "linewidth": 1.5}
        ax.plot(each["aspects"], each["lanes"], label="lanes shaded, counted", **lanes)
        ax.set_xscale("log", base=2)
        ax.set_xticks(each["aspects"], [f"{aspect}:1" for aspect in each["aspects"]])
        ax.set_yscale("log", base=2)
        ax.set_yticks([1, 2, 4, 8], ["1", "2", "4", "8"])
        ax.minorticks_off()
    axes[0].set_ylabel("time, 1:1 = 1", color=INK)
    axes[0].legend(frameon=False, labelcolor=INK, fontsize=8)
    return figure


def hidden() -> Figure:
    """Draw cycles over ear clipping's, by cycles that a quad is shaded for."""
    figure, panels = _panels(simulated.SCENES, "cycles that a quad is shaded for")
    names = (BEST_FOR_H, "flips:l1", BEST_FOR_A)
    designs = {"0": "skybox"} | {f"{k:g}": f"skybox:shader={k:g}" for k in simulated.SHADERS}
    for scene, ax in panels.items():
        for kind, name in enumerate(names):
            values = [simulated.saved(scene, name, device) for device in designs.values()]
            label = simulated.LABELS[name].strip("`")
            ax.plot(range(len(designs)), values, label=label, **_line(kind))
        quads = simulated.saved(scene, BEST_FOR_H, of="quads")
        ax.axhline(quads, color=SOFT, linewidth=1, linestyle="--", zorder=0)
        ax.set_xticks(range(len(designs)), list(designs))
    panels["helsinki"].set_ylabel("cycles, ear clipping = 1", color=INK, fontsize=9)
    panels["stress"].legend(fontsize=8, frameon=False, labelcolor=INK)
    return figure


def hardware() -> Figure:
    """Draw cycles in ratio to ear clipping's on simulated designs."""
    figure, panels = _panels(
        scenes("helsinki", "glyphs", "cad"), "cycles at 256 px, ear clipping = 1"
    )
    designs: dict[str, Callable[[str, str], float]] = {
        "Skybox's raster slice": simulated.saved,
        "and 8 cycles a quad": lambda *of: simulated.saved(*of, "skybox:shader=8"),
        "ATTILA, a whole GPU": lambda *of: simulated.in_whole(of[0], "shipped", of[1])["ratio"],
    }
    names = simulated.LABELS
    for scene, ax in panels.items():
        for kind, (label, ratio) in enumerate(designs.items()):
            values = [ratio(scene, name) for name in names]
            style = _line(kind) | {"markersize": 5, "linestyle": "none"}
            ax.plot(values, range(len(names)), label=label, **style)
        ax.axvline(1.0, color=SOFT, linewidth=1, linestyle="--", zorder=0)
        ax.set_yticks(range(len(names)), [label.strip("`") for label in names.values()])
        ax.set_ylim(len(names) - 0.5, -2.7)  # room for the legend
    panels["cad"].legend(fontsize=8, frameon=False, labelcolor=INK, loc="upper left")
    return figure


CHARTS: dict[str, Callable[[], Figure]] = {
    "findings-choice": choice,
    "findings-predicted": predicted,
    "findings-regret": regret,
    "findings-devices": devices,
    "devices-thin": thin,
    "simulated-shader": hidden,
    "simulated-choice": hardware,
}


def _panels(
    titles: Mapping[K, str], unit: str, one_scale: bool = True
) -> tuple[Figure, dict[K, Axes]]:
    figure = Figure(figsize=(9.0, 2.9))
    axes = figure.subplots(1, len(titles), sharey=True, sharex=one_scale)
    for ax, title in zip(axes, titles.values(), strict=True):
        ax.set_title(title, color=INK, fontsize=10)
        _plain(ax)
    figure.supxlabel(unit, color=INK, fontsize=10)
    return figure, dict(zip(titles, axes, strict=True))


def _line(kind: int) -> dict[str, Any]:
    return {"color": COLOURS[kind], "marker": MARKS[kind], "markersize": 4}


def _dots(
    ax: Axes,
    names: Sequence[str],
    points: Iterable[Sequence[float]],
    one: float | None = 1.0,
) -> None:
    """Draw (row, value, low, high, kind) as marks with intervals."""
    for row, value, low, high, kind in points:
        ax.plot([low, high], [row, row], color=COLOURS[int(kind)], linewidth=1.6)
        ax.plot(value, row, **_line(int(kind)) | {"markersize": 5, "linestyle": "none"})
    if one is not None:
        ax.axvline(one, color=SOFT, linewidth=1, linestyle="--", zorder=0)
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.5, -0.5)


def _plain(ax: Axes) -> None:
    ax.spines[["top", "right"]].set_visible(False)
    ax.spines[["left", "bottom"]].set_color(SOFT)
    ax.tick_params(colors=INK, labelsize=9)
    ax.grid(color=SOFT, alpha=0.25, linewidth=0.6)
    ax.set_axisbelow(True)


def svg(figure: Figure) -> str:
    """Return a chart as the text of its file."""
    for ax in figure.axes:
        ax.patch.set_alpha(0.0)
    figure.patch.set_alpha(0.0)
    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "findings"}):
        figure.tight_layout()
        figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    text = stream.getvalue()
    at = text.index("<defs>")
    lines = (text[:at] + _DARK + "\n" + text[at:]).splitlines()
    return "\n".join(line.rstrip() for line in lines) + "\n"
