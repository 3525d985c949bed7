"""Simulate the coverage of each confidence interval of the harness.

    PYTHONPATH=. python scripts/studies/interval_coverage.py [--trials 2000] [--out FILE]

A row has a kind of interval and a kind of data with a known true value: the share of studies in
which the interval was reported, the share of these in which it covered the true value, and the
same share for a simpler interval (the percentile bootstrap, or a ratio that ignores processes,
runs or the choice among several). The data are synthetic, except the regrets of the city, which
are resampled from `results/reference`. Results are reproducible. `laws.py` simulates the costs of
profiles.
"""

import argparse
import csv
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.compare.matching import Pair
from harness.compare.model import Settings
from harness.compare.times import compare_group
from harness.frame import View
from harness.metrics.break_even import compute_break_even
from harness.metrics.decision import decide_group
from harness.metrics.groups import compute_time_ratio, group_records
from harness.metrics.statistics import (
    RUN_SCATTER,
    UNKNOWN,
    add_run_scatter,
    compute_mean_interval,
    compute_median_interval,
    compute_paired_ratio,
    compute_ratio_interval,
    compute_spearman,
)
from harness.rasterisers.base import Options
from harness.results.record import CaseId, Record, Time
from harness.study.correlations import estimate_median
from harness.study.regret import compute_regret_interval, estimate_regret
from scripts.studies.machines import EPOCHS, MACHINES, Machine, quiet, simulate_run

REGRETS = Path("results/reference/cpu/regret-city/regret_by_polygon.csv")
DOMINATED = "of which one polygon has a quarter"
"""Data of which a sample of the same size misses the dominant polygon in one of three studies, so
that no interval is reliable."""

COLUMNS = ("interval", "data", "number", "trials", "reported", "covered", "covered_simpler")

Values = NDArray[np.float64]
Ends = tuple[float, float]


class Trial(NamedTuple):
    """The intervals of a simulated study, by our method and a simpler one, and the true value."""

    ends: Ends
    simpler: Ends | None
    truth: float


class Kind(NamedTuple):
    """A kind of interval and of data: the number of values, and the function that makes a study."""

    interval: str
    data: str
    number: int
    make: Callable[[np.random.Generator], Trial]


