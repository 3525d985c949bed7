"""Test the law of a profile on its device with polygons that it was not fitted to.

    PYTHONPATH=. python scripts/studies/profiles.py PROFILE.json... [--out FOLDER]
        [--scenes city,helsinki,glyphs,counties] [--resolution 512] [--polygons 24]
        [--budget 0.1] [--seed 0] [--refit]

With `--refit` nothing is drawn: the law of each profile is fitted again to the stored times with
the current terms, and the file is rewritten.

Polygons of each scene are drawn with ten triangulators, with optimal:calibrated and the
coefficients of the profile, and with six random triangulations, timed together in groups. Writes
<profile>-judged.csv to the folder of the profile or to FOLDER, and the counters and seconds of
each draw to <profile>-draws.csv.xz. Columns for each scene:

law_over, law_within : R2 of log time predicted by the law of the profile from exact counters, over
    all draws and within polygons, with the time of an empty draw in this session (it depends on the
    viewport) and a common factor for the speed of the machine relative to the session of the
    profile
r2_over, r2_within : the same for the prediction by criteria with the coefficients of the profile,
    which optimal:calibrated minimises; `speed` is the common factor
r2_max : upper bound of r2_within due to noise, from the correlation of the two halves of the rounds
    (C. Spearman and W. Brown, 1910)
regret, low, high : extra time of a triangulator over the fastest except the random ones, mean over
    polygons with its 95 % interval; `advice` is 1 for the triangulator that the profile recommends
above, above_low, above_high : extra time over the best of H, Q and A, chosen afterwards, mean over
    polygons with its 95 % interval
"""

import argparse
import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness import rasterisers
from harness.errors import NothingMeasuredError
from harness.frame import Frame, View, make_frame
from harness.grid import round_points
from harness.measuring.plan import load_scene
from harness.measuring.pool import Backend, MeasuringPool
from harness.measuring.timing import EMPTY, REFERENCE
from harness.metrics.statistics import Ratio, compute_mean_interval, compute_paired_ratio
from harness.profile import profile as profiles
from harness.profile.advice import recommend_triangulator
from harness.profile.cost_terms import (
    TERMS,
    compute_r_squared,
    compute_r_squared_within,
    count_cost_terms,
    count_draw,
    make_design_rows,
)
from harness.profile.law import COSTS, make_cost_rows, predict_times
from harness.profile.measured import DrawTimes
from harness.progress import Reporter
from harness.rasterisers.base import Options, order_submission
from harness.settings import StudySize, TimingSettings
from harness.study.regret import compute_regret_interval, estimate_regret
from harness.study.subjects import choose_polygons
from harness.triangulating.recipes import parse
from harness.worker import Worker
from scripts.studies.laws import recreate_draws

Draw = tuple[Frame, NDArray[np.int32]]

WALK = Options(order="walk")

MAX_GROUP_DRAWS = 24
"""Maximum number of draws timed together: more draws would leave too few rounds for the budget."""

HALVES = ["first", "second"]

DRAW_COUNTERS = ("vertices", *(name for name in TERMS if name not in ("draw", "work")))
"""Counters of draws that are stored; `vertices` is a term of older laws."""

CALIBRATED = "optimal:calibrated"
TRIANGULATORS = (
    *("ear-clipping", "earcut-refine", "delaunay", "sweep", "greedy", "refined:half-perimeter"),
    *("optimal:half-perimeter", "optimal:expected-quads", "optimal:overdraw"),
    "optimal:edge-length",
)
RANDOM = tuple(f"random#{number}" for number in range(6))
OPTIMA = ("optimal:half-perimeter", "optimal:expected-quads", "optimal:overdraw")
"""The optimal triangulations for H, Q and A."""

JUDGED = (*OPTIMA, "earcut-refine", CALIBRATED)
"""Triangulators whose regret is reported."""

EXCESS_COLUMNS = ("above", "above_low", "above_high")

