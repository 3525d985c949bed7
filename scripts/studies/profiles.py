"""Is a profile's law right? Polygons that it has not seen, drawn on its device.

    PYTHONPATH=. python scripts/studies/profiles.py PROFILE.json... [--out FOLDER]
        [--scenes city,helsinki,glyphs,counties] [--resolution 512] [--budget 0.1] [--seed 0]
        [--refit]

With `--refit` nothing is drawn: the law of each profile is fitted anew to the times that it holds,
with today's terms, and its file is written anew.

Of each scene, 24 polygons are drawn by ten triangulators, by optimal:calibrated with the profile's
coefficients, and by six random ones, timed together group by group. Writes <profile>-judged.csv
beside the others: of each scene

law_over, law_within : R2 of log time as the profile's law and exact counters predict it, over all
    draws and within polygons, with this session's own draw of nothing (it depends on the viewport),
    and one factor for how fast the machine was in ratio to the profile's session
r2_over, r2_within : the same of the profile's coefficients, which optimal:calibrated minimises, and
    of criteria alone; `speed` is that factor
r2_most : what r2_within would be if only noise were left, by how the two halves of the rounds agree
    (C. Spearman and W. Brown, 1910)
regret, low, high : what a triangulator costs above the best of all but the random ones, mean
    over polygons, with its 95 % interval; `advice` is the one that the profile names
above, above_low, above_high : mean over polygons of its time above that of the best of H, Q and A,
    which is chosen here, after the fact, with its 95 % interval
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness import rasterisers
from harness.figures.intervals import Ratio, mean_interval
from harness.frame import on_coarser_grid
from harness.measuring.loading import load_scene
from harness.measuring.processes import Backend, Bench
from harness.measuring.worker import Worker
from harness.profile import design
from harness.profile import profile as profiles
from harness.profile.counted import TERMS, counters, design_of
from harness.profile.law import COSTS, costs_of, r_squared, r_squared_within
from harness.profile.measured import Measured
from harness.progress import Reporter
from harness.rasterisers.base import Options
from harness.settings import TimingSettings
from harness.study.regret import regret_ends, regret_interval
from scripts.studies.held_out import Draw, HeldOut, held_out_draws, time_draws
from scripts.studies.missing_terms import drawn

OWN = "optimal:calibrated"
TEN = (
    *("ear-clipping", "earcut-refine", "delaunay", "sweep", "greedy", "refined:half-perimeter"),
    *("optimal:half-perimeter", "optimal:expected-quads", "optimal:overdraw"),
    "optimal:edge-length",
)
RANDOM = tuple(f"random#{number}" for number in range(6))
CHOICES = ("optimal:half-perimeter", "optimal:expected-quads", "optimal:overdraw")
"""The best for H, for Q and for A."""

ALWAYS = (*CHOICES, "earcut-refine", OWN)
"""Triangulators whose regret is told: as if always taken."""

ABOVE = ("above", "above_low", "above_high")

COLUMNS = (
    *("scene", "resolution", "polygons", "draws", "law_over", "law_within"),
    *("r2_over", "r2_within", "r2_most", "speed"),
    *("triangulator", "advice", "regret", "low", "high", *ABOVE),
)


def main() -> None:
    """Judge each profile."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("profiles", type=Path, nargs="+")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--scenes", default="city,helsinki,glyphs,counties")
    parser.add_argument("--resolution", type=int, default=512)
    parser.add_argument("--budget", type=float, default=0.1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--refit", action="store_true")
    given = parser.parse_args()
    for file in given.profiles:
        profile = json.loads(file.read_text())
        if given.refit:
            file.unlink()
            print(
                profiles.keep(refitted(profile), file.with_name(file.name.replace(".refused", "")))
            )
            continue
        out = (given.out or file.parent) / f"{file.stem}-judged.csv"
        with out.open("w", newline="") as stream:
            table = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
            table.writeheader()
            for scene in given.scenes.split(","):
                for row in judged(profile, scene, given):
                    table.writerow(row)
                    print(",".join(str(value) for value in row.values()), flush=True)


def refitted(profile: dict[str, Any]) -> dict[str, Any]:
    """Return a profile as its times tell it by today's terms; its advice stays as it is."""
    draws, told = drawn(profile)
    found = Measured(
        epochs=np.array([each["epochs"] for each in told]).T,
        speeds=np.array([1.0, profile["drift"]]),
        empty=profile["empty"],
        control=Ratio(*profile["control"], rounds=0),
        rounds=profile["rounds"],
    )
    counted = [counters(draw) for draw in draws]
    about = profile["device"], profile["seed"]
    content = profiles.profile(draws, counted, found, *about)
    content["advice"] = profile.get("advice")
    content["refused"] = content["refused"] or bool(found.trouble)
    return {name: content[name] for name in profile}


def judged(profile: dict[str, Any], scene: str, given: argparse.Namespace) -> Iterator[Any]:
    """Yield a row of `COLUMNS` for each of `ALWAYS`."""
    reporter = Reporter(quiet=True)
    device = profile["device"]
    kind = device["rasteriser"]
    backend = Backend(kind, rasterisers.find_device(kind, device["name"]))
    bench = Bench(Worker, timeout_s=600)
    try:
        loaded = [load_scene(scene, given.seed, reporter)]
        names = (*TEN, OWN, *RANDOM)
        draws, polygons, ways = held_out_draws(
            bench, loaded, given.resolution, given.seed, names, profile["coefficients"]
        )
        settings = TimingSettings(
            precision=0.002, budget_s=given.budget, warm_up_s=0.02, min_batch_s=3e-3, paired=False
        )
        options = Options(order="walk")
        timed = time_draws(backend, bench, settings, options, reporter, draws, scene, polygons)
    finally:
        bench.close()
    seconds = timed.ratios * float(np.median(timed.reference_s))
    empty = float(np.median(timed.empty_s))
    cost = costs_of(draws)[:, 1:] @ [profile["coefficients"][name] for name in COSTS[1:]]
    by_law, _ = as_predicted(seconds, empty, law_of(profile, draws))
    predicted, speed = as_predicted(seconds, empty, cost)
    held = HeldOut(seconds, timed.halves, polygons)
    common = {
        "scene": scene,
        "resolution": given.resolution,
        "polygons": len(held.rows),
        "draws": len(draws),
        **explained("law", seconds, by_law, polygons),
        **explained("r2", seconds, predicted, polygons),
        "r2_most": f"{reliability(held):.4f}",
        "speed": f"{speed:.3f}",
    }
    advice = profile["advice"]["triangulator"] if profile.get("advice") else ""
    logs = {name: logs_of(held, ways, name) for name in ALWAYS}
    best = min(CHOICES, key=lambda name: float(logs[name].mean()))
    for name in ALWAYS:
        ends = []
        for rows in held.rows:
            shown = [row for row in rows if not ways[row].startswith("random")]
            if name in (own := [ways[row] for row in shown]):
                ends.append(regret_ends(held.halves[shown], own.index(name)))
        below, above = np.array(ends).T
        low, high = regret_interval(below, above)
        mean = max(0.0, float((below + above).mean() / 2))
        apart = logs[name] - logs[best]
        shares = {"regret": mean, "low": low, "high": high} | {
            key: float(np.expm1(each))
            for key, each in zip(ABOVE, (apart.mean(), *ends_of(apart)), strict=True)
        }
        yield {
            **common,
            "triangulator": name,
            "advice": int(name == advice),
            **{key: f"{share:.5f}" for key, share in shares.items()},
        }


def ends_of(apart: NDArray[np.float64]) -> tuple[float, float]:
    """Return the ends of the interval of a mean over polygons; none is apart from itself."""
    return mean_interval(apart) if apart.any() else (0.0, 0.0)


def logs_of(held: HeldOut, ways: list[str], name: str) -> NDArray[np.float64]:
    """Return the log time of a triangulator's draw of each polygon, (p,)."""
    rows = [row for of_polygon in held.rows for row in of_polygon if ways[row] == name]
    return np.asarray(np.log(held.halves[rows]).mean(axis=1))


def law_of(profile: dict[str, Any], draws: list[Draw]) -> NDArray[np.float64]:
    """Return what draws take by a profile's law, of exact counters; the empty draw left out."""
    each = {term["name"]: term["cost"] for term in profile["terms"]} | {"draw": 0.0}
    step = profile["device"]["details"].get("step") or 1
    moved = [
        (replace(frame, points=on_coarser_grid(frame.points, step)), *more)
        for frame, *more in draws
    ]
    rows = design_of([counters(design.Draw("", "", "", *draw)) for draw in moved])
    return np.asarray(rows @ np.array([each[name] for name in TERMS]))


def as_predicted(
    seconds: NDArray[np.float64], empty: float, cost: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return what this session's draws should take, and its speed in ratio to the profile's."""
    speed = float(np.median((seconds - empty) / cost))
    return empty + speed * cost, speed


def explained(
    name: str, seconds: NDArray[np.float64], predicted: NDArray[np.float64], polygons: list[str]
) -> dict[str, str]:
    """Return R2 of log time over all draws and within polygons, as columns."""
    over = r_squared(np.log(seconds), np.log(predicted))
    within = r_squared_within(seconds, predicted, polygons)
    return {f"{name}_over": f"{over:.4f}", f"{name}_within": f"{within:.4f}"}


def reliability(held: HeldOut) -> float:
    """Return which share of the variance within polygons is not noise."""
    centred: NDArray[np.float64] = np.log(held.halves)
    for rows in held.rows:
        centred[rows] -= centred[rows].mean(axis=0)
    agree = float(np.corrcoef(centred.T)[0, 1])
    return 2.0 * agree / (1.0 + agree)


if __name__ == "__main__":
    main()
