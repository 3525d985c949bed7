"""A profile in plain sentences, and its table of terms."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.metrics.advice import listed
from harness.profile.advice import CRITERIA, SCENES
from harness.profile.counted import COARSE, TERMS
from harness.style import COLOURS, draw, legend_below, panels, plain_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table


STEPS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns"), (1e-12, "ps"))

NOTHING = 1e-16
"""Seconds that round-off makes of nothing."""

LEAST_SHARE = 0.05
"""Of what thin triangles take more: what takes less than this is not named."""

ALWAYS = ("draw", "triangles", "helper_lanes")
"""Terms that a table of devices has a column for even where no device is shown to pay for them."""

BY_SUM = {
    "triangle": "A triangle that covers a pixel, with three vertices of its own, costs",
    "walk": f"Each of the first {COARSE} pixels of a box's width and height costs",
}


def amount(value: float) -> str:
    """Return seconds as text in a suitable unit: 53 ns, 1.9 us."""
    if value < NOTHING:
        return "0 s"
    step, unit = next((each for each in STEPS if value >= each[0]), STEPS[-1])
    return f"{_digits(value / step)} {unit}"


def _digits(value: float) -> str:
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def sentences(profile: Mapping[str, Any]) -> list[str]:
    """Return what a profile says, a sentence each."""
    return [*_law(profile), *_thin(profile), *_advice(profile)]


def _law(profile: Mapping[str, Any]) -> Iterator[str]:
    yield f"On {profile['device']['name']}:"
    for term in profile["terms"]:
        if term["shown"]:
            yield TERMS[term["name"]].sentence.format(amount(term["cost"]))
    for each in profile["sums"]:
        if each["shown"]:
            yield f"{BY_SUM[each['name']]} {_cost(each)} in all."
    nothing = [TERMS[term["name"]].noun for term in profile["terms"] if not term["shown"]]
    if nothing:
        yield f"Nothing is shown for {listed(nothing)}."


def _thin(profile: Mapping[str, Any]) -> Iterator[str]:
    for each in profile["aspects"]:
        ratio, low, high = (each[name][-1] for name in ("ratios", "low", "high"))
        text = (
            f"Thin triangles of {each['area']} px^2 take {ratio:.2g} times as long at "
            f"{each['aspects'][-1]}:1 as at 1:1 ({low:.2f} to {high:.2f})"
        )
        if each["doubled_at"]:
            at, low, high = each["doubled_at"]
            text += f"; twice as long from {at:.0f}:1 on ({low:.0f} to {high:.0f})"
        yield f"{text}."
        why = [
            f"{value:.0%} ({low:.0%} to {high:.0%}) are {TERMS[name].noun}"
            for name, (value, low, high) in each["shares"].items()
            if value >= LEAST_SHARE
        ]
        if ratio > 1.0 + LEAST_SHARE and why:
            yield f"Of what they take more, {listed(why)}."


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
    for term in profile["terms"]:
        ends = f"{amount(term['low'])} to {amount(term['high'])}"
        cost = amount(term["cost"]) if term["shown"] else "nothing shown"
        needed = "yes" if term["name"] in profile["fewest"] else ""
        found.add_row(TERMS[term["name"]].noun, cost, ends, needed)
    return found


def devices_table(folder: Path) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of a table of the profiles in a folder, one a device.

    A column for each term that any of them is shown to pay for.
    """
    found = (json.loads(file.read_text("utf-8")) for file in sorted(folder.glob("*.json")))
    profiles = [profile for profile in found if not profile["refused"]]
    paid = {term["name"] for each in profiles for term in each["terms"] if term["shown"]}
    names = [name for name in TERMS if name in paid | {*ALWAYS}]
    nouns = (TERMS[name].noun for name in names)
    heads = ("device", *nouns, "twice as long from", "triangulate by")
    return heads, [_row(profile, names) for profile in profiles]


def model(device: str, details: Mapping[str, Any]) -> str:
    """Return what a GPU is called, where `device` is only its number, as gpu0 is."""
    return str(details["renderer"]).partition("/")[0] if device.startswith("gpu") else device


def _row(profile: Mapping[str, Any], names: Sequence[str]) -> tuple[str, ...]:
    device = profile["device"]
    where = f"{model(device['name'], device.get('details', {}))} ({device['rasteriser']})"
    cpu = f"; {device['cpu']}" if device["software"] and device["cpu"] else ""
    terms = {term["name"]: term for term in profile["terms"]}
    doubled = ", ".join(
        f"{each['doubled_at'][0]:.0f}:1 at {each['area']} px^2" if each["doubled_at"] else "-"
        for each in profile["aspects"]
    )
    advice = profile["advice"]["triangulator"] if profile.get("advice") else "-"
    shown = (terms[name] if terms[name]["shown"] else None for name in names)
    costs = ("-" if each is None else _cost(each) for each in shown)
    return (f"{where}{cpu}", *costs, doubled, f"`{advice}`")


def _cost(term: Mapping[str, Any]) -> str:
    cost, low, high = (amount(term[name]) for name in ("cost", "low", "high"))
    return f"{cost} ({low} to {high})"


def plot(profile: Mapping[str, Any], file: Path) -> Path:
    """Draw the picture beside a profile's file, as PNG and SVG; returns the PNG."""
    return draw(file.parent, file.stem, _figure, profile)[0]


def _figure(profile: Mapping[str, Any]) -> Figure:
    areas, device = profile["aspects"], profile["device"]
    title = f"Are thin triangles slow on {model(device['name'], device.get('details', {}))}?"
    words = f"{title} Equal area, mean of four angles"
    figure, places = panels(len(areas), (2.6, 2.3), words, sharey=True)
    for panel, each in zip(places, areas, strict=True):
        x, y = (np.array(each[name]) for name in ("aspects", "ratios"))
        error = np.abs(np.array([each["low"], each["high"]]) - y)
        panel.errorbar(x, y, error, color=COLOURS[0], marker="o", label="measured", capsize=2)
        alone = "if helper lanes alone took more"
        panel.plot(x, each["lanes_alone"], color=COLOURS[1], linestyle="--", label=alone)
        panel.plot(x, each["lanes"], color=COLOURS[2], linestyle="-.", label="lanes shaded")
        panel.axhline(2.0, color="#777777", linewidth=0.8, linestyle=":")
        panel.set_xscale("log", base=2)
        panel.set_yscale("log", base=2)
        panel.xaxis.set_major_formatter("{x:g}:1")
        panel.yaxis.set_major_formatter("{x:g}")
        panel.set_xlabel("base in ratio to height")
        panel.set_title(f"{each['area']} px$^2$", fontsize=8)
    places[0].set_ylabel("time of a triangle,\nin ratio to aspect 1:1")
    legend_below(figure, places, columns=3)
    return figure
