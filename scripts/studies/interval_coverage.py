"""How often each interval of the harness holds the truth, by simulation.

    PYTHONPATH=. python scripts/studies/interval_coverage.py [--trials 2000] [--out FILE]

Every row is one kind of interval under one kind of data whose truth is known: how often it was
given at all, how often it then held the truth, and how often the percentile bootstrap, or what was
there before, would have. The data are made up, but for the city's own regrets, which are drawn from
`results/reference`. The same at every call.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.figures.intervals import (
    CONFIDENCE,
    RUN_SCATTER,
    UNKNOWN,
    mean_interval,
    of_any_run,
    paired_ratio,
    ratio_interval,
)
from harness.study.correlations import by_polygon, median_estimate
from harness.study.regret import regret_ends, regret_interval

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
    """What one simulated study says, and what is true: the interval, and the one before."""

    ends: Ends
    before: Ends
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
    told = held = before = 0
    for _ in range(trials):
        trial = kind.make(rng)
        if np.isfinite(trial.ends).all():
            told += 1
            held += trial.ends[0] <= trial.truth <= trial.ends[1]
        before += trial.before[0] <= trial.truth <= trial.before[1]
    return {
        "interval": kind.interval,
        "data": kind.data,
        "number": str(kind.number),
        "trials": str(trials),
        "told": f"{told / trials:.3f}",
        "covered": f"{held / max(told, 1):.3f}",
        "before": f"{before / trials:.3f}",
    }


def _seed(kind: Kind) -> int:
    """Return a seed that is the same at every call."""
    return sum((place + 1) * ord(letter) for place, letter in enumerate(kind.data)) + kind.number


def kinds() -> Iterator[Kind]:
    """Yield all that is simulated."""
    for number in (8, 12, 16, 24):
        yield Kind("mean over polygons", "exponential", number, _exponential(number))
    for name, values in _regrets_of_the_city():
        make = _resampled(values, len(values))
        decided = f", {DECIDED}" if values.max() > 0.25 * values.sum() else ""
        yield Kind("mean over polygons", f"city's regret by {name}{decided}", len(values), make)
    for number in (8, 12, 24):
        yield Kind("regret of times", "a winner among 40", number, _regret_of_times(number, 0.01))
        yield Kind("regret of times", "40 that are equal", number, _regret_of_times(number, 0.0))
        yield Kind("correlation", "rank, skewed", number, _correlation(number))
        yield Kind("criteria compared", "paired ranks", number, _compared(number))
    for number in (8, 12, 24):
        yield Kind("ratio over tiles", "sizes differ", number, _over_tiles(number))
    yield Kind("ratio of times", "epochs differ", 6, _ratio(6, 1))
    for number in (6, 24):
        yield Kind("ratio of times", "runs and epochs differ", number, _ratio_of_any_run(number))
    for repeats in (2, 3, 5, 10):
        yield Kind("ratio of times", "repeats and epochs differ", repeats, _ratio(6, repeats))
    for number in (12, 24):
        yield Kind("share of A/A pairs", "groups share rounds", number, _share(number))


def _exponential(number: int) -> Callable[[np.random.Generator], Trial]:
    def make(rng: np.random.Generator) -> Trial:
        values = rng.exponential(size=number)
        return Trial(_mean(values, rng), _percentile(values, rng), 1.0)

    return make


def _over_tiles(number: int) -> Callable[[np.random.Generator], Trial]:
    """Count tiles whose lanes differ threefold, and of which larger ones are saved less."""
    spread, slope = 0.6, 0.05

    def make(rng: np.random.Generator) -> Trial:
        size = rng.standard_normal(number)
        base = np.exp(spread * size)
        values = base * (0.7 + slope * size + 0.05 * rng.standard_normal(number))
        drawn = rng.integers(number, size=(999, number))
        ratios = values[drawn].sum(axis=1) / base[drawn].sum(axis=1)
        low, high = np.quantile(ratios, [0.025, 0.975])
        return Trial(ratio_interval(values, base), (low, high), 0.7 + slope * spread)

    return make


def _resampled(values: Values, number: int) -> Callable[[np.random.Generator], Trial]:
    def make(rng: np.random.Generator) -> Trial:
        drawn = rng.choice(values, number)
        return Trial(_mean(drawn, rng), _percentile(drawn, rng), float(values.mean()))

    return make


def _regrets_of_the_city() -> Iterator[tuple[str, Values]]:
    """Yield the regrets of each criterion for which no polygon has half of them all."""
    table = pd.read_csv(REGRETS)
    table = table[(table["measure"] == "helper_lanes") & (table["kind"] == "criterion")]
    for (resolution, name), part in table.groupby(["resolution", "name"]):
        values = part["regret"].to_numpy(float)
        if 0 < 2 * values.max() < values.sum():
            yield f"{name} at {resolution} px", values


def _regret_of_times(polygons: int, spread: float) -> Callable[[np.random.Generator], Trial]:
    """Time 40 triangulations of each polygon in 6 epochs; the first is what a criterion chose.

    spread : mean of how much longer each takes than the fastest; the choice is among the better
    """

    def make(rng: np.random.Generator) -> Trial:
        low, high = [], []
        for _ in range(polygons):
            longer = rng.exponential(spread, 40) if spread else np.zeros(40)
            longer[0] = rng.exponential(spread / 2) if spread else 0.0
            longer[1] = 0.0
            seconds = np.exp(longer[:, None] + 0.004 * rng.standard_normal((40, 6)))
            ends = regret_ends(seconds, 0)
            low.append(ends[0])
            high.append(ends[1])
        truth = 1 / (1 - spread / 2) - 1
        below, above = np.array(low), np.array(high)
        return Trial(regret_interval(below, above), _percentile(below, rng), truth)

    return make


def _correlation(polygons: int) -> Callable[[np.random.Generator], Trial]:
    def make(rng: np.random.Generator) -> Trial:
        levels = 1 - rng.exponential(0.1, polygons)
        estimate = median_estimate("", levels)
        before = _percentile(levels, rng, np.median)
        return Trial((estimate.low, estimate.high), before, 1 - 0.1 * np.log(2))

    return make


def _compared(polygons: int) -> Callable[[np.random.Generator], Trial]:
    """Rank 20 triangulations by two predictions that are equally good; before: do they meet?"""

    def make(rng: np.random.Generator) -> Trial:
        columns: tuple[list[tuple[Values, Values]], ...] = ([], [])
        for _ in range(polygons):
            truth = rng.standard_normal(20)
            noise = rng.uniform(0.1, 1.0)
            for each in columns:
                each.append((truth + noise * rng.standard_normal(20), truth))
        one, two = (by_polygon(each) for each in columns)
        estimate = median_estimate("", one - two)
        return Trial((estimate.low, estimate.high), _percentile(one - two, rng, np.median), 0.0)

    return make


def _ratio(epochs: int, repeats: int) -> Callable[[np.random.Generator], Trial]:
    """Time in 10 rounds an epoch: 1 % apart by rounds, 0.3 % by epochs and 0.5 % by processes."""

    def make(rng: np.random.Generator) -> Trial:
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

    return make


def _ratio_of_any_run(epochs: int) -> Callable[[np.random.Generator], Trial]:
    """Time one process as `_ratio` does, in a run that is off by what runs scatter."""

    def make(rng: np.random.Generator) -> Trial:
        epoch = np.repeat(0.003 * rng.standard_normal(epochs), 10)
        logs = RUN_SCATTER * rng.standard_normal() + epoch
        logs = logs + 0.01 * rng.standard_normal(len(epoch))
        old = paired_ratio(np.exp(logs), np.ones(len(logs)), [10] * epochs)
        found = of_any_run(old)
        return Trial((found.low, found.high), (old.low, old.high), 1.0)

    return make


def _share(groups: int) -> Callable[[np.random.Generator], Trial]:
    """Compare six equal drawings in pairs, 15 a group; a drawing that is off is so in 5 pairs."""

    def make(rng: np.random.Generator) -> Trial:
        off = rng.binomial(6, 0.08, groups)
        shares = off * (6 - off) / 15
        expected = 6 * 0.08 * 0.92 * 5 / 15
        pooled = float(np.mean(shares))
        reach = 1.96 * np.sqrt(max(pooled * (1 - pooled), 1e-12) / (15 * groups))
        return Trial(share_interval(shares), (pooled - reach, pooled + reach), expected)

    return make


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
