"""The figures of devices' laws, from `results/reference/profiles`."""

import re
from functools import partial
from statistics import median
from typing import Any

from docs.held import Held, shown
from docs.held.lookups import bold, crossed, grid, some, values
from docs.held.names import BEST_FOR_A, BEST_FOR_H, BEST_FOR_Q, CALLED, scenes
from harness.profile.words import amount

H200 = "opengl-h200"
SOFTPIPE, SWIFTSHADER = "opengl-softpipe.refused", "webgpu-swiftshader"
TIMED = {**CALLED["profiles"], SOFTPIPE: "softpipe"}
"""Those, and one whose law explains too little: its times are measured all the same."""

JUDGED = {name: label for name, label in TIMED.items() if name != H200}
"""Those whose laws were set against runs of scenes."""

SHOWN = {**CALLED["profiles"], "webgpu-swiftshader-chromium": "SwiftShader in Chromium"}
"""Those with a law, and the same device as a page measured it."""

WHO = (BEST_FOR_H, BEST_FOR_Q, BEST_FOR_A, "earcut-refine", "optimal:calibrated")


SMALL_AND_THIN = {
    (4, 64): "a pixel of triangles of 8 px, beside one of those of 2,048 | Arm: 10 to 20 or more",
    (8, 64): "the same, of 32 px | PowerVR: 32 or more",
    (16, 64): "the same, of 128 px |",
    8: "8:1 beside 1:1, of 8 and of 64 px^2 | Godot: not thinner than 8:1",
    16: "16:1 beside 1:1, the same |",
    64: "64:1 beside 1:1, the same | Android: no long thin triangles",
    "twice": "from which aspect on twice, if up to 64:1 |",
}
"""What was timed, of two sides of triangles, or an aspect; and a rule of thumb of it."""


def profile(name: str) -> Any:
    """Return what a profile's file holds."""
    return values(f"reference/profiles/{name}.json")


def _processor() -> tuple[str, ...]:
    """Return family, model and vector bits of the processor that software devices ran on."""
    (label,) = {profile(name)["device"]["cpu"] for name in JUDGED}
    found = re.fullmatch(r"AMD EPYC (\d+)/(\d+), (\d+)-bit", label)
    assert found, label
    return found.groups()


def _explained(name: str) -> list[float]:
    """Return R2 of a profile's law over all draws and within groups."""
    return [profile(name)[key] for key in ("r2_over", "r2_within")]


def _term(name: str, of: str) -> str:
    """Return what a term costs, "-" where no cost is shown."""
    found = next(each for each in profile(name)["terms"] if each["name"] == of)
    return amount(found["cost"]) if found["shown"] else "-"


def _twice(of: Any) -> str:
    """Return from which aspect on thin triangles take twice as long."""
    return f"{of['doubled_at'][0]:.0f}:1" if of["doubled_at"] else ""


def _ratio(of: Any, aspect: int) -> str:
    """Return the time of thin triangles in ratio to that of wide ones."""
    return f"{of['ratios'][of['aspects'].index(aspect)]:.2f}"


def _judgement(of: tuple[str, str], column: str) -> str:
    """Return a cell of the table of how laws predict polygons that they have not seen."""
    rows = some(f"profiles/{of[0]}-judged.csv", scene=of[1]).set_index("triangulator")
    if column == "above":
        row = rows[rows["advice"] == 1].iloc[0]
        ends = (shown(row[key], ".1%") for key in ("above", "above_low", "above_high"))
        return "{} % ({} to {})".format(*ends)
    if column not in WHO:
        return f"{rows[column].iloc[0]:.3f}"
    return bold(f"{shown(rows['regret'][column], '.1%')} %", rows["advice"][column] == 1)


def _small_or_thin(what: Any, name: str) -> str:
    """Return a cell of the table of small and thin triangles."""
    of = profile(name)
    if what == "twice":
        return ", ".join(_twice(each) or "-" for each in of["aspects"])
    if isinstance(what, int):
        return ", ".join(_ratio(each, what) for each in of["aspects"])
    timed = {each["name"]: each for each in of["times"] if each["kind"] == "size"}
    draws = [timed[f"{side} px"] for side in what]
    small, large = (
        (median(each["epochs"]) - of["empty"]) / each["counters"]["fragments"] for each in draws
    )
    return f"{small / large:.1f}"


FIRST: Held = {
    "px^2 take twice as long as those of 1:1 from about {:.0f}:1 and {:.0f}:1 on": lambda: [
        each["doubled_at"][0] for each in profile("opengl-llvmpipe")["aspects"]
    ],
    "even at 64:1 they shade about {:.1f} and {:.1f} times the lanes": lambda: [
        each["lanes"][-1] for each in profile("opengl-llvmpipe")["aspects"]
    ],
    "of 8 and of 64 px^2 at 64:1 take {:.1f} and {:.1f} times as long as those of 1:1": lambda: [
        each["ratios"][-1] for each in profile(H200)["aspects"]
    ],
    "A row of pixels costs {} ps, a round of arithmetic in a lane {} ps": lambda: [
        _term(H200, of).removesuffix(" ps") for of in ("rows", "work")
    ],
}
"""The first page's."""

TABLES: Held = {
    "All but the H200 are software, on an AMD EPYC {}/{}, {}-bit;": _processor,
    "| device | triangle | set-up | covering | vertex | pixel | helper lane | H, a px"
    " | H to 16 px, a px | row | 4x4 block | block of a large one | further tile | box, a px"
    " | R2 over | R2 within |": grid(
        SHOWN,
        (
            *("triangles", "set_up", "covering", "vertices", "fragments", "helper_lanes"),
            *("half_perimeter", "near", "rows", "blocks", "coarse_blocks", "further_tiles"),
            "bbox_tests",
        ),
        _term,
        more=lambda name: [f"{each:.3f}" for each in _explained(name)],
    ),
    "| what was timed | a rule | llvmpipe | SwiftShader | softpipe | our walk of boxes |": grid(
        SMALL_AND_THIN,
        ("opengl-llvmpipe", SWIFTSHADER, SOFTPIPE, "bounding-box-llvmpipe"),
        _small_or_thin,
    ),
    "| device, scene | R2 over | R2 within | by noise alone | H | Q | A | `refine` | calibrated"
    " | advised above H, Q, A |": grid(
        crossed(JUDGED, scenes("city", "helsinki", "glyphs", "counties"), ", "),
        ("law_over", "law_within", "r2_most", *WHO, "above"),
        _judgement,
    ),
    "On softpipe the law explains {:.3f} of the variance ... and {:.3f} within": partial(
        _explained, SOFTPIPE
    ),
}
