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

import argparse
import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness import rasterisers
from harness.errors import NothingMeasuredError
from harness.frame import Frame, View, make_frame
from harness.grid import coarsen
from harness.measuring.loading import load_scene
from harness.measuring.pool import Backend, MeasuringPool
from harness.measuring.timing import EMPTY, REFERENCE
from harness.profile import design
from harness.profile import profile as profiles
from harness.profile.counted import TERMS, counters, design_of
from harness.profile.law import COSTS, costs_of, r_squared, r_squared_within
from harness.profile.measured import Measured
from harness.progress import Reporter
from harness.rasterisers.base import Options
from harness.settings import StudySize, TimingSettings
from harness.stats.intervals import Ratio, mean_interval, paired_ratio
from harness.study.regret import regret_ends, regret_interval
from harness.study.subjects import choose_polygons
from harness.triangulating.recipes import parse
from harness.workers.worker import Worker
from scripts.studies.laws import drawn

Draw = tuple[Frame, NDArray[np.int32]]

GROUP = 24
"""Draws timed together: enough to interleave, few enough for many rounds."""

HALVES = ["first", "second"]

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
        drift=profile["drift"],
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
    device = profile["device"]
    kind = device["rasteriser"]
    backend = Backend(kind, rasterisers.find_device(kind, device["name"]))
    pool = MeasuringPool(Worker, timeout_s=600)
    try:
        draws, polygons, ways = held_out(pool, scene, given, profile["coefficients"])
        table, empty = timed(backend, pool, given.budget, draws, polygons)
    finally:
        pool.close()
    table = table.assign(polygon=polygons, triangulator=ways)
    seconds = table["seconds"].to_numpy()
    cost = costs_of(draws)[:, 1:] @ [profile["coefficients"][name] for name in COSTS[1:]]
    by_law, _ = as_predicted(seconds, empty, law_of(profile, draws))
    predicted, speed = as_predicted(seconds, empty, cost)
    common = {
        "scene": scene,
        "resolution": given.resolution,
        "polygons": table["polygon"].nunique(),
        "draws": len(draws),
        **explained("law", seconds, by_law, polygons),
        **explained("r2", seconds, predicted, polygons),
        "r2_most": f"{reliability(table):.4f}",
        "speed": f"{speed:.3f}",
    }
    advice = profile["advice"]["triangulator"] if profile.get("advice") else ""
    each = table.assign(log=np.log(table[HALVES]).mean(axis=1))
    logs = each.pivot(index="polygon", columns="triangulator", values="log")
    best = logs[list(CHOICES)].mean().idxmin()
    rivals = table[~table["triangulator"].str.startswith("random")].groupby("polygon")
    for name in ALWAYS:
        ends = [
            regret_ends(rows[HALVES].to_numpy(), rows["triangulator"].tolist().index(name))
            for _, rows in rivals
            if name in rows["triangulator"].tolist()
        ]
        below, above = np.array(ends).T
        low, high = regret_interval(below, above)
        mean = max(0.0, float((below + above).mean() / 2))
        apart = (logs[name] - logs[best]).to_numpy()
        # None is apart from itself.
        interval = mean_interval(apart) if apart.any() else (0.0, 0.0)
        shares = {"regret": mean, "low": low, "high": high}
        shares |= dict(zip(ABOVE, np.expm1([apart.mean(), *interval]), strict=True))
        yield {
            **common,
            "triangulator": name,
            "advice": int(name == advice),
            **{key: f"{share:.5f}" for key, share in shares.items()},
        }


def held_out(
    pool: MeasuringPool, scene: str, given: argparse.Namespace, coefficients: Mapping[str, float]
) -> tuple[list[Draw], list[str], list[str]]:
    """Return draws of polygons by several triangulators, and each draw's polygon and triangulator.

    coefficients : the costs that optimal:calibrated minimises
    """
    draws: list[Draw] = []
    polygons: list[str] = []
    ways: list[str] = []
    loaded = load_scene(scene, given.seed, Reporter(quiet=True))
    for number, alone in choose_polygons(loaded, StudySize(polygons=24)):
        frame = make_frame(alone.polygons, View(given.resolution))
        for name in (*TEN, OWN, *RANDOM):
            recipe = parse(name, seed=given.seed, calibration=coefficients)
            parts = pool.triangulate(recipe, frame.polygons).parts
            if all(part is not None for part in parts):
                draws.append((frame, frame.join(parts)))
                polygons.append(str(number))
                ways.append(name)
    return draws, polygons, ways


