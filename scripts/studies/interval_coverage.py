"""How often each interval of the harness holds the truth, by simulation.

    PYTHONPATH=. python scripts/studies/interval_coverage.py [--trials 2000] [--out FILE]

Every row is one kind of interval under one kind of data whose truth is known: how often it was
given at all, how often it then held the truth, and how often a simpler one would have: the
percentile bootstrap, a ratio that knows nothing of processes, runs, or of the choice among several.
The data are made up, but for the city's own regrets, which are drawn from `results/reference`. The
same at every call. A profile's costs have a program of their own, `laws.py`.
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

from harness.compare.model import Settings
from harness.compare.times import Pair, judge_group
from harness.frame import View
from harness.metrics.break_even import break_even
from harness.metrics.decision import decide
from harness.metrics.groups import group_records, time_ratio
from harness.metrics.per_polygon import spearman
from harness.rasterisers.base import Options
from harness.results.record import CaseId, Record, Time
from harness.stats.intervals import (
    CONFIDENCE,
    RUN_SCATTER,
    UNKNOWN,
    mean_interval,
    median_interval,
    of_any_run,
    paired_ratio,
    ratio_interval,
)
from harness.study.correlations import median_estimate
from harness.study.regret import regret_ends, regret_interval
from scripts.studies.machines import EPOCHS, MACHINES, Machine, quiet, timed

REGRETS = Path("results/reference/cpu/regret-city/regret_by_polygon.csv")
DECIDED = "of which one polygon has a quarter"
"""Data that a study of as many others has not seen in one of three times: no interval is sure."""

COLUMNS = ("interval", "data", "number", "trials", "told", "covered", "before")

Values = NDArray[np.float64]
Ends = tuple[float, float]


def share_interval(shares: NDArray[np.float64]) -> tuple[float, float]:
    """Return the 95 % interval of a mean share, of (g,) independent groups' shares.

    Comparisons that share rounds are not independent, and count as one group. Where no group, or
    every one, is affected, it is what as many groups can rule out: with 95 % confidence at most
    1 - 0.05^(1/g) of groups are otherwise.
    """
    if len(shares) == 0:
        return UNKNOWN
    seen = 1 - (1 - CONFIDENCE) ** (1 / len(shares))
    if (shares == 0).all():
        return 0.0, seen
    if (shares == 1).all():
        return 1 - seen, 1.0
    low, high = mean_interval(shares)
    return max(0.0, low), min(1.0, high)


class Trial(NamedTuple):
    """What one simulated study says, what a simpler interval would, if there is one; the truth."""

    ends: Ends
    before: Ends | None
    truth: float


class Kind(NamedTuple):
    """A kind of interval and of data; `number` of values, and how one study is made."""

    interval: str
    data: str
    number: int
    make: Callable[[np.random.Generator], Trial]


def main() -> int:
    """Simulate each kind; returns 1 where one covers less than 93 %, `DECIDED` apart."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    rows = []
    for kind in kinds():
        rows.append(simulate(kind, given.trials))
        print(*(rows[-1][name] for name in COLUMNS), sep=",", flush=True)
    if given.out:
        with given.out.open("w", newline="") as stream:
            writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    judged = [row for row in rows if DECIDED not in row["data"]]
    return int(any(float(row["covered"]) < 0.93 for row in judged))


def simulate(kind: Kind, trials: int) -> dict[str, str]:
    """Return a row of `COLUMNS`."""
    rng = np.random.default_rng(_seed(kind))
    told = held = simpler = before = 0
    for _ in range(trials):
        trial = kind.make(rng)
        if np.isfinite(trial.ends).all():
            told += 1
            held += trial.ends[0] <= trial.truth <= trial.ends[1]
        if trial.before is not None:
            simpler += 1
            before += trial.before[0] <= trial.truth <= trial.before[1]
    return {
        "interval": kind.interval,
        "data": kind.data,
        "number": str(kind.number),
        "trials": str(trials),
        "told": f"{told / trials:.3f}",
        "covered": f"{held / max(told, 1):.3f}",
        "before": f"{before / simpler:.3f}" if simpler else "",
    }


def _seed(kind: Kind) -> int:
    """Return a seed that is the same at every call."""
    return sum((place + 1) * ord(letter) for place, letter in enumerate(kind.data)) + kind.number


