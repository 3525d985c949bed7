"""A profile in plain sentences, and its table of terms."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.figures.verdict import listed
from harness.profile.advice import CRITERIA, SCENES
from harness.profile.counted import COARSE, TERMS
from harness.style import draw, look_of, plain_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.table import Table


STEPS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns"), (1e-12, "ps"))

NOTHING = 1e-16
"""Seconds that round-off makes of nothing."""

LEAST_SHARE = 0.05
"""Of what thin triangles take more: what takes less than this is not named."""

ALWAYS = ("draw", "triangles", "helper_lanes")
"""Terms that a table of devices has a column for even where no device is shown to pay for them."""

BY_TERM = {
    "helper_lanes": "helper lanes",
    "half_perimeter": "the walk along the box's width and height",
    "near": "the first pixels of that walk",
    "rows": "rows of pixels",
    "coarse_blocks": "4x4 blocks of large triangles",
    "blocks": "4x4 blocks touched",
    "further_tiles": "further 64x64 tiles",
    "bbox_tests": "pixels of bounding boxes",
    "set_up": "triangles set up",
    "covering": "triangles that cover a pixel",
    "fragments": "covered pixels",
}

BY_SUM = {
    "triangle": "A triangle that covers a pixel, with three vertices of its own, costs",
    "walk": f"Each of the first {COARSE} pixels of a box's width and height costs",
}


def amount(value: float, unit: str = "s") -> str:
    """Return a cost as people say it: 53 ns, 1.9 us, or 1.1 cycles."""
    if unit != "s":
        return f"{_digits(value)} {unit if _digits(value) != '1' else unit.removesuffix('s')}"
    for step, unit in STEPS:
        if value >= step:
            return f"{_digits(value / step)} {unit}"
    return "0 s" if value < NOTHING else f"{_digits(value / STEPS[-1][0])} ps"


def _digits(value: float) -> str:
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def sentences(profile: Mapping[str, Any]) -> list[str]:
    """Return what a profile says, a sentence each."""
    return [*_law(profile), *_thin(profile), *_advice(profile)]


def _law(profile: Mapping[str, Any]) -> Iterator[str]:
    shown = {term["name"]: term for term in profile["terms"] if term["shown"]}
    unit = profile["unit"]
    yield f"On {profile['device']['name']}:"
    for name, term in shown.items():
        yield TERMS[name].sentence.format(amount(term["cost"], unit))
    for each in profile["sums"]:
        if each["shown"]:
            ends = f"{amount(each['low'], unit)} to {amount(each['high'], unit)}"
            yield f"{BY_SUM[each['name']]} {amount(each['cost'], unit)} in all ({ends})."
    nothing = [TERMS[term["name"]].noun for term in profile["terms"] if not term["shown"]]
    if nothing:
        yield f"Nothing is shown for {listed(nothing)}."


def _thin(profile: Mapping[str, Any]) -> Iterator[str]:
    for each in profile["aspects"]:
        thinnest = each["aspects"][-1]
        ratio, low, high = (each[name][-1] for name in ("ratios", "low", "high"))
        text = (
            f"Thin triangles of {each['area']} px^2 take {ratio:.2g} times as long at {thinnest}:1 "
            f"as at 1:1{_range(low, high, 2)}"
        )
        doubled = each["doubled_at"]
        if doubled:
            text += f"; twice as long from {doubled[0]:.0f}:1 on{_range(doubled[1], doubled[2], 0)}"
        yield f"{text}."
        if ratio > 1.0 + LEAST_SHARE:
            yield _why(each["shares"])


def _range(low: float, high: float, digits: int) -> str:
    """Return an interval in brackets, nothing for that of a count, which has no width."""
    return f" ({low:.{digits}f} to {high:.{digits}f})" if high > low else ""


def _why(shares: Mapping[str, Sequence[float]]) -> str:
    lanes = shares.get("helper_lanes", (0.0, 0.0, 0.0))
    others = [
        f"{value:.0%} are {BY_TERM.get(name, TERMS[name].noun)}"
        for name, (value, _, _) in shares.items()
        if name != "helper_lanes" and value >= LEAST_SHARE
    ]
    text = f"Helper lanes are {lanes[0]:.0%} of that ({lanes[1]:.0%} to {lanes[2]:.0%})"
    return f"{text}; {', '.join(others)}." if others else f"{text}."


def _advice(profile: Mapping[str, Any]) -> Iterator[str]:
    advice = profile.get("advice")
    if not advice:
        return
    name = advice["triangulator"]
    saved = [
        f"{values[0]:.1%} on {SCENES.get(scene, scene)} ({values[1]:.1%} to {values[2]:.1%})"
        for scene, values in advice["saved"].items()
    ]
    by = f"by {name}" if name in CRITERIA else f"by {name} with this file"
    yield (
        f"Triangulate {by}: by the model, it saves {listed(saved)} of ear clipping's time, the "
        "draw itself left out."
    )
    regrets = [f"{CRITERIA[each]} {advice['regret'][each]:.1%}" for each in CRITERIA]
    yield f"Above the least that the model knows: {listed(regrets)}."


def table(profile: Mapping[str, Any]) -> Table:
    """Return the table of terms with their intervals."""
    found = plain_table(
        f"R2 of log time on draws held out: {profile['r2_over']:.3f} over all, "
        f"{profile['r2_within']:.3f} within groups of a kind",
        *("what", ">each costs", ">95 % interval", "needed"),
    )
    unit = profile["unit"]
    for term in profile["terms"]:
        ends = f"{amount(term['low'], unit)} to {amount(term['high'], unit)}"
        cost = amount(term["cost"], unit) if term["shown"] else "nothing shown"
        needed = "yes" if term["name"] in profile["fewest"] else ""
        found.add_row(TERMS[term["name"]].noun, cost, ends, needed)
    return found


def devices_table(folder: Path) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of a table of the profiles in a folder, one a device.

    A column for each term that any of them is shown to pay for.
    """
    found = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(folder.glob("*.json"))]
    profiles = [profile for profile in found if not profile["refused"]]
    paid = {term["name"] for each in profiles for term in each["terms"] if term["shown"]}
    names = [name for name in TERMS if name in paid | {*ALWAYS}]
    heads = (
        "device",
        *(TERMS[name].noun for name in names),
        "twice as long from",
        "triangulate by",
    )
    return heads, [_row(profile, names) for profile in profiles]


def _row(profile: Mapping[str, Any], names: Sequence[str]) -> tuple[str, ...]:
    device = profile["device"]
    where = f"{device['name']} ({device['rasteriser']})"
    timed = device["software"] and device["cpu"] and profile["unit"] == "s"
    cpu = f"; {device['cpu']}" if timed else ""
    terms = {term["name"]: term for term in profile["terms"]}
    doubled = ", ".join(
        f"{each['doubled_at'][0]:.0f}:1 at {each['area']} px^2" if each["doubled_at"] else "-"
        for each in profile["aspects"]
    )
    advice = profile["advice"]["triangulator"] if profile.get("advice") else "-"
    costs = (cost_of(terms[name], profile["unit"]) for name in names)
    return (f"{where}{cpu}", *costs, doubled, f"`{advice}`")


def cost_of(term: Mapping[str, Any], unit: str) -> str:
    """Return what a term costs, with its interval; "-" where no cost is shown."""
    if not term["shown"]:
        return "-"
    cost, low, high = (amount(term[name], unit) for name in ("cost", "low", "high"))
    return f"{cost} ({low} to {high})"


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
