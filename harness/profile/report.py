"""A profile as sentences, as a table of terms, and as a chart."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.metrics.decision import join_names
from harness.profile.advice import CRITERIA, SCENES
from harness.profile.cost_terms import TERMS
from harness.profile.profile import describe_origin, name_device_model
from harness.style import (
    COLOURS,
    add_legend_below,
    draw_figure,
    format_count,
    make_panels,
    make_plain_table,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table


UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"), (1e-9, "ns"), (1e-12, "ps"))

ZERO_S = 1e-16  # times below this are round-off errors of 0

# Columns in the table of devices even if significant on no device.
REQUIRED_TERMS = ("draw", "triangles", "helper_lanes")


def format_seconds(value: float) -> str:
    """Return seconds as text in a suitable unit: 53 ns, 1.9 us."""
    if value < ZERO_S:
        return "0 s"
    step, unit = next((entry for entry in UNITS if value >= entry[0]), UNITS[-1])
    digits = ".0f" if value / step >= 10 else ".2g"
    return f"{value / step:{digits}} {unit}"


def format_sentences(profile: Mapping[str, Any]) -> list[str]:
    """Return the results of a profile as sentences."""
    return [*_format_law(profile), *_format_aspects(profile), *_format_advice(profile)]


def _format_law(profile: Mapping[str, Any]) -> Iterator[str]:
    yield f"On {describe_origin(profile['device'])}:"
    terms = {term["name"]: term for term in profile["terms"]}
    stages = profile["stages"]
    yield from _format_costs([terms["draw"]])
    if len(stages) > 1:
        names = join_names([stage["name"] for stage in stages])
        yield f"A draw takes the time of the slowest of {len(stages)} stages: {names}."
    for stage in stages:
        if len(stages) > 1:
            yield f"Stage {stage['name']}, the slowest in {format_count(stage['draws'], 'draw')}:"
        yield from _format_costs([terms[name] for name in stage["terms"]])
    counting = ["draw", *(name for stage in stages for name in stage["terms"])]
    for known, text in ((True, "No significant cost"), (False, "Unknown, as no draws separate")):
        others = [n for n in counting if not terms[n]["shown"] and terms[n]["known"] == known]
        if others:
            yield f"{text}: {join_names([TERMS[name].noun for name in others])}."


def _format_costs(terms: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    for term in terms:
        if term["shown"]:
            yield TERMS[term["name"]].sentence.format(format_seconds(term["cost"]))


def _format_aspects(profile: Mapping[str, Any]) -> Iterator[str]:
    for area in profile["aspects"]:
        ratio, low, high = (area[name][-1] for name in ("ratios", "low", "high"))
        text = (
            f"Thin triangles of {area['area']} px^2 take {ratio:.2g} times as long at "
            f"{area['aspects'][-1]}:1 as at 1:1 ({low:.2f} to {high:.2f})"
        )
        if area["doubled_at"]:
            at, low, high = area["doubled_at"]
            text += f"; twice as long from {at:.0f}:1 on ({low:.0f} to {high:.0f})"
        yield f"{text}."


def _format_advice(profile: Mapping[str, Any]) -> Iterator[str]:
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
        f"Triangulate {by}: by the model, it saves {join_names(saved)} of ear clipping's time, "
        "not counting the draw itself."
    )
    regrets = [f"{CRITERIA[key]} {advice['regret'][key]:.1%}" for key in CRITERIA]
    yield f"Extra cost over the calibrated optimum, by the model: {join_names(regrets)}."


def make_table(profile: Mapping[str, Any]) -> Table:
    """Return the table of terms with their intervals."""
    errors = ", ".join(f"{form} {error:.1%}" for form, error in profile["errors"].items())
    table = make_plain_table(
        f"Form: {profile['form']}. Mean error of held-out groups of draws: {errors}. "
        f"R2 of their log time: {profile['r2_over']:.3f} over all, "
        f"{profile['r2_within']:.3f} within groups",
        *("term", "stage", ">cost", ">95 % CI"),
    )
    terms = {term["name"]: term for term in profile["terms"]}
    for stage in ({"name": "", "terms": ["draw"]}, *profile["stages"]):
        for name in stage["terms"]:
            term = terms[name]
            cost, ends = "unknown", "-"
            if term["known"]:
                ends = f"{format_seconds(term['low'])} to {format_seconds(term['high'])}"
                cost = format_seconds(term["cost"]) if term["shown"] else "n.s."
            table.add_row(TERMS[name].noun, stage["name"], cost, ends)
    return table


def make_devices_table(folder: Path) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of a table of the profiles in a folder, one row per device."""
    contents = (json.loads(file.read_text("utf-8")) for file in sorted(folder.glob("*.json")))
    profiles = [profile for profile in contents if not profile["refused"]]
    significant = {
        term["name"] for profile in profiles for term in profile["terms"] if term["shown"]
    }
    names = [name for name in TERMS if name in significant | {*REQUIRED_TERMS}]
    nouns = (TERMS[name].noun for name in names)
    heads = ("device", "form", "twice as long from", "triangulate by", *nouns)
    return heads, [_make_row(profile, names) for profile in profiles]