def kinds() -> Iterator[Kind]:
    """Yield all that is simulated."""
    for number in (8, 12, 16, 24):
        yield Kind("mean over polygons", "exponential", number, partial(_exponential, number))
    for name, values in _regrets_of_the_city():
        make = partial(_resampled, values, len(values))
        decided = f", {DECIDED}" if values.max() > 0.25 * values.sum() else ""
        yield Kind("mean over polygons", f"city's regret by {name}{decided}", len(values), make)
    for number in (8, 12, 24):
        yield Kind(
            "regret of times", "a winner among 40", number, partial(_regret_of_times, number, 0.01)
        )
        yield Kind(
            "regret of times", "40 that are equal", number, partial(_regret_of_times, number, 0.0)
        )
        yield Kind("correlation", "rank, skewed", number, partial(_correlation, number))
        yield Kind("criteria compared", "paired ranks", number, partial(_compared, number))
    for number in (8, 12, 24):
        yield Kind("ratio over tiles", "sizes differ", number, partial(_over_tiles, number))
    yield from _of_times()
    for number in (12, 24):
        yield Kind("share of A/A pairs", "groups share rounds", number, partial(_share, number))


def _of_times() -> Iterator[Kind]:
    yield Kind("ratio of times", "epochs differ", 6, partial(_ratio, 6, 1))
    for number in (6, 24):
        yield Kind(
            "ratio of times", "runs and epochs differ", number, partial(_ratio_of_any_run, number)
        )
    for repeats in (2, 3, 5, 10):
        yield Kind(
            "ratio of times", "repeats and epochs differ", repeats, partial(_ratio, 6, repeats)
        )
    for name, machine in MACHINES.items():
        for tail in (False, True):
            data = f"{name}{', tails' * tail}"
            yield Kind("ratio of times in use", data, EPOCHS, partial(_in_use, machine, tail))
    yield Kind("the best of seven", "rivals within 0.3 %", EPOCHS, _winner)
    yield Kind("median time", "samples scatter by 1 %", 72, partial(_median_time, 0.0))
    yield Kind("median time", "heavy tails", 72, partial(_median_time, 0.05))
    for saved in (0.8, 0.9, 0.97):
        for scatter in (0.02, 0.1):
            for rounds in (5, 12):
                data = f"{1 - saved:.0%} saved, rounds scatter by {scatter:.0%}"
                yield Kind("break-even", data, rounds, partial(_break_even, saved, scatter, rounds))
    for noise, between in ((0.01, 0.0), (0.01, 0.005), (0.1, 0.005)):
        data = f"samples {noise:.0%} and runs {between:.1%} apart"
        yield Kind("two runs compared", data, 5, partial(_two_runs, noise, between))


def _exponential(number: int, rng: np.random.Generator) -> Trial:
    values = rng.exponential(size=number)
    return Trial(_mean(values, rng), _percentile(values, rng), 1.0)


def _over_tiles(number: int, rng: np.random.Generator) -> Trial:
    """Count tiles whose lanes differ threefold, and of which larger ones are saved less."""
    spread, slope = 0.6, 0.05

    size = rng.standard_normal(number)
    base = np.exp(spread * size)
    values = base * (0.7 + slope * size + 0.05 * rng.standard_normal(number))
    drawn = rng.integers(number, size=(999, number))
    ratios = values[drawn].sum(axis=1) / base[drawn].sum(axis=1)
    low, high = np.quantile(ratios, [0.025, 0.975])
    return Trial(ratio_interval(values, base), (low, high), 0.7 + slope * spread)


def _resampled(values: Values, number: int, rng: np.random.Generator) -> Trial:
    drawn = rng.choice(values, number)
    return Trial(_mean(drawn, rng), _percentile(drawn, rng), float(values.mean()))


def _regrets_of_the_city() -> Iterator[tuple[str, Values]]:
    """Yield the regrets of each criterion for which no polygon has half of them all."""
    table = pd.read_csv(REGRETS)
    table = table[(table["measure"] == "helper_lanes") & (table["kind"] == "criterion")]
    for (resolution, name), part in table.groupby(["resolution", "name"]):
        values = part["regret"].to_numpy(float)
        if 0 < 2 * values.max() < values.sum():
            yield f"{name} at {resolution} px", values


