"""The charts of docs/findings.md, drawn from the files of results as SVG.

One file serves light and dark pages: it has no background, and its text turns light where the
reader's system prefers dark.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from docs.held import profiles, simulated, tables
from docs.held.tables import BEST_FOR_H, DEVICES, REFINED, SCENES, SHOWN

INK = "#24292f"
SOFT = "#8c959f"
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Those of Okabe and Ito, which colour-blind readers can tell apart."""
MARKS = ("o", "s", "D", "^", "v", "P")

LABELS = {
    BEST_FOR_H: "best for H",
    REFINED: "refined",
    "optimal:expected-quads": "best for Q",
    "optimal:overdraw": "best for A",
    "delaunay": "Delaunay",
    "greedy": "greedy",
}

_DARK = (
    "<style>@media (prefers-color-scheme: dark) {"
    f'[style*="fill: {INK}"]{{fill:#e6edf3 !important}}'
    f'[style*="stroke: {INK}"]{{stroke:#e6edf3 !important}}'
    "}</style>"
)


def choice() -> str:
    """Return the chart of draw times in ratio to ear clipping's, with their intervals."""
    figure, axes = _figure(len(SCENES), "draw time, ear clipping = 1")
    for ax, (scene, label) in zip(axes, SCENES.items(), strict=True):
        file = tables.run_of(scene)
        rows = {row["triangulator"]: row for row in tables.some(file, resolution=1024)}
        shown = [name for name in LABELS if name in rows]
        _dots(
            ax,
            label,
            [LABELS[name] for name in LABELS],
            [
                (list(LABELS).index(name), *tables.time_ratio(rows[name]), list(LABELS).index(name))
                for name in shown
            ],
        )
    return _svg(figure)


def predicted() -> str:
    """Return the chart of predicted and counted helper lanes, in one unit."""
    figure = Figure(figsize=(6.4, 4.6))
    ax = figure.subplots()
    rows = tables.predicted_lanes()
    for place, (scene, label) in enumerate(SCENES.items()):
        mine = [row for row in rows if row[0] == scene]
        ax.scatter(
            [row[1] for row in mine],
            [row[3] for row in mine],
            s=22,
            marker=MARKS[place],
            color=COLOURS[place],
            alpha=0.8,
            linewidths=0,
            label=label,
        )
    ends = [min(row[1] for row in rows) * 0.97, max(row[1] for row in rows) * 1.03]
    ax.plot(ends, ends, color=SOFT, linewidth=1, linestyle="--", zorder=0)
    ax.set_xlabel("predicted: 4Q - S, ear clipping = 1", color=INK)
    ax.set_ylabel("counted helper lanes, ear clipping = 1", color=INK)
    ax.legend(frameon=False, labelcolor=INK)
    _plain(ax)
    return _svg(figure)


def regret() -> str:
    """Return the chart of helper lanes above the fewest there are, by criterion."""
    figure, axes = _figure(len(SCENES), "helper lanes above the fewest, 1024 px", one_scale=False)
    chosen = ("Q", "H", "E", "A", "D")
    for ax, (scene, label) in zip(axes, SCENES.items(), strict=True):
        points = []
        for place, who in enumerate(chosen):
            row = tables.regret("cpu", scene, 1024, who, "helper_lanes")
            ends = (row[name] or row["mean"] for name in ("mean", "ci_low", "ci_high"))
            mean, low, high = (100 * float(end) for end in ends)
            points.append((place, mean, low, high, place))
        _dots(ax, label, list(chosen), points, one=None)
        ax.xaxis.set_major_formatter(lambda value, _: f"{value:g} %")
        ax.set_xlim(left=min(0.0, ax.get_xlim()[0]))
    return _svg(figure)


def devices() -> str:
    """Return the chart of draw times on four rasterisers."""
    figure, axes = _figure(
        len(DEVICES), "draw time, ear clipping = 1; in each row city above, Helsinki below"
    )
    for ax, (device, label) in zip(axes, DEVICES.items(), strict=True):
        points = []
        for place, name in enumerate(SHOWN):
            for shift, scene in ((-0.14, "city"), (0.14, "helsinki")):
                value, low, high = tables.device_view(device, scene)["triangulators"][name]["time"]
                points.append((place + shift, value, low, high, place))
        _dots(ax, label, [LABELS[name] for name in SHOWN], points)
    return _svg(figure)


def thin() -> str:
    """Return the chart of thin triangles' times on devices, at equal area."""
    first = profiles.profile(next(iter(profiles.PROFILES)))["aspects"]
    figure, axes = _figure(len(first), "base in ratio to height")
    for place, (name, label) in enumerate(profiles.TIMED.items()):
        for ax, each in zip(axes, profiles.profile(name)["aspects"], strict=True):
            style = {"color": COLOURS[place], "marker": MARKS[place], "markersize": 4}
            ax.plot(each["aspects"], each["ratios"], label=label, linewidth=1.5, **style)
    for ax, each in zip(axes, first, strict=True):
        lanes = {"color": SOFT, "linestyle": "--", "linewidth": 1.5}
        ax.plot(each["aspects"], each["lanes"], label="lanes shaded, counted", **lanes)
        ax.set_xscale("log", base=2)
        ax.set_xticks(each["aspects"], [f"{aspect}:1" for aspect in each["aspects"]])
        ax.set_yscale("log", base=2)
        ax.set_yticks([1, 2, 4, 8], ["1", "2", "4", "8"])
        ax.minorticks_off()
        ax.set_title(f"triangles of {each['area']} px^2", color=INK, fontsize=10)
        _plain(ax)
    axes[0].set_ylabel("time, 1:1 = 1", color=INK)
    axes[0].legend(frameon=False, labelcolor=INK, fontsize=8)
    return _svg(figure)