def main() -> int:
    """Simulate all kinds; return 1 if the coverage of a kind except `DOMINATED` is below 93 %."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    rows = []
    for kind in list_kinds():
        rows.append(simulate(kind, options.trials))
        print(*(rows[-1][name] for name in COLUMNS), sep=",", flush=True)
    if options.out:
        with options.out.open("w", newline="") as stream:
            writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    checked = [row for row in rows if DOMINATED not in row["data"]]
    return int(any(float(row["covered"]) < 0.93 for row in checked))


def simulate(kind: Kind, trials: int) -> dict[str, str]:
    """Return a row of `COLUMNS`."""
    rng = np.random.default_rng(_seed(kind))
    reported = covered = simpler_reported = simpler_covered = 0
    for _ in range(trials):
        trial = kind.make(rng)
        if np.isfinite(trial.ends).all():
            reported += 1
            covered += trial.ends[0] <= trial.truth <= trial.ends[1]
        if trial.simpler is not None:
            simpler_reported += 1
            simpler_covered += trial.simpler[0] <= trial.truth <= trial.simpler[1]
    return {
        "interval": kind.interval,
        "data": kind.data,
        "number": str(kind.number),
        "trials": str(trials),
        "reported": f"{reported / trials:.3f}",
        "covered": f"{covered / max(reported, 1):.3f}",
        "covered_simpler": f"{simpler_covered / simpler_reported:.3f}" if simpler_reported else "",
    }


def _seed(kind: Kind) -> int:
    """Return a reproducible seed."""
    return sum((index + 1) * ord(letter) for index, letter in enumerate(kind.data)) + kind.number


def list_kinds() -> Iterator[Kind]:
    """Yield the kinds of intervals and data to simulate."""
    for number in (8, 12, 16, 24):
        yield Kind(
            "mean over polygons", "exponential", number, partial(_simulate_exponential, number)
        )
    for name, values in _read_city_regrets():
        make = partial(_resample, values, len(values))
        dominated = f", {DOMINATED}" if values.max() > 0.25 * values.sum() else ""
        yield Kind("mean over polygons", f"city's regret by {name}{dominated}", len(values), make)
    for number in (8, 12, 24):
        yield Kind(
            "regret of times",
            "a winner among 40",
            number,
            partial(_simulate_time_regret, number, 0.01),
        )
        yield Kind(
            "regret of times",
            "40 that are equal",
            number,
            partial(_simulate_time_regret, number, 0.0),
        )
        yield Kind("correlation", "rank, skewed", number, partial(_simulate_correlation, number))
        yield Kind("criteria compared", "paired ranks", number, partial(_simulate_criteria, number))
    for number in (8, 12, 24):
        yield Kind("ratio over tiles", "sizes differ", number, partial(_simulate_tiles, number))
    yield from _list_time_kinds()


def _list_time_kinds() -> Iterator[Kind]:
    yield Kind("ratio of times", "epochs differ", 6, partial(_simulate_ratio, 6, 1))
    for number in (6, 24):
        yield Kind(
            "ratio of times", "runs and epochs differ", number, partial(_simulate_any_run, number)
        )
    for repeats in (2, 3, 5, 10):
        yield Kind(
            "ratio of times",
            "repeats and epochs differ",
            repeats,
            partial(_simulate_ratio, 6, repeats),
        )
    for name, machine in MACHINES.items():
        for tail in (False, True):
            data = f"{name}{', tails' * tail}"
            yield Kind(
                "ratio of times in use",
                data,
                EPOCHS,
                partial(_simulate_machine_in_use, machine, tail),
            )
    yield Kind("the best of seven", "rivals within 0.3 %", EPOCHS, _simulate_winner)
    yield Kind("median time", "samples scatter by 1 %", 72, partial(_simulate_median_time, 0.0))
    yield Kind("median time", "heavy tails", 72, partial(_simulate_median_time, 0.05))
    for saved in (0.8, 0.9, 0.97):
        for scatter in (0.02, 0.1):
            for rounds in (5, 12):
                data = f"{1 - saved:.0%} saved, rounds scatter by {scatter:.0%}"
                yield Kind(
                    "break-even",
                    data,
                    rounds,
                    partial(_simulate_break_even, saved, scatter, rounds),
                )
    for noise, between in ((0.01, 0.0), (0.01, 0.005), (0.1, 0.005)):
        data = f"samples {noise:.0%} and runs {between:.1%} apart"
        yield Kind("two runs compared", data, 5, partial(_simulate_two_runs, noise, between))


def _simulate_exponential(number: int, rng: np.random.Generator) -> Trial:
    values = rng.exponential(size=number)
    return Trial(_mean_interval(values, rng), _percentile_interval(values, rng), 1.0)


def _simulate_tiles(number: int, rng: np.random.Generator) -> Trial:
    """Count tiles whose lanes differ threefold and whose larger tiles save less."""
    spread, slope = 0.6, 0.05

    size = rng.standard_normal(number)
    base = np.exp(spread * size)
    values = base * (0.7 + slope * size + 0.05 * rng.standard_normal(number))
    resamples = rng.integers(number, size=(999, number))
    ratios = values[resamples].sum(axis=1) / base[resamples].sum(axis=1)
    low, high = np.quantile(ratios, [0.025, 0.975])
    return Trial(compute_ratio_interval(values, base), (low, high), 0.7 + slope * spread)


def _resample(values: Values, number: int, rng: np.random.Generator) -> Trial:
    resamples = rng.choice(values, number)
    return Trial(
        _mean_interval(resamples, rng), _percentile_interval(resamples, rng), float(values.mean())
    )


def _read_city_regrets() -> Iterator[tuple[str, Values]]:
    """Yield the regrets of each criterion where no polygon has half of the total."""
    table = pd.read_csv(REGRETS)
    table = table[(table["measure"] == "helper_lanes") & (table["kind"] == "criterion")]
    for (resolution, name), part in table.groupby(["resolution", "name"]):
        values = part["regret"].to_numpy(float)
        if 0 < 2 * values.max() < values.sum():
            yield f"{name} at {resolution} px", values


def _simulate_time_regret(polygons: int, spread: float, rng: np.random.Generator) -> Trial:
    """Time 40 triangulations of each polygon in 6 epochs; a criterion chose the first.

    spread : mean relative excess over the fastest; the chosen one has half of it
    """

    ends = []
    for _ in range(polygons):
        longer = rng.exponential(spread, 40) if spread else np.zeros(40)
        longer[0] = rng.exponential(spread / 2) if spread else 0.0
        longer[1] = 0.0
        seconds = np.exp(longer[:, None] + 0.004 * rng.standard_normal((40, 6)))
        ends.append(estimate_regret(seconds, 0))
    truth = 1 / (1 - spread / 2) - 1
    below, above = np.array(ends).T
    return Trial(compute_regret_interval(below, above), _percentile_interval(below, rng), truth)


def _simulate_correlation(polygons: int, rng: np.random.Generator) -> Trial:
    levels = 1 - rng.exponential(0.1, polygons)
    estimate = estimate_median(levels)
    simpler = _percentile_interval(levels, rng, np.median)
    return Trial((estimate.low, estimate.high), simpler, 1 - 0.1 * np.log(2))


def _simulate_criteria(polygons: int, rng: np.random.Generator) -> Trial:
    """Rank 20 triangulations by two equally good predictions; the true difference is 0."""

    columns: tuple[list[tuple[Values, Values]], ...] = ([], [])
    for _ in range(polygons):
        true_values = rng.standard_normal(20)
        noise = rng.uniform(0.1, 1.0)
        for column in columns:
            column.append((true_values + noise * rng.standard_normal(20), true_values))
    first, second = (np.array([compute_spearman(*pair) for pair in column]) for column in columns)
    estimate = estimate_median(first - second)
    return Trial(
        (estimate.low, estimate.high), _percentile_interval(first - second, rng, np.median), 0.0
    )


def _simulate_ratio(epochs: int, repeats: int, rng: np.random.Generator) -> Trial:
    """Time 10 rounds per epoch; deviations: rounds 1 %, epochs 0.3 %, processes 0.5 %."""

    process = np.repeat(0.005 * rng.standard_normal(repeats), epochs * 10)
    epoch = np.repeat(0.003 * rng.standard_normal(repeats * epochs), 10)
    logs = epoch + 0.01 * rng.standard_normal(len(epoch))
    parts = [epochs * 10] * repeats if repeats > 1 else None
    if repeats > 1:
        logs = logs + process
    ones = np.ones(len(logs))
    interval = compute_paired_ratio(np.exp(logs), ones, [10] * (epochs * repeats), parts)
    simpler = compute_paired_ratio(np.exp(logs), ones, [10] * (epochs * repeats))
    return Trial((interval.low, interval.high), (simpler.low, simpler.high), 1.0)


def _simulate_any_run(epochs: int, rng: np.random.Generator) -> Trial:
    """Time one process as in `_simulate_ratio`, in a run that deviates by `RUN_SCATTER`."""

    epoch = np.repeat(0.003 * rng.standard_normal(epochs), 10)
    logs = RUN_SCATTER * rng.standard_normal() + epoch
    logs = logs + 0.01 * rng.standard_normal(len(epoch))
    simpler = compute_paired_ratio(np.exp(logs), np.ones(len(logs)), [10] * epochs)
    interval = add_run_scatter(simpler)
    return Trial((interval.low, interval.high), (simpler.low, simpler.high), 1.0)


def _simulate_machine_in_use(machine: Machine, tail: bool, rng: np.random.Generator) -> Trial:
    """Time two drawings with a true ratio of 0.9 on a machine in use."""

    base, head = simulate_run(rng, machine, (1.0, 0.9), tail)
    assert base.time is not None
    assert head.time is not None
    interval = compute_time_ratio(head, base)
    simpler = compute_paired_ratio(head.time.samples_s, base.time.samples_s)
    assert interval is not None
    return Trial((interval.low, interval.high), (simpler.low, simpler.high), 0.9)


def _simulate_winner(rng: np.random.Generator) -> Trial:
    """Choose the fastest of six drawings that take 0.9 to 0.903 of the baseline's time."""
    factors = (1.0, *(0.9 * np.exp(rng.uniform(0, 0.003, 6))))
    (group,) = group_records(simulate_run(rng, quiet, factors))
    records, decision = group.records, decide_group(group)
    if decision is None or decision.saving is None:
        return Trial(UNKNOWN, None, 1.0)
    number = int(decision.choice.name.split()[1])
    simpler = compute_time_ratio(records[number], records[0])
    assert simpler is not None
    interval = decision.saving
    return Trial((interval.low, interval.high), (simpler.low, simpler.high), factors[number])


