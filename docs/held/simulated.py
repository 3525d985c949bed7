"""The figures of docs/studies/skybox.md, and what other pages say of simulated designs."""

from __future__ import annotations

from statistics import geometric_mean
from typing import Any

import pandas as pd

from docs.held import Held
from docs.held.lookups import crossed, ends, grid, one, some
from docs.held.names import BEST_FOR_A, BEST_FOR_H, BEST_FOR_Q, CALLED, NAMES, scenes

SCENES = scenes("helsinki", "glyphs", "cad", "stress")
LABELS = {
    name: NAMES[name]
    for name in ("delaunay", "earcut-refine", "flips:l1", BEST_FOR_H, BEST_FOR_A, BEST_FOR_Q)
}
SHADERS = (0.5, 1, 2, 4, 8)


def saved(scene: str, name: str, device: str = "skybox", of: str = "cycles") -> float:
    """Return cycles, or quads, over ear clipping's."""
    where = {"device": device, "scene": scene, "resolution": 256, "triangulator": name}
    return float(one("skybox/savings.csv", **where)[of])


def mean_saved(name: str, device: str = "skybox", of: str = "cycles") -> float:
    """Return the same, the geometric mean over the scenes."""
    return geometric_mean(saved(scene, name, device, of) for scene in SCENES)


def _thin(aspect: int, device: str = "skybox") -> float:
    """Return the mean cycles of a thin triangle over its angles."""
    return float(some("skybox/thin.csv", device=device, aspect=aspect)["cycles"].mean())


def _shaded(shader: float, column: str) -> float:
    """Return a cell of the table of what a shader hides."""
    if column in ("cycles", "quads"):
        return mean_saved(BEST_FOR_H, f"skybox:shader={shader:g}", column)
    return float(one("skybox/border.csv", shader=shader)[column])


IN_SHORT: Held = {
    "{:.2f} of ear clipping's cycles on footprints ... {:.2f} ... {:.2f} ... {:.2f} on": lambda: [
        saved(scene, BEST_FOR_H) for scene in SCENES
    ]
}

WITH_SHADER: Held = {
    "a shader of eight cycles a quad it saves {:.1%} %, and its quads are {:.1%} %": lambda: [
        1 - _shaded(8, column) for column in ("cycles", "quads")
    ]
}

HELD: Held = {
    "| cycles over ear clipping's | Helsinki | letters | cad | stress |": grid(
        {**LABELS, "quads": "quads of the best for H"},
        SCENES,
        lambda name, scene: (
            saved(scene, BEST_FOR_H, of="quads") if name == "quads" else saved(scene, name)
        ),
        ".3f",
    ),
    "| scene | px | H | A | quads, counted | E |": grid(
        crossed(SCENES, (64, 256, 1024), " | "),
        ("half_perimeter", "overdraw", "quads", "edge_length"),
        lambda of, by: one(
            "skybox/ranks.csv", device="skybox", scene=of[0], resolution=of[1], criterion=by
        )["median"],
        ".3f",
    ),
    "| parameter | Delaunay | `flips:l1` | best for H | best for A"
    " | cycles a pixel of H | R^2 |": grid(
        CALLED["designs"],
        ("delaunay", "flips:l1", BEST_FOR_H, BEST_FOR_A),
        lambda device, name: mean_saved(name, device),
        ".3f",
        more=lambda device: [
            f"{one('skybox/slopes.csv', device=device, resolution=256)[column]:.2f}"
            for column in ("cycles_per_px", "r_squared")
        ],
    ),
    "| cycles a quad | cycles | quads | over the larger, median | most |": grid(
        {shader: f"{shader:g}" for shader in SHADERS},
        ("cycles", "quads", "over_larger", "most_over"),
        _shaded,
        ".3f",
    ),
    "| legs | as published | exact bins | 4 cycles a quad | over 1:1 |": grid(
        {aspect: f"{aspect}:1" for aspect in (1, 4, 16, 64, 256)},
        ("skybox", "skybox:bins=exact", "skybox:shader=4"),
        _thin,
        ".1f",
        more=lambda aspect: [f"{_thin(aspect) / _thin(1):.2f}"],
    ),
    "{:,} draws take {} to {} cycles more than it says.": lambda: some("skybox/squares.csv").agg(
        {"draws": "sum", "least": "min", "most": "max"}
    ),
    "Flips stay behind the best for H by {:.1%} % on Helsinki and {:.1%} % on cad.": lambda: [
        saved(s, "flips:l1") / saved(s, BEST_FOR_H) - 1 for s in ("helsinki", "cad")
    ],
}

BOUNDS = {bound: f"`{bound}`" for bound in ("shipped", "shading", "fill", "setup")}
OF_ATTILA = scenes("city", "helsinki", "glyphs", "cad")


def in_whole(scene: str, bound: str, name: str = BEST_FOR_H, of: str = "cycles") -> pd.Series[Any]:
    """Return ratios to ear clipping's in a whole GPU: ratio, low, high."""
    return one("attila/ratios.csv", scene=scene, bound=bound, triangulator=name, of=of)


def _whole_best(of: tuple[str, str], scene: str) -> str:
    """Return a cell of the table of the best for H: cycles with their interval, or quads."""
    row = in_whole(scene, of[1], of=of[0])
    interval = f" ({row['low']:.3f} to {row['high']:.3f})" * (of[0] == "cycles")
    return f"{row['ratio']:.3f}{interval}"


IN_WHOLE: Held = {
    "the best for H takes {:.2f}, {:.2f}, {:.2f} and {:.2f} of ear clipping's cycles on the"
    " city, ... Bound by shading, it takes {:.2f}, {:.2f}, {:.2f} and {:.2f}, which is": lambda: [
        in_whole(scene, bound)["ratio"] for bound in ("shipped", "shading") for scene in OF_ATTILA
    ],
    "shuffled list of the same triangles takes, as a mean over a scene, about {:.2f} to {:.2f}"
    " times the cycles": lambda: ends(some("attila/orders.csv", bound="shipped")["shuffled"]),
}

WHOLE_HELD: Held = {
    "| what binds | triangulator | city | Helsinki | letters | cad |": grid(
        crossed(BOUNDS, LABELS, " | "),
        OF_ATTILA,
        lambda of, scene: in_whole(scene, *of)["ratio"],
        ".3f",
    ),
    "| best for H over ear clipping | city | Helsinki | letters | cad |": grid(
        {**crossed({"cycles": "cycles"}, BOUNDS, ", "), ("quads", "shipped"): "quads"},
        OF_ATTILA,
        _whole_best,
    ),
    "| what binds | scene | H | A | Q | quads | of the busiest pipe | colour misses |": grid(
        crossed(BOUNDS, OF_ATTILA, " | "),
        (
            *("half_perimeter", "overdraw", "expected_quads"),
            *("quads", "busiest_pipe_quads", "colour_misses"),
        ),
        lambda of, by: one("attila/ranks.csv", bound=of[0], scene=of[1], by=by)["median"],
        ".2f",
    ),
    "| what binds | scene | between triangulations | between orders | walk | shuffled |": grid(
        crossed(BOUNDS, OF_ATTILA, " | "),
        ("triangulation", "order", "walk", "shuffled"),
        lambda of, column: one("attila/orders.csv", bound=of[0], scene=of[1])[column],
        (".2%", ".2%", ".3f", ".3f"),
    ),
}
