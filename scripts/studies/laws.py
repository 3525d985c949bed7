"""How often a profile's intervals hold what a device charges: synthetic devices with known costs.

    PYTHONPATH=. python scripts/studies/laws.py OUT.csv [--goes 1000] [--first 0]
    PYTHONPATH=. python scripts/studies/laws.py OUT.csv --misfit
    PYTHONPATH=. python scripts/studies/laws.py OUT.csv --residuals PROFILE.json...

Each device charges its own costs for the design's exact counters; about half of the terms cost it
nothing. Its clock is told in steps of 0.1 ms. Every sample is a little noisy, every drawing is a
little faster or slower in each process, and the machine slows down and recovers meanwhile. The
rounds are those of `harness.measuring.timing`, the rest is `harness.profile`.

With --misfit, devices do not keep the law: each draw misses it by so much, and so much of the
variance is common to its group, as the published profiles miss theirs (`MISFIT`, `SHARED`); noise,
which is ten times smaller, is left out. With --residuals, devices charge what a profile says, and
miss it by what the profile's own draws do, turned around or not for each group as a whole.

Writes a row for each term: in how many goes it cost something, in what share of them its interval
holds that, and in what share of those in which it cost nothing nothing was shown. The last row is
of all terms: of a device, whether any cost is shown that it does not have. With --residuals a row
for each profile: by how much draws miss it, what share groups have, and the same shares.
"""

import argparse
import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.measuring.timing import EMPTY, TimerTest, Times, time_together
from harness.profile import design, law, measured
from harness.profile.counted import TERMS, counters, design_of
from harness.profile.profile import fitted_of
from harness.rasterisers.base import Sample

STEP_S = 1e-4
NOISE, PLACE, DRIFT = 0.01, 0.03, 0.1
"""Standard deviations of a sample and of a drawing's place, and how far the speed strays."""

WHOLE_S = 1e-3
"""What a term may cost at most in the draw that has most of it."""

LIKELY = 0.5
"""How likely a term costs something; the draw itself and a triangle always do."""

TEST = TimerTest("wall", 0.02, None, STEP_S, "synthetic")


MISFIT, SHARED = (0.08, 0.28), (0.13, 0.56)
"""Of the published profiles: by how much draws miss the law (root mean square), and the share of
the variance that is common to a group's; --residuals writes both."""


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

    timing = measured.settings(budget_s, 0)
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


class Residuals(NamedTuple):
    """What a profile charges, (t,), and by what share its draws miss that, (k,)."""

    of: Design
    costs: NDArray[np.float64]
    errors: NDArray[np.float64]


def drawn(profile: dict[str, Any]) -> tuple[list[design.Draw], list[dict[str, Any]]]:
    """Return the draws that a profile has times of, made again, and what it holds of each."""
    step = profile["device"]["details"].get("step") or 1
    made = [design.snapped(draw, step) for draw in design.draws(profile["seed"])]
    timed = {(each["kind"], each["name"]): each for each in profile["times"]}
    draws = [draw for draw in made if (draw.kind, draw.name) in timed]
    return draws, [timed[draw.kind, draw.name] for draw in draws]


def residuals_of(profile: dict[str, Any]) -> Residuals:
    """Fit a law to a profile's draws once more, and say by how much each misses it."""
    draws, told = drawn(profile)
    fitted, _ = fitted_of(draws)
    kept = [draws[number] for number in fitted]
    of = Design(design_of([counters(draw) for draw in kept]), [draw.group for draw in kept])
    times = np.array([np.log(told[number]["epochs"]).mean() for number in fitted])
    found = law.fit(of.rows, np.exp(times)[None], of.groups)
    return Residuals(of, found.costs, np.exp(times) / (of.rows @ found.costs) - 1.0)


def turned(like: Residuals, seed: int) -> Go:
    """Turn the residuals of each group around or not, and fit a law to what comes of it."""
    labels = np.unique(like.of.groups, return_inverse=True)[1]
    signs = np.random.default_rng(seed).choice((-1.0, 1.0), labels.max() + 1)[labels]
    times = like.of.rows @ like.costs * np.maximum(1.0 + signs * like.errors, 0.2)
    return Go(like.costs, law.fit(like.of.rows, times[None], like.of.groups, seed))


def shared_by_groups(like: Residuals) -> float:
    """Return the share of the residuals' variance that groups have (one-way analysis of variance).

    S. Searle, G. Casella and C. McCulloch, "Variance Components", 1992, section 3.6.
    """
    labels = np.unique(like.of.groups, return_inverse=True)[1]
    sizes = np.bincount(labels)
    means = np.bincount(labels, like.errors) / sizes
    count, groups = len(labels), len(sizes)
    within = float(((like.errors - means[labels]) ** 2).sum()) / (count - groups)
    between = float((sizes * (means - like.errors.mean()) ** 2).sum()) / (groups - 1)
    alike = (count - float((sizes**2).sum()) / count) / (groups - 1)
    common = max(0.0, (between - within) / alike)
    return common / (common + within)


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
    parser.add_argument("--residuals", type=Path, nargs="+")
    given = parser.parse_args()
    numbers = range(given.first, given.first + given.goes)
    with given.out.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        if given.residuals:
            table.writerow(("profile", "missed", "shared", "goes", "within", "nothing_shown"))
        else:
            table.writerow(("term", "goes", "within", "goes_without_cost", "nothing_shown"))
        for profile in sorted(given.residuals or ()):
            like = residuals_of(json.loads(profile.read_text()))
            missed, shared = np.sqrt(np.mean(like.errors**2)), shared_by_groups(like)
            held, nothing = whole([turned(like, number) for number in numbers])
            figures = (f"{missed:.3f}", f"{shared:.3f}", given.goes, held, nothing)
            table.writerow((profile.stem, *figures))
            file.flush()
        if not given.residuals:
            of = designed()
            make = misfitting if given.misfit else go
            goes = [make(of, number) for number in numbers]
            table.writerows(by_term(goes))
            held, nothing = whole(goes)
            table.writerow(("all", len(goes), held, len(goes), nothing))


def by_term(goes: Sequence[Go]) -> Iterator[tuple[object, ...]]:
    """Yield the row of each term."""
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
        yield name, len(costs), shares[0], len(none), shares[1]


def whole(goes: Sequence[Go]) -> tuple[str, str]:
    """Return the share of all costs that their intervals hold, and of devices with no false one."""
    held = [
        float(np.mean((low <= each.truth) & (each.truth <= high), where=each.truth > 0))
        for each in goes
        for low, high in [each.found.intervals.T]
    ]
    true = [not (each.found.shown & (each.truth == 0)).any() for each in goes]
    return f"{np.mean(held):.3f}", f"{np.mean(true):.3f}"


if __name__ == "__main__":
    main()