def _simulate_median_time(heavy: float, rng: np.random.Generator) -> Trial:
    """Time a drawing of 1 s; a share `heavy` of its samples takes many times as long."""

    samples = np.exp(0.01 * rng.standard_normal(72))
    longer = rng.random(72) < heavy
    samples *= 1 + longer * rng.pareto(1.2, 72)
    # Median of the mixture; nearly all of its longer samples are above all other samples.
    truth = float(np.exp(0.01 * NormalDist().inv_cdf(0.5 / (1 - heavy)))) if heavy else 1.0
    return Trial(compute_median_interval(samples.tolist()), None, truth)


DRAW_S, LONGER_S, ONCE_S = 1e-3, 0.1, 0.02
DRAW_EPOCHS = [12] * 8


def _simulate_break_even(
    ratio: float, scatter: float, rounds: int, rng: np.random.Generator
) -> Trial:
    """Draw in `ratio` times the baseline's time, after triangulating for five times as long.

    Rounds of triangulation vary by `scatter`, draws by 2 % within and 0.5 % between epochs.
    """
    truth = (LONGER_S - ONCE_S) / (DRAW_S * (1 - ratio)) * float(np.exp(scatter**2 / 2))

    def record(rng: np.random.Generator, draw_s: float, seconds: float) -> Record:
        epoch_shifts = np.repeat(rng.normal(0, 0.005, len(DRAW_EPOCHS)), DRAW_EPOCHS)
        samples = draw_s * np.exp(epoch_shifts + rng.normal(0, 0.02, sum(DRAW_EPOCHS)))
        triangulate_s = tuple((seconds * np.exp(rng.normal(0, scatter, rounds))).tolist())
        time = Time(
            samples_s=tuple(samples.tolist()),
            median_s=float(np.median(samples)),
            ci95_s=compute_median_interval(samples.tolist()),
            epochs=tuple(DRAW_EPOCHS),
            round_group="one",
        )
        case = CaseId("s", View(), "t", "opengl", "d", Options())
        fields = {"triangulate_s": triangulate_s[0], "triangulate_samples_s": triangulate_s}
        return Record(case, "ok", polygons=1, time=time, **fields)

    base, other = record(rng, DRAW_S, ONCE_S), record(rng, ratio * DRAW_S, LONGER_S)
    estimate = compute_break_even(other, base, compute_time_ratio(other, base))
    if estimate is None or estimate.kind != "after" or estimate.high is None:
        return Trial(UNKNOWN, None, truth)
    return Trial((estimate.low or 0.0, estimate.high), None, truth)