def timed(
    backend: Backend, pool: MeasuringPool, budget_s: float, draws: list[Draw], polygons: list[str]
) -> tuple[pd.DataFrame, float]:
    """Time draws in groups, each together with the reference draw; return those of an empty one.

    The ratio to it removes the machine's speed, which may change from minute to minute, but not
    what a machine's state does to one drawing more than to another. So those of one polygon, which
    will be compared, are drawn in the same rounds. A row a draw: seconds, and the ratios of
    `HALVES`, either half of the rounds. Raises `NothingMeasuredError` if the device fails.
    """
    options = Options(order="walk")
    settings = TimingSettings(
        precision=0.002, budget_s=budget_s, warm_up_s=0.02, min_batch_s=3e-3, paired=False
    )
    table = pd.DataFrame(np.nan, index=range(len(draws)), columns=["seconds", *HALVES])
    reference_s, empty_s = [], []
    for seed, members in enumerate(_groups(polygons)):
        candidates = {str(member): (*draws[member], options) for member in members}
        groups, failures = pool.time(backend, candidates, settings, seed)
        if failures:
            raise NothingMeasuredError(f"{backend.label}: {next(iter(failures.values()))}")
        group = next(iter(groups.values()))
        reference = group[REFERENCE]
        reference_s.append(reference.median_s)
        empty_s.append(group[EMPTY].median_s)
        for member in members:
            samples = group[str(member)].samples_s
            ratio = paired_ratio(samples, reference.samples_s).value
            halves = _halves(np.divide(samples, reference.samples_s), reference.epochs)
            table.loc[member] = [ratio, *halves]
    table["seconds"] *= float(np.median(reference_s))
    return table, float(np.median(empty_s))


def _groups(names: Sequence[str]) -> Iterator[list[int]]:
    """Yield places of draws, those of one name together: as many as are timed at once.

    Names come in any order. Small and large draws share a group, so that a slow minute touches all
    kinds alike.
    """
    labels = np.unique(np.asarray(names), return_inverse=True)[1]
    members: list[int] = []
    for label in np.random.default_rng(0).permutation(labels.max(initial=-1) + 1):
        own = np.flatnonzero(labels == label).tolist()
        if members and len(members) + len(own) > GROUP:
            yield members
            members = []
        members += own
    if members:
        yield members


def _halves(rounds: NDArray[np.float64], epochs: Sequence[int]) -> list[float]:
    """Return the medians of either half of the rounds.

    Every other epoch, if there are several: drawings lie elsewhere in memory in each, which no
    number of rounds averages out.
    """
    several = len(epochs) > 1 and sum(epochs) == len(rounds)
    numbers = np.repeat(np.arange(len(epochs)), epochs) if several else np.arange(len(rounds))
    return [float(np.median(rounds[numbers % 2 == half])) for half in range(2)]


def law_of(profile: dict[str, Any], draws: list[Draw]) -> NDArray[np.float64]:
    """Return what draws take by a profile's law, of exact counters; the empty draw left out."""
    each = {term["name"]: term["cost"] for term in profile["terms"]} | {"draw": 0.0}
    step = profile["device"]["details"].get("step") or 1
    moved = [(frame.with_points(coarsen(frame.points, step)), *more) for frame, *more in draws]
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


def reliability(table: pd.DataFrame) -> float:
    """Return which share of the variance within polygons is not noise."""
    logs = np.log(table[HALVES])
    centred = logs - logs.groupby(table["polygon"]).transform("mean")
    agree = float(np.corrcoef(centred.T)[0, 1])
    return 2.0 * agree / (1.0 + agree)


if __name__ == "__main__":
    main()
