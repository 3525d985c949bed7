"""The figures of devices' laws, from `results/reference/profiles`."""

from __future__ import annotations

import re
from operator import itemgetter
from statistics import median
from typing import Any

from docs.held import Held, Sentence, Table
from docs.held.lookups import Row, grid, one, percent, some, table_row, three, two, values
from harness.profile.words import amount
from scripts.studies.missing_terms import KEPT, TILE

PROFILES = {
    "opengl-llvmpipe": "llvmpipe by OpenGL",
    "webgpu-lavapipe": "lavapipe by WebGPU",
    "opengl-zink": "zink on lavapipe",
    "webgpu-swiftshader": "SwiftShader by WebGPU",
    "bounding-box-llvmpipe": "our walk of boxes",
}
"""Files of profiles, and what they are called."""

SOFTPIPE, SWIFTSHADER = "opengl-softpipe.refused", "webgpu-swiftshader"
TIMED = {**PROFILES, SOFTPIPE: "softpipe"}
"""Those, and one whose law explains too little: its times are measured all the same."""

PAGE = "webgpu-swiftshader-chromium"
SHOWN = {**PROFILES, PAGE: "SwiftShader in Chromium"}
"""Those with a law, and the same device as a page measured it."""

JUDGED = {"city": "city", "helsinki": "Helsinki", "glyphs": "letters", "counties": "counties"}
WHO = (
    *("optimal:half-perimeter", "optimal:expected-quads", "optimal:overdraw"),
    *("earcut-refine", "optimal:calibrated"),
)


WALKED = ("half_perimeter", "near", "rows", "blocks", "coarse_blocks", "further_tiles")


def profile(name: str) -> Any:
    """Return what a profile's file holds."""
    return values(f"reference/profiles/{name}.json")


def processor() -> list[str]:
    """Return family, model and vector bits of the processor that all profiles are of."""
    (label,) = {profile(name)["device"]["cpu"] for name in TIMED}
    found = re.fullmatch(r"AMD EPYC (\d+)/(\d+), (\d+)-bit", label)
    assert found, label
    return list(found.groups())


def term(name: str, of: str) -> str:
    """Return what a term costs, "-" where no cost is shown."""
    found = next(each for each in profile(name)["terms"] if each["name"] == of)
    return amount(found["cost"]) if found["shown"] else "-"


def laws() -> list[str]:
    """Return the table of what each costs, by device."""
    shown = ("triangles", "set_up", "covering", "vertices", "fragments", "helper_lanes")
    columns = (*shown, *WALKED, "bbox_tests")
    return grid(SHOWN, columns, term, more=explained)


def thin() -> list[str]:
    """Return the table of thin triangles' times, by device and area."""
    lines = []
    for name, label in SHOWN.items():
        for each in profile(name)["aspects"]:
            places = [each["aspects"].index(aspect) for aspect in (8, 64)]
            ratios = [f"{each['ratios'][place]:.2f}" for place in places]
            doubled = f"{each['doubled_at'][0]:.0f}:1" if each["doubled_at"] else "-"
            lanes, *_ = each["shares"].get("helper_lanes", [0.0])
            others = {of: share for of, (share, _, _) in each["shares"].items()}
            others.pop("helper_lanes", None)
            most, part = max(others.items(), key=itemgetter(1), default=("-", 0.0))
            cells = (doubled, percent(lanes) + " %", f"{NOUNS.get(most, most)}, {percent(part)} %")
            lines.append(table_row(f"{label}, {each['area']} px^2", *ratios, *cells))
    return lines


NOUNS = {
    "half_perimeter": "H",
    "blocks": "4x4 blocks",
    "bbox_tests": "pixels of boxes",
    "further_tiles": "further tiles",
    "near": "H up to 16 px",
    "coarse_blocks": "blocks of large ones",
    "set_up": "set-up",
    "covering": "triangles that cover a pixel",
    "rows": "rows of pixels",
    "fragments": "covered pixels",
    "-": "nothing",
}


def judged() -> list[str]:
    """Return the table of how laws predict polygons that they have not seen."""
    labels = {
        (name, scene): f"{label}, {title}"
        for name, label in TIMED.items()
        for scene, title in JUDGED.items()
    }

    def cell(of: tuple[str, str], column: str) -> str:
        if column not in WHO:
            return three(first_judged(*of)[column])
        row = judged_rows(*of)[column]
        shown = f"{percent(row['regret'], 1)} %"
        return f"**{shown}**" if row["advice"] == "1" else shown

    def above(of: tuple[str, str]) -> list[str]:
        row = next(row for row in judged_rows(*of).values() if row["advice"] == "1")
        value, low, high = (percent(row[key], 1) for key in ("above", "above_low", "above_high"))
        return [f"{value} % ({low} to {high})"]

    return grid(labels, ("law_over", "law_within", "r2_most", *WHO), cell, more=above)


def judged_rows(name: str, scene: str) -> dict[str, Row]:
    """Return what a profile's judgement says of a scene, by triangulator."""
    file = f"profiles/{name}-judged.csv"
    return {row["triangulator"]: row for row in some(file, scene=scene)}


def first_judged(name: str, scene: str) -> Row:
    """Return the first row of a scene, whose R2 is that of all."""
    return next(iter(judged_rows(name, scene).values()))


def most_above() -> list[str]:
    """Return the most that what is advised takes above the best of H, Q and A, in per cent."""
    found = [row for name in TIMED for scene in JUDGED for row in judged_rows(name, scene).values()]
    advised = [row for row in found if row["advice"] == "1"]
    return [percent(max(float(row[end]) for row in advised), 1) for end in ("above", "above_high")]