COLUMNS = (
    *("scene", "resolution", "polygons", "draws", "law_over", "law_within"),
    *("r2_over", "r2_within", "r2_max", "speed"),
    *("triangulator", "advice", "regret", "low", "high", *EXCESS_COLUMNS),
)


def main() -> None:
    """Test or refit each profile."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("profiles", type=Path, nargs="+")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--scenes", default="city,helsinki,glyphs,counties")
    parser.add_argument("--resolution", type=int, default=512)
    parser.add_argument("--polygons", type=int, default=24)
    parser.add_argument("--budget", type=float, default=0.1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--refit", action="store_true")
    options = parser.parse_args()
    for file in options.profiles:
        profile = json.loads(file.read_text())
        if options.refit:
            target = file.with_name(file.name.replace(".refused", ""))
            written = profiles.write_profile(refit(profile), target)
            if written != file:
                file.unlink()
            print(written)
            continue
        out = (options.out or file.parent) / f"{file.stem}-judged.csv"
        out.parent.mkdir(parents=True, exist_ok=True)
        draws = []
        with out.open("w", newline="") as stream:
            table = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
            table.writeheader()
            for scene in options.scenes.split(","):
                measured = measure_scene(profile, scene, options)
                draws.append(measured.table)
                for row in judge_scene(profile, measured, options):
                    table.writerow(row)
                    print(",".join(str(value) for value in row.values()), flush=True)
        columns = ["scene", "polygon", "triangulator", "empty_s", "seconds", *DRAW_COUNTERS]
        pd.concat(draws)[columns].to_csv(
            out.with_name(f"{file.stem}-draws.csv.xz"), index=False, float_format="%.5g"
        )


def refit(profile: dict[str, Any]) -> dict[str, Any]:
    """Return a profile fitted to its stored times with the current terms.

    The advice for a sum is retained; for a maximum of stages it is computed again.
    """
    draws, stored = recreate_draws(profile)
    times = DrawTimes(
        epochs=np.array([row["epochs"] for row in stored]).T,
        drift=profile["drift"],
        empty=profile["empty"],
        control=Ratio(*profile["control"], rounds=0),
        rounds=profile["rounds"],
    )
    counted = [count_draw(draw) for draw in draws]
    device_and_seed = profile["device"], profile["seed"]
    content = profiles.make_profile(draws, counted, times, *device_and_seed)
    content["advice"] = profile.get("advice")
    if content["form"] != "sum":
        with closing(MeasuringPool(Worker, timeout_s=600)) as pool:
            content["advice"] = recommend_triangulator(
                pool, content["coefficients"], content["seed"]
            )
    content["refused"] = content["refused"] or bool(times.unreliable_reason)
    return content | {"design": profile["design"]}


class MeasuredScene(NamedTuple):
    """Draws of a scene's polygons.

    draws : frames, and triangles in the order in which they were drawn
    table : scene, polygon, triangulator, empty_s, seconds, `HALVES` and `DRAW_COUNTERS` of each
    """

    draws: list[Draw]
    table: pd.DataFrame


def measure_scene(
    profile: dict[str, Any], scene: str, options: argparse.Namespace
) -> MeasuredScene:
    """Triangulate, time and count polygons of a scene on the device of a profile."""
    device = profile["device"]
    kind = device["rasteriser"]
    backend = Backend(kind, rasterisers.find_device(kind, device["name"]))
    with closing(MeasuringPool(Worker, timeout_s=600)) as pool:
        draws, polygons, triangulators = triangulate_polygons(
            pool, scene, options, profile["coefficients"]
        )
        table, empty = time_draws(backend, pool, options.budget, draws, polygons)
    step = device["details"].get("step") or 1
    counted = [
        count_cost_terms(frame.with_points(round_points(frame.points, step)), triangles)
        for frame, triangles in draws
    ]
    table = table.join(pd.DataFrame(counted)[list(DRAW_COUNTERS)])
    names = {"polygon": polygons, "triangulator": triangulators}
    return MeasuredScene(draws, table.assign(scene=scene, empty_s=empty, **names))


def judge_scene(
    profile: dict[str, Any], measured: MeasuredScene, options: argparse.Namespace
) -> Iterator[Any]:
    """Yield a row of `COLUMNS` for each of `JUDGED`."""
    draws, table = measured
    seconds, empty = table["seconds"].to_numpy(), float(table["empty_s"].iloc[0])
    polygons = table["polygon"].tolist()
    cost = make_cost_rows(draws)[:, 1:] @ [profile["coefficients"][name] for name in COSTS[1:]]
    by_law, _ = scale_prediction(seconds, empty, predict_by_law(profile, table))
    predicted, speed = scale_prediction(seconds, empty, cost)
    common = {
        "scene": table["scene"].iloc[0],
        "resolution": options.resolution,
        "polygons": table["polygon"].nunique(),
        "draws": len(draws),
        **format_r_squared("law", seconds, by_law, polygons),
        **format_r_squared("r2", seconds, predicted, polygons),
        "r2_max": f"{compute_reliability(table):.4f}",
        "speed": f"{speed:.3f}",
    }
    advice = profile["advice"]["triangulator"] if profile.get("advice") else ""
    with_logs = table.assign(log=np.log(table[HALVES]).mean(axis=1))
    logs = with_logs.pivot(index="polygon", columns="triangulator", values="log")
    best = logs[list(OPTIMA)].mean().idxmin()
    rivals = table[~table["triangulator"].str.startswith("random")].groupby("polygon")
    for name in JUDGED:
        ends = [
            estimate_regret(rows[HALVES].to_numpy(), rows["triangulator"].tolist().index(name))
            for _, rows in rivals
            if name in rows["triangulator"].tolist()
        ]
        below, above = np.array(ends).T
        low, high = compute_regret_interval(below, above)
        mean = max(0.0, float((below + above).mean() / 2))
        differences = (logs[name] - logs[best]).to_numpy()
        # The interval of a triangulator compared with itself has no width.
        interval = compute_mean_interval(differences) if differences.any() else (0.0, 0.0)
        shares = {"regret": mean, "low": low, "high": high}
        shares |= dict(zip(EXCESS_COLUMNS, np.expm1([differences.mean(), *interval]), strict=True))
        yield {
            **common,
            "triangulator": name,
            "advice": int(name == advice),
            **{key: f"{share:.5f}" for key, share in shares.items()},
        }


def triangulate_polygons(
    pool: MeasuringPool, scene: str, options: argparse.Namespace, coefficients: Mapping[str, float]
) -> tuple[list[Draw], list[str], list[str]]:
    """Return draws of polygons by several triangulators, and the polygon and triangulator of each.

    coefficients : the costs that optimal:calibrated minimises
    """
    draws: list[Draw] = []
    polygons: list[str] = []
    triangulators: list[str] = []
    loaded = load_scene(scene, options.seed, Reporter(quiet=True))
    for number, subject in choose_polygons(loaded, StudySize(polygons=options.polygons)):
        frame = make_frame(subject.polygons, View(options.resolution))
        for name in (*TRIANGULATORS, CALIBRATED, *RANDOM):
            recipe = parse(name, seed=options.seed, calibration=coefficients)
            parts = pool.triangulate(recipe, frame.polygons).parts
            if all(part is not None for part in parts):
                triangles = order_submission(frame, frame.join_triangles(parts), WALK)
                draws.append((frame, triangles))
                polygons.append(str(number))
                triangulators.append(name)
    return draws, polygons, triangulators


def time_draws(
    backend: Backend, pool: MeasuringPool, budget_s: float, draws: list[Draw], polygons: list[str]
) -> tuple[pd.DataFrame, float]:
    """Time draws in groups with the reference draw; return a row per draw and the empty time.

    The ratio to the reference draw removes the speed of the machine, which may change from minute
    to minute, but not effects that differ between drawings. So the draws of a polygon, which are
    compared, are timed in the same rounds. Columns: seconds, and the ratios in either half of the
    rounds (`HALVES`). Raises `NothingMeasuredError` if the device fails.
    """
    settings = TimingSettings(
        precision=0.002, budget_s=budget_s, warm_up_s=0.02, min_batch_s=3e-3, paired=False
    )
    table = pd.DataFrame(np.nan, index=range(len(draws)), columns=["seconds", *HALVES])
    reference_s, empty_s = [], []
    for seed, members in enumerate(_group_draws(polygons)):
        candidates = {str(member): (*draws[member], Options()) for member in members}
        groups, failures = pool.time_drawings(backend, candidates, settings, seed)
        if failures:
            raise NothingMeasuredError(f"{backend.label}: {next(iter(failures.values()))}")
        group = next(iter(groups.values()))
        reference = group[REFERENCE]
        reference_s.append(reference.median_s)
        empty_s.append(group[EMPTY].median_s)
        for member in members:
            samples = group[str(member)].samples_s
            ratio = compute_paired_ratio(samples, reference.samples_s).value
            halves = _compute_halves(np.divide(samples, reference.samples_s), reference.epochs)
            table.loc[member] = [ratio, *halves]
    table["seconds"] *= float(np.median(reference_s))
    return table, float(np.median(empty_s))


def _group_draws(names: Sequence[str]) -> Iterator[list[int]]:
    """Yield groups of indices of draws to time together, where equal names share a group.

    Names are in any order. Groups mix small and large draws, so that a slow minute affects all
    kinds alike.
    """
    labels = np.unique(np.asarray(names), return_inverse=True)[1]
    members: list[int] = []
    for label in np.random.default_rng(0).permutation(labels.max(initial=-1) + 1):
        indices = np.flatnonzero(labels == label).tolist()
        if members and len(members) + len(indices) > MAX_GROUP_DRAWS:
            yield members
            members = []
        members += indices
    if members:
        yield members


def _compute_halves(rounds: NDArray[np.float64], epochs: Sequence[int]) -> list[float]:
    """Return the medians of the two halves of the rounds.

    With several epochs, the halves are the even and the odd epochs: positions in memory change
    between epochs, an effect that more rounds do not average out.
    """
    has_epochs = len(epochs) > 1 and sum(epochs) == len(rounds)
    numbers = np.repeat(np.arange(len(epochs)), epochs) if has_epochs else np.arange(len(rounds))
    return [float(np.median(rounds[numbers % 2 == half])) for half in range(2)]


def predict_by_law(profile: dict[str, Any], table: pd.DataFrame) -> NDArray[np.float64]:
    """Return the seconds of draws by the law of a profile from exact counters, without `draw`."""
    costs = {term["name"]: term["cost"] for term in profile["terms"]} | {"draw": 0.0}
    rows = make_design_rows(table[list(DRAW_COUNTERS)].assign(work=0).to_dict("records"))
    return predict_times(rows, np.array([costs[name] for name in TERMS]), profile["form"])


def scale_prediction(
    seconds: NDArray[np.float64], empty: float, cost: NDArray[np.float64]
) -> tuple[NDArray[np.float64], float]:
    """Return the predicted times in this session, and its speed relative to the profile's."""
    speed = float(np.median((seconds - empty) / cost))
    return empty + speed * cost, speed


def format_r_squared(
    name: str, seconds: NDArray[np.float64], predicted: NDArray[np.float64], polygons: list[str]
) -> dict[str, str]:
    """Return R2 of log time over all draws and within polygons, as columns."""
    over = compute_r_squared(np.log(seconds), np.log(predicted))
    within = compute_r_squared_within(seconds, predicted, polygons)
    return {f"{name}_over": f"{over:.4f}", f"{name}_within": f"{within:.4f}"}


def compute_reliability(table: pd.DataFrame) -> float:
    """Return the share of the variance within polygons that is not noise."""
    logs = np.log(table[HALVES])
    centred = logs - logs.groupby(table["polygon"]).transform("mean")
    correlation = float(np.corrcoef(centred.T)[0, 1])
    return 2.0 * correlation / (1.0 + correlation)


if __name__ == "__main__":
    main()