def hidden() -> str:
    """Return the chart of cycles over ear clipping's, by cycles that a quad is shaded for."""
    figure, axes = _figure(len(simulated.SCENES), "cycles that a quad is shaded for")
    names = ("optimal:half-perimeter", "flips:l1", "optimal:overdraw")
    ks = (0.0, *simulated.SHADERS)
    for ax, (scene, label) in zip(axes, simulated.SCENES.items(), strict=True):
        for kind, name in enumerate(names):
            values = [
                simulated.saved(scene, name, device=f"skybox:shader={k:g}" if k else "skybox")
                for k in ks
            ]
            style = {"color": COLOURS[kind], "marker": MARKS[kind], "markersize": 4}
            ax.plot(range(len(ks)), values, label=simulated.LABELS[name].strip("`"), **style)
        quads = simulated.saved(scene, names[0], of="quads")
        ax.axhline(quads, color=SOFT, linewidth=1, linestyle="--", zorder=0)
        ax.set_xticks(range(len(ks)), [f"{k:g}" for k in ks])
        ax.set_title(label, color=INK, fontsize=10)
        _plain(ax)
    axes[0].set_ylabel("cycles, ear clipping = 1", color=INK, fontsize=9)
    axes[-1].legend(fontsize=8, frameon=False, labelcolor=INK)
    return _svg(figure)


def hardware() -> str:
    """Return the chart of cycles in ratio to ear clipping's on simulated designs."""
    scenes = [name for name in simulated.SCENES if name in simulated.OF_ATTILA]
    figure, axes = _figure(len(scenes), "cycles at 256 px, ear clipping = 1")
    designs: dict[str, Callable[[str, str], float]] = {
        "Skybox's raster slice": lambda scene, name: simulated.saved(scene, name),
        "and 8 cycles a quad": lambda scene, name: simulated.saved(
            scene, name, device="skybox:shader=8"
        ),
        "ATTILA, a whole GPU": lambda scene, name: float(
            simulated.in_whole(scene, "shipped", name)["ratio"]
        ),
    }
    names = list(simulated.LABELS)
    for ax, scene in zip(axes, scenes, strict=True):
        for kind, (label, ratio) in enumerate(designs.items()):
            values = [ratio(scene, name) for name in names]
            style = {"color": COLOURS[kind], "marker": MARKS[kind], "markersize": 5}
            ax.plot(values, range(len(names)), linestyle="none", label=label, **style)
        ax.axvline(1.0, color=SOFT, linewidth=1, linestyle="--", zorder=0)
        ax.set_title(simulated.SCENES[scene], color=INK, fontsize=10)
        ax.set_yticks(range(len(names)), [simulated.LABELS[name].strip("`") for name in names])
        ax.set_ylim(len(names) - 0.5, -2.7)  # room for the legend
        _plain(ax)
    axes[-1].legend(fontsize=8, frameon=False, labelcolor=INK, loc="upper left")
    return _svg(figure)


CHARTS: dict[str, Callable[[], str]] = {
    "findings-choice": choice,
    "findings-predicted": predicted,
    "findings-regret": regret,
    "findings-devices": devices,
    "devices-thin": thin,
    "simulated-shader": hidden,
    "simulated-choice": hardware,
}


def _figure(panels: int, unit: str, one_scale: bool = True) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure(figsize=(9.0, 2.9))
    axes = figure.subplots(1, panels, sharey=True, sharex=one_scale)
    figure.supxlabel(unit, color=INK, fontsize=10)
    return figure, axes


def _dots(
    ax: Axes,
    title: str,
    names: Sequence[str],
    points: Sequence[tuple[float, float, float, float, int]],
    one: float | None = 1.0,
) -> None:
    """Draw (row, value, low, high, kind) as marks with intervals."""
    for row, value, low, high, kind in points:
        colour = COLOURS[kind % len(COLOURS)]
        ax.plot([low, high], [row, row], color=colour, linewidth=1.6)
        ax.plot(value, row, MARKS[kind % len(MARKS)], color=colour, markersize=5)
    if one is not None:
        ax.axvline(one, color=SOFT, linewidth=1, linestyle="--", zorder=0)
    ax.set_title(title, color=INK, fontsize=10)
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.5, -0.5)
    _plain(ax)


def _plain(ax: Axes) -> None:
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        ax.spines[side].set_color(SOFT)
    ax.tick_params(colors=INK, labelsize=9)
    ax.grid(color=SOFT, alpha=0.25, linewidth=0.6)
    ax.set_axisbelow(True)


def _svg(figure: Figure) -> str:
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