def _make_row(profile: Mapping[str, Any], names: Sequence[str]) -> tuple[str, ...]:
    device = profile["device"]
    model = name_device_model(device["name"], device.get("details", {}))
    cpu = f"; {device['cpu']}" if device["software"] and device["cpu"] else ""
    terms = {term["name"]: term for term in profile["terms"]}
    doubled = ", ".join(
        f"{area['doubled_at'][0]:.0f}:1 at {area['area']} px^2" if area["doubled_at"] else "-"
        for area in profile["aspects"]
    )
    advice = profile["advice"]["triangulator"] if profile.get("advice") else "-"
    label = f"{model} ({device['rasteriser']})"
    costs = (_format_cost(terms[name]) if terms[name]["shown"] else "-" for name in names)
    return (f"{label}{cpu}", profile["form"], doubled, f"`{advice}`", *costs)


def _format_cost(term: Mapping[str, Any]) -> str:
    cost, low, high = (format_seconds(term[name]) for name in ("cost", "low", "high"))
    return f"{cost} ({low} to {high})"


def draw_chart(profile: Mapping[str, Any], file: Path) -> Path | None:
    """Draw the chart next to a profile's file, as PNG and SVG; return the PNG, if drawn."""
    return next(iter(draw_figure(file.parent, file.stem, _make_figure, profile)), None)


def _make_figure(profile: Mapping[str, Any]) -> Figure:
    areas, device = profile["aspects"], profile["device"]
    model = name_device_model(device["name"], device.get("details", {}))
    heading = f"Are thin triangles slow on {model}? Equal area, mean of four angles"
    figure, axes = make_panels(len(areas), (2.6, 2.3), heading, sharey=True)
    for panel, area in zip(axes, areas, strict=True):
        x, y = (np.array(area[name]) for name in ("aspects", "ratios"))
        error = np.abs(np.array([area["low"], area["high"]]) - y)
        panel.errorbar(x, y, error, color=COLOURS[0], marker="o", label="measured", capsize=2)
        panel.plot(x, area["lanes"], color=COLOURS[2], linestyle="-.", label="lanes shaded")
        panel.axhline(2.0, color="#777777", linewidth=0.8, linestyle=":")
        panel.set_xscale("log", base=2)
        panel.set_yscale("log", base=2)
        panel.xaxis.set_major_formatter("{x:g}:1")
        panel.yaxis.set_major_formatter("{x:g}")
        panel.set_xlabel("base / height")
        panel.set_title(f"{area['area']} px$^2$", fontsize=8)
    axes[0].set_ylabel("time of a triangle\nrelative to aspect 1:1")
    add_legend_below(figure, axes, columns=2)
    return figure