def _regret_of_times(polygons: int, spread: float, rng: np.random.Generator) -> Trial:
    """Time 40 triangulations of each polygon in 6 epochs; the first is what a criterion chose.

    spread : mean of how much longer each takes than the fastest; the choice is among the better
    """

    ends = []
    for _ in range(polygons):
        longer = rng.exponential(spread, 40) if spread else np.zeros(40)
        longer[0] = rng.exponential(spread / 2) if spread else 0.0
        longer[1] = 0.0
        seconds = np.exp(longer[:, None] + 0.004 * rng.standard_normal((40, 6)))
        ends.append(regret_ends(seconds, 0))
    truth = 1 / (1 - spread / 2) - 1
    below, above = np.array(ends).T
    return Trial(regret_interval(below, above), _percentile(below, rng), truth)


def _correlation(polygons: int, rng: np.random.Generator) -> Trial:
    levels = 1 - rng.exponential(0.1, polygons)
    estimate = median_estimate(levels)
    before = _percentile(levels, rng, np.median)
    return Trial((estimate.low, estimate.high), before, 1 - 0.1 * np.log(2))


def _compared(polygons: int, rng: np.random.Generator) -> Trial:
    """Rank 20 triangulations by two predictions that are equally good; before: do they meet?"""

    columns: tuple[list[tuple[Values, Values]], ...] = ([], [])
    for _ in range(polygons):
        truth = rng.standard_normal(20)
        noise = rng.uniform(0.1, 1.0)
        for each in columns:
            each.append((truth + noise * rng.standard_normal(20), truth))
    one, two = (np.array([spearman(*pair) for pair in each]) for each in columns)
    estimate = median_estimate(one - two)
    return Trial((estimate.low, estimate.high), _percentile(one - two, rng, np.median), 0.0)


def _ratio(epochs: int, repeats: int, rng: np.random.Generator) -> Trial:
    """Time in 10 rounds an epoch: 1 % apart by rounds, 0.3 % by epochs and 0.5 % by processes."""

    process = np.repeat(0.005 * rng.standard_normal(repeats), epochs * 10)
    epoch = np.repeat(0.003 * rng.standard_normal(repeats * epochs), 10)
    logs = epoch + 0.01 * rng.standard_normal(len(epoch))
    parts = [epochs * 10] * repeats if repeats > 1 else None
    if repeats > 1:
        logs = logs + process
    ones = np.ones(len(logs))
    found = paired_ratio(np.exp(logs), ones, [10] * (epochs * repeats), parts)
    old = paired_ratio(np.exp(logs), ones, [10] * (epochs * repeats))
    return Trial((found.low, found.high), (old.low, old.high), 1.0)


def _ratio_of_any_run(epochs: int, rng: np.random.Generator) -> Trial:
    """Time one process as `_ratio` does, in a run that is off by what runs scatter."""

    epoch = np.repeat(0.003 * rng.standard_normal(epochs), 10)
    logs = RUN_SCATTER * rng.standard_normal() + epoch
    logs = logs + 0.01 * rng.standard_normal(len(epoch))
    old = paired_ratio(np.exp(logs), np.ones(len(logs)), [10] * epochs)
    found = of_any_run(old)
    return Trial((found.low, found.high), (old.low, old.high), 1.0)


def _in_use(machine: Machine, tail: bool, rng: np.random.Generator) -> Trial:
    """Time two drawings, of which one takes 0.9 of the other's time, on a machine in use."""

    base, head = timed(rng, machine, (1.0, 0.9), tail)
    assert base.time is not None
    assert head.time is not None
    found = time_ratio(head, base)
    old = paired_ratio(head.time.samples_s, base.time.samples_s)
    assert found is not None
    return Trial((found.low, found.high), (old.low, old.high), 0.9)


def _winner(rng: np.random.Generator) -> Trial:
    """Name the best of six that take 0.9 to 0.903 of the base's time, and what it saves."""
    factors = (1.0, *(0.9 * np.exp(rng.uniform(0, 0.003, 6))))
    records = timed(rng, quiet, factors)
    (group,) = group_records(records)
    decision = decide(group)
    if decision is None or decision.saving is None:
        return Trial(UNKNOWN, None, 1.0)
    number = int(decision.choice.name.split()[1])
    plain = time_ratio(records[number], records[0])
    assert plain is not None
    found = decision.saving
    return Trial((found.low, found.high), (plain.low, plain.high), factors[number])


