"""How often a profile's intervals hold what a device charges: synthetic devices with known costs.

    PYTHONPATH=. python scripts/studies/laws.py OUT.csv [--goes 1000] [--first 0]

Each device charges its own costs for the design's exact counters; about half of the terms cost it
nothing. Its clock is told in steps of 0.1 ms. Every sample is a little noisy, every drawing is a
little faster or slower in each process, and the machine slows down and recovers meanwhile. The
rounds are those of `harness.measuring.timing`, the rest is `harness.profile`.

With --misfit, devices do not keep the law: each draw misses it by 8 to 17 % (root mean square), 40
to 53 % of the variance common to its group, as the published profiles miss theirs; noise, which is
ten times smaller, is left out.

Writes a row for each term: in how many goes it cost something, in what share of them its interval
holds that, and in what share of those in which it cost nothing nothing was shown. The last row is
of all terms: of a device, whether any cost is shown that it does not have.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.measuring.timing import EMPTY, TimerTest, Times, time_together
from harness.profile import design, law, measured
from harness.profile.counted import TERMS, counters, design_of
from harness.rasterisers.base import Sample

STEP_S = 1e-4
NOISE, PLACE, DRIFT = 0.01, 0.03, 0.1
"""Standard deviations of a sample and of a drawing's place, and how far the speed strays."""

WHOLE_S = 1e-3
"""What a term may cost at most in the draw that has most of it."""

LIKELY = 0.5
"""How likely a term costs something; the draw itself and a triangle always do."""

TEST = TimerTest("wall", 0.02, None, STEP_S, "synthetic")


MISFIT, SHARED = (0.08, 0.17), (0.40, 0.53)
"""Of the published profiles: by how much draws miss the law, and the share that groups have."""


class Go(NamedTuple):
    """What one device charges, and the law found of it."""

    truth: NDArray[np.float64]
    found: law.Law


@dataclass
class Clock:
    """The synthetic machine: its time, and its speed, which strays by `DRIFT` and comes back."""

    now: float = 0.0
    logs: list[float] = field(default_factory=list)

    def __call__(self) -> float:
        """Return the seconds that have passed."""
        return self.now

    def spend(self, seconds: float) -> float:
        """Let a batch take so long; returns what a timer of coarse steps tells."""
        slower = DRIFT * np.sin(self.now / 7.0)
        self.logs.append(slower)
        before = np.floor(self.now / STEP_S)
        self.now += seconds * float(np.exp(slower))
        return float((np.floor(self.now / STEP_S) - before) * STEP_S)


class Drawing:
    """One draw that takes `seconds`, somewhere in memory."""

    def __init__(self, seconds: float, clock: Clock, random: np.random.Generator) -> None:
        self.seconds = seconds * float(np.exp(PLACE * random.standard_normal()))
        self.clock = clock
        self.random = random

    def sample(self, repeats: int) -> Sample:
        """Draw so often."""
        noise = float(np.exp(NOISE * self.random.standard_normal()))
        return Sample(wall=self.clock.spend(self.seconds * repeats * noise))


class Design(NamedTuple):
    """The draws that laws are fitted to: rows of `TERMS`, and their groups."""

    rows: NDArray[np.float64]
    groups: list[str]


def designed(seed: int = 0) -> Design:
    """Return the design without what is filled twice."""
    draws = [draw for draw in design.draws(seed) if draw.kind != "twice"]
    return Design(design_of([counters(draw) for draw in draws]), [draw.group for draw in draws])


def go(of: Design, seed: int, budget_s: float = 0.3) -> Go:
    """Make a device, time the design on it and fit its law."""
    random = np.random.default_rng(seed)
    truth = charged(of, random)
    clock = Clock()
    names = [str(number) for number in range(len(of.rows))]
    seconds: Mapping[str, float] = {
        EMPTY: float(truth[0]),
        measured.CONTROL: float(of.rows[len(names) // 2] @ truth),
        **dict(zip(names, (of.rows @ truth).tolist(), strict=True)),
    }

    def prepare(order: Sequence[str]) -> dict[str, Drawing]:
        return {name: Drawing(seconds[name], clock, random) for name in order}

    timing = measured.settings(budget_s)
    parts = []
    speeds: list[float] = []
    for number in range(timing.processes):
        drawings = prepare(list(seconds))
        part = time_together(drawings, timing, TEST, seed=seed + number, clock=clock)
        parts.append(part)
        speeds += clock.logs[-len(seconds) * sum(part[EMPTY].epochs) :]
    times = {name: Times.of_processes([part[name] for part in parts]) for name in seconds}
    told = measured.of_times(times, names)
    found = law.fit(of.rows, told.epochs, of.groups, seed)
    # The law is of the machine at its mean speed in the rounds.
    return Go(truth * float(np.exp(np.mean(speeds))), found)


def misfitting(of: Design, seed: int) -> Go:
    """Make a device that does not keep the law, and fit one to its exact times."""
    random = np.random.default_rng(seed)
    truth = charged(of, random)
    labels = np.unique(of.groups, return_inverse=True)[1]
    missed, shared = random.uniform(*MISFIT), random.uniform(*SHARED)
    common = np.sqrt(shared) * random.standard_normal(labels.max() + 1)[labels]
    errors = missed * (common + np.sqrt(1.0 - shared) * random.standard_normal(len(labels)))
    times = of.rows @ truth * np.maximum(1.0 + errors, 0.2)
    return Go(truth, law.fit(of.rows, times[None], of.groups, seed))


def charged(of: Design, random: np.random.Generator) -> NDArray[np.float64]:
    """Return what a device charges for each term, in seconds."""
    costs = random.random(len(TERMS)) < LIKELY
    costs[:2] = True
    truth = costs * random.uniform(0.1, 1.0, len(TERMS)) * WHOLE_S / of.rows.max(axis=0)
    truth[0] /= 10.0
    return np.asarray(truth)


def main() -> None:
    """Make the goes and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--goes", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--misfit", action="store_true")
    given = parser.parse_args()
    of = designed()
    make = misfitting if given.misfit else go
    goes = [make(of, given.first + number) for number in range(given.goes)]
    with given.out.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("term", "goes", "within", "goes_without_cost", "nothing_shown"))
        for place, name in enumerate(TERMS):
            costs = [each for each in goes if each.truth[place] > 0]
            held = sum(
                bool(low <= each.truth[place] <= high)
                for each in costs
                for low, high in [each.found.intervals[place]]
            )
            none = [each for each in goes if each.truth[place] == 0]
            nothing = sum(not each.found.shown[place] for each in none)
            shares = (f"{held / len(costs):.3f}", f"{nothing / len(none):.3f}" if none else "")
            table.writerow((name, len(costs), shares[0], len(none), shares[1]))
        held = [
            float(np.mean((low <= each.truth) & (each.truth <= high), where=each.truth > 0))
            for each in goes
            for low, high in [each.found.intervals.T]
        ]
        true = [not (each.found.shown & (each.truth == 0)).any() for each in goes]
        shares = f"{np.mean(held):.3f}", f"{np.mean(true):.3f}"
        table.writerow(("all", len(goes), shares[0], len(goes), shares[1]))


if __name__ == "__main__":
    main()
