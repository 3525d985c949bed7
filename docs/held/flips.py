"""The figures of docs/flips.md and of what other pages say of flips."""

from __future__ import annotations

from typing import Any

import pandas as pd

from docs.held import Held
from docs.held.lookups import bold, crossed, ends, grid, matched, one, some
from docs.held.names import BEST_FOR_H, REFINED, scenes

STATES = "counties:level=state"
LABELS = scenes("city", "glyphs", "helsinki", STATES, "counties", "cad")
MEASURED = scenes("city", "helsinki", "glyphs", STATES, "counties")
"""Scenes that flips were timed on."""

TIMED = scenes("city", "glyphs", STATES, "counties")
"""Scenes of `scripts/flips_times.py`."""

SIZES = (64, 512, 1024)
L1, EUCLIDEAN = "flips:l1", "flips:euclidean"
COUNTED = ("earcut-refine", "flips:beauty", L1, EUCLIDEAN, REFINED, BEST_FOR_H)


def _counted(scene: str, px: int, name: str) -> float:
    """Return helper lanes over ear clipping's, as `scripts/flips_lanes.py` printed it."""
    return float(one("flips-lanes.csv", scene=scene, px=px, triangulator=name)["helper_lanes"])


def _timed(scene: str, name: str, px: int = 1024, order: str = "") -> pd.Series[Any]:
    file = f"llvmpipe/flips-{scene.removeprefix('counties:level=')}{order}/summary.csv"
    return one(file, triangulator=name, resolution=px)


def _ms(scene: str, language: str, candidate: str) -> float:
    """Return milliseconds that `scripts/flips_times.py` printed."""
    where = {"scene": scene, "language": language, "candidate": candidate}
    return float(one("flips-times.csv", **where)["ms"])


def _lanes(of: tuple[str, int], name: str) -> str:
    """Return a cell of helper lanes in ratio to ear clipping's, L1 flips' in bold."""
    if name == "polygons":
        return f"{one('flips-lanes.csv', scene=of[0], px=of[1], triangulator=L1)[name]:,}"
    return bold(f"{_counted(*of, name):.3f}", name == L1)


def _time(scene: str, of: tuple[str, str, str]) -> str:
    """Return a cell of milliseconds by language; in brackets, in ratio to what comes before."""
    language, candidate, base = of
    ms = _ms(scene, language, candidate)
    return f"{ms:.2f}" + (f" ({ms / _ms(scene, language, base):.2f})" if base else "")


IN_SHORT = grid(
    {
        True: "helper lanes in ratio to earcut's, 512 px a polygon",
        False: "time to triangulate in ratio to earcut's, JavaScript",
    },
    ("city", "glyphs", STATES),
    lambda lanes, scene: (
        _counted(scene, 512, L1)
        if lanes
        else 1.0 + _ms(scene, "JavaScript", "l1") / _ms(scene, "JavaScript", "earcut")
    ),
    ".2f",
)
"""The README's table: what L1 flips save and cost on three scenes."""

PAID: Held = {
    "| scene | ear clipping | `earcut-refine` | `flips:beauty` | `flips:l1` | `flips:euclidean` |"
    " `refined` | best for H | `earcut-refine` pays | `flips:l1` pays | best for H pays |": grid(
        MEASURED,
        ("ear-clipping", *COUNTED),
        lambda scene, name: "{:,.{}f}".format(
            ms := _timed(scene, name)["triangulate_ms"], 2 if ms < 10.0 else 0
        ),
        more=lambda scene: [
            _timed(scene, name)["break_even"].removeprefix("after ")
            for name in ("earcut-refine", L1, BEST_FOR_H)
        ],
    )
}
HELD: Held = {
    "was run on {} polygons without holes ... made those of `flips:beauty` for {} of them. ..."
    " made them for {}.": lambda: [
        some("blender-beauty.csv", operator=operator)[column].sum()
        for operator, column in (
            *(("beautify", "polygons"), ("beautify", "same")),
            ("triangulate", "same"),
        )
    ],
    "for each of {} polygons, by {} flips.": lambda: matched(
        "flips-refine.txt", r"([\d,]+) polygons\n +([\d,]+) flips"
    ),
    "| scene | px | polygons | `earcut-refine` | `flips:beauty` | `flips:l1` |"
    " `flips:euclidean` | `refined` | best for H |": grid(
        crossed(LABELS, SIZES, " | "), ("polygons", *COUNTED), _lanes
    ),
    "| scene, px | `earcut-refine` | `flips:beauty` | `flips:l1` | `flips:euclidean` |"
    " `refined` | best for H |": grid(
        crossed(MEASURED, SIZES, ", "),
        COUNTED,
        lambda of, name: _timed(of[0], name, of[1])["time_ratio"],
        ".2f",
        least="row",
    ),
    "(`--order walk`) it takes {:.2f} to {:.2f} of ear clipping's time at 64 px": lambda: ends(
        (_timed(scene, L1, 64, "-walk")["time_ratio"] for scene in MEASURED), 2
    ),
    "| scene | npm earcut | `refine` | L1 flips | earcut.hpp | L1 flips | mapbox_earcut |"
    " with L1 flips | all at once |": grid(
        TIMED,
        (
            *(("JavaScript", "earcut", ""), ("JavaScript", "refine", "")),
            *(("JavaScript", "l1", "refine"), ("C++", "earcut", ""), ("C++", "l1", "earcut")),
            *(("Python", "earcut", ""), ("Python", "with flips", "earcut")),
            ("Python", "batch with flips", "earcut"),
        ),
        _time,
    ),
}

UPSTREAM: Held = {
    "| | city | Helsinki | letters | U.S. states | counties | cad |": grid(
        {"earcut-refine": "`refine`", L1: "L1 flips"},
        (*MEASURED, "cad"),
        lambda name, scene: _counted(scene, 512, name),
        ".3f",
    ),
}