RULED = {
    "opengl-llvmpipe": "llvmpipe",
    SWIFTSHADER: "SwiftShader",
    SOFTPIPE: "softpipe",
    "bounding-box-llvmpipe": "our walk of boxes",
}
"""Rasterisers that share no code, and how the table of rules calls them."""


def _a_pixel(name: str, side: int) -> float:
    """Return seconds a pixel that triangles of side x side / 2 px^2 cover take."""
    of = profile(name)
    draw = next(e for e in of["times"] if (e["kind"], e["name"]) == ("size", f"{side} px"))
    return (median(draw["epochs"]) - of["empty"]) / draw["counters"]["fragments"]


def _at(name: str, aspect: int) -> str:
    ratios = (e["ratios"][e["aspects"].index(aspect)] for e in profile(name)["aspects"])
    return ", ".join(map(two, ratios))


def _twice(name: str) -> str:
    ends = (e["doubled_at"] for e in profile(name)["aspects"])
    return ", ".join(f"{found[0]:.0f}:1" if found else "never" for found in ends)


def rules() -> list[str]:
    """Return the table of rules of thumb, each with what it would say here."""
    lines = []
    for who, what, of in (
        ("PowerVR: 32 px or more a triangle", "a pixel at 32 px, beside one at 2,048", (8, 64)),
        ("Arm: 10 to 20 px or more", "a pixel at 8 px, beside one at 2,048", (4, 64)),
        ("-", "a pixel at 128 px, beside one at 2,048", (16, 64)),
    ):
        small, large = of
        cells = [f"{_a_pixel(name, small) / _a_pixel(name, large):.1f}" for name in RULED]
        lines.append(table_row(who, what, *cells))
    for who, what, aspect in (
        ("Godot: not thinner than 8:1", "8:1 beside 1:1, of 8 and of 64 px^2", 8),
        ("-", "16:1 beside 1:1, the same", 16),
        ("Android: no long thin triangles", "64:1 beside 1:1, the same", 64),
    ):
        lines.append(table_row(who, what, *(_at(name, aspect) for name in RULED)))
    lines.append(table_row("-", "from which aspect on twice", *map(_twice, RULED)))
    return lines


def coverage() -> list[str]:
    """Return how often intervals held the truth: goes, and the least shares of any term."""
    rows = some("law-coverage.csv")
    whole = one("law-coverage.csv", term="all")
    within = min(float(row["within"]) for row in rows)
    false = 1.0 - float(whole["nothing_shown"])
    return [f"{int(whole['goes']):,}", *(percent(e, 1) for e in (whole["within"], within, false))]


def doubled(name: str) -> list[str]:
    """Return from which aspects on thin triangles of either area take twice as long."""
    return [f"{each['doubled_at'][0]:.0f}" for each in profile(name)["aspects"]]


def lanes_shaded() -> list[str]:
    """Return lanes of the thinnest triangles in ratio to those of the widest, by area."""
    first = profile("opengl-llvmpipe")
    return [f"{each['lanes'][-1]:.1f}" for each in first["aspects"]]


def explained(name: str) -> list[str]:
    """Return R2 of a profile's law over all draws and within groups."""
    return [three(profile(name)[key]) for key in ("r2_over", "r2_within")]


def otherwise(name: str, law: str) -> list[str]:
    """Return R2 of a law with other terms, over all and within groups."""
    row = one("profile-terms.csv", profile=name)
    return [f"{float(row[f'{law}_{of}']):.3f}" for of in ("over", "within")]


FIRST: list[Held] = [
    Sentence(
        "on llvmpipe thin triangles of 8 and of 64 px^2 take twice as long from {}:1 and {}:1 on",
        lambda: doubled("opengl-llvmpipe"),
    ),
    Sentence("though even at 64:1 they shade about {} and {} times the lanes", lanes_shaded),
]
"""The first page's."""

TABLES: list[Held] = [
    Sentence("All devices here are software, on an AMD EPYC {}/{}, {}-bit;", processor),
    Table(
        "| device | triangle | set-up | covering | vertex | pixel | helper lane | H, a px"
        " | H to 16 px, a px | row | 4x4 block | block of a large one | further tile | box, a px"
        " | R2 over | R2 within |",
        laws,
    ),
    Table("| device, area | 8:1 | 64:1 | twice from | helper lanes | most |", thin),
    Table(
        "| rule | what was timed | llvmpipe | SwiftShader | softpipe | our walk of boxes |", rules
    ),
    Table(
        "| device, scene | R2 over | R2 within | by noise alone | H | Q | A | `refine` | calibrated"
        " | advised above H, Q, A |",
        judged,
    ),
    Sentence(
        "What is advised takes, as a mean, at most {} % more time than the best of H, Q and A; the"
        " interval that reaches farthest ends at {} %.",
        most_above,
    ),
    Sentence(
        "On softpipe the law explains {} of the variance over all draws and {} within groups",
        lambda: explained(SOFTPIPE),
    ),
    Sentence(
        "softpipe keeps {} tiles of {}x{} pixels at hand",
        lambda: [str(value) for value in (KEPT, TILE, TILE)],
    ),
    Sentence(
        "With the tiles that it fetches as one more term, the law would explain {} and {}",
        lambda: otherwise(SOFTPIPE, "tiles"),
    ),
    Sentence(
        "Without rows and covering triangles its law would explain {} and {}",
        lambda: otherwise(SWIFTSHADER, "no_rows"),
    ),
    Sentence(
        "In {} synthetic devices, {} % of costs are within their interval, of each term {} % or"
        " more; a cost that is not there is shown in {} % of the devices",
        coverage,
    ),
]