def _simulate_two_runs(noise: float, between: float, rng: np.random.Generator) -> Trial:
    """Compare two runs of five cases, where the first case has become 10 % slower.

    The second machine is about 5 % faster or slower, cases vary by `between` from one run to the
    next, and other programs slow samples down by `noise`.
    """

    drift = np.exp(rng.normal(0, 0.05))
    reference = 1e-3 * _disturbed(rng, noise), 1e-3 * drift * _disturbed(rng, noise)
    pairs = []
    for growth in (1.1, 1.0, 1.0, 1.0, 1.0):
        head = 3e-3 * drift * growth * np.exp(rng.normal(0, between)) * _disturbed(rng, noise)
        pairs.append(Pair(3e-3 * _disturbed(rng, noise), head, reference, True))
    (interval, *_), _ = compare_group("group", pairs, Settings(), machines_differ=False)
    if interval.low is None or interval.high is None:
        return Trial(UNKNOWN, None, 1.1)
    return Trial((interval.low, interval.high), None, 1.1)


def _disturbed(rng: np.random.Generator, noise: float) -> Values:
    return 1 + np.abs(rng.normal(0, noise, 30))


def _mean_interval(values: Values, rng: np.random.Generator) -> Ends:
    return compute_mean_interval(values, int(rng.integers(1 << 31)))


def _percentile_interval(
    values: Values, rng: np.random.Generator, statistic: Callable[..., Values] = np.mean
) -> Ends:
    resamples = values[rng.integers(len(values), size=(999, len(values)))]
    low, high = np.quantile(statistic(resamples, axis=1), [0.025, 0.975])
    return float(low), float(high)


if __name__ == "__main__":
    sys.exit(main())