def _median_time(heavy: float, rng: np.random.Generator) -> Trial:
    """Time one drawing of 1 s; a share `heavy` of its samples take many times as long."""

    samples = np.exp(0.01 * rng.standard_normal(72))
    longer = rng.random(72) < heavy
    samples *= 1 + longer * rng.pareto(1.2, 72)
    # The median of the mixture, whose longer part lies above all the rest by nearly as much.
    truth = float(np.exp(0.01 * NormalDist().inv_cdf(0.5 / (1 - heavy)))) if heavy else 1.0
    return Trial(median_interval(samples.tolist()), None, truth)


DRAW_S, LONGER_S, ONCE_S = 1e-3, 0.1, 0.02
DRAW_EPOCHS = [12] * 8


def _break_even(ratio: float, scatter: float, rounds: int, rng: np.random.Generator) -> Trial:
    """Draw in `ratio` of the base's time, after triangulating for five times as long.

    Rounds of triangulating scatter by `scatter`, draws by 2 % within and 0.5 % between epochs.
    """
    truth = (LONGER_S - ONCE_S) / (DRAW_S * (1 - ratio)) * float(np.exp(scatter**2 / 2))

    def record(rng: np.random.Generator, draw_s: float, seconds: float) -> Record:
        places = np.repeat(rng.normal(0, 0.005, len(DRAW_EPOCHS)), DRAW_EPOCHS)
        samples = draw_s * np.exp(places + rng.normal(0, 0.02, sum(DRAW_EPOCHS)))
        triangulating = tuple((seconds * np.exp(rng.normal(0, scatter, rounds))).tolist())
        time = Time(
            samples_s=tuple(samples.tolist()),
            median_s=float(np.median(samples)),
            ci95_s=median_interval(samples.tolist()),
            epochs=tuple(DRAW_EPOCHS),
            round_group="one",
        )
        case = CaseId("s", View(), "t", "opengl", "d", Options())
        more = {"triangulate_s": triangulating[0], "triangulate_samples_s": triangulating}
        return Record(case, "ok", polygons=1, time=time, **more)

    base, other = record(rng, DRAW_S, ONCE_S), record(rng, ratio * DRAW_S, LONGER_S)
    even = break_even(other, base, time_ratio(other, base))
    if even is None or even.kind != "after" or even.high is None:
        return Trial(UNKNOWN, None, truth)
    return Trial((even.low or 0.0, even.high), None, truth)


def _two_runs(noise: float, between: float, rng: np.random.Generator) -> Trial:
    """Compare two runs of five cases, of which the first grew by a tenth.

    The second run's machine is faster or slower by some 5 %, cases differ by `between` from one run
    to the next, and other programs lengthen samples by `noise`.
    """

    drift = np.exp(rng.normal(0, 0.05))
    reference = 1e-3 * _lengthened(rng, noise), 1e-3 * drift * _lengthened(rng, noise)
    pairs = []
    for growth in (1.1, 1.0, 1.0, 1.0, 1.0):
        head = 3e-3 * drift * growth * np.exp(rng.normal(0, between)) * _lengthened(rng, noise)
        pairs.append(Pair(3e-3 * _lengthened(rng, noise), head, reference, True))
    (found, *_), _ = judge_group("here", pairs, Settings(), machines_differ=False)
    if found.low is None or found.high is None:
        return Trial(UNKNOWN, None, 1.1)
    return Trial((found.low, found.high), None, 1.1)


def _lengthened(rng: np.random.Generator, noise: float) -> Values:
    return 1 + np.abs(rng.normal(0, noise, 30))


def _share(groups: int, rng: np.random.Generator) -> Trial:
    """Compare six equal drawings in pairs, 15 a group; a drawing that is off is so in 5 pairs."""

    off = rng.binomial(6, 0.08, groups)
    shares = off * (6 - off) / 15
    expected = 6 * 0.08 * 0.92 * 5 / 15
    pooled = float(np.mean(shares))
    reach = 1.96 * np.sqrt(max(pooled * (1 - pooled), 1e-12) / (15 * groups))
    return Trial(share_interval(shares), (pooled - reach, pooled + reach), expected)


def _mean(values: Values, rng: np.random.Generator) -> Ends:
    return mean_interval(values, int(rng.integers(1 << 31)))


def _percentile(
    values: Values, rng: np.random.Generator, statistic: Callable[..., Values] = np.mean
) -> Ends:
    drawn = values[rng.integers(len(values), size=(999, len(values)))]
    low, high = np.quantile(statistic(drawn, axis=1), [0.025, 0.975])
    return float(low), float(high)


if __name__ == "__main__":
    sys.exit(main())
