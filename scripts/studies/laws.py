"""Simulate the coverage of a profile's intervals on synthetic devices with known costs.

    PYTHONPATH=. python scripts/studies/laws.py OUT.csv [--devices 1000] [--first 0]
    PYTHONPATH=. python scripts/studies/laws.py OUT.csv --misfit
    PYTHONPATH=. python scripts/studies/laws.py OUT.csv --residuals PROFILE.json...

The time of a draw on a device is the sum of costs times the exact counters of the design, or with
--misfit for three quarters of the devices the maximum of stages; about half of the terms cost
nothing. The clock has a resolution of 0.1 ms, samples have noise, each drawing is slightly faster
or slower in each process, and the speed of the machine drifts. Rounds are those of
`harness.measuring.timing`; `harness.profile` fits the law.

With --misfit, draws deviate from the law as much as those of the published profiles, with the same
share of variance between groups (`MISFIT`, `SHARED`), and without noise, which is ten times
smaller. With --residuals, devices have the costs and residuals of a profile; the residuals of each
group are multiplied by a random sign.

Writes for each form of law a row for each term: the number of devices on which the term has a cost,
the share of these whose interval covers the cost, the number of devices without it, and the share
of these without a false significant cost. The last row is for all terms: the share of costs
covered, and the shares of devices without any false cost, with the true form, and with a form of
too many stages. With --residuals, writes a row for each profile: the root mean square residual, the
share of variance between groups, and the same four shares.
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
from harness.profile.cost_terms import TERMS, count_draw, make_design_rows
from harness.profile.placing import Draw
from harness.profile.profile import select_draws_to_fit
from harness.rasterisers.base import Sample

STEP_S = 1e-4
SAMPLE_NOISE, PLACEMENT_NOISE, DRIFT = 0.01, 0.03, 0.1
"""Standard deviations of a sample and of a drawing's position in memory, and the amplitude of the
drift in speed; all relative."""

MAX_TERM_S = 1e-3
"""Max cost of a term in the draw with the largest counter."""

COST_PROBABILITY = 0.5
"""Probability that a term has a cost; the draw itself and triangles always have one."""

TEST = TimerTest("wall", 0.02, None, STEP_S, "synthetic")


MISFIT, MISFIT_OF_STAGES, SHARED = (0.08, 0.28), (0.10, 0.15), (0.13, 0.56)
"""Ranges over the published profiles of the root mean square residual, of sums and of maxima of
stages, and of the share of variance between groups; --residuals writes them."""

MAX_IMBALANCE = 2.0
"""Upper bound of the ratio of the median times of two stages over the design."""


class FittedDevice(NamedTuple):
    """The true costs of a device in seconds, its form of law, and the law fitted to its times."""

    truth: NDArray[np.float64]
    form: str
    fitted: law.Law


@dataclass
class Clock:
    """The clock of a synthetic machine, whose speed drifts by up to `DRIFT`."""

    seconds: float = 0.0
    logs: list[float] = field(default_factory=list)

    def __call__(self) -> float:
        """Return the seconds since the start."""
        return self.seconds

    def spend(self, seconds: float) -> float:
        """Advance by a batch of `seconds` at mean speed; return the time by a coarse timer."""
        slower = DRIFT * np.sin(self.seconds / 7.0)
        self.logs.append(slower)
        before = np.floor(self.seconds / STEP_S)
        self.seconds += seconds * float(np.exp(slower))
        return float((np.floor(self.seconds / STEP_S) - before) * STEP_S)


class Drawing:
    """A draw of `seconds` at a random position in memory."""

    def __init__(self, seconds: float, clock: Clock, random: np.random.Generator) -> None:
        self.seconds = seconds * float(np.exp(PLACEMENT_NOISE * random.standard_normal()))
        self.clock = clock
        self.random = random

    def sample(self, repeats: int) -> Sample:
        """Draw `repeats` times."""
        noise = float(np.exp(SAMPLE_NOISE * self.random.standard_normal()))
        return Sample(wall=self.clock.spend(self.seconds * repeats * noise))


class Design(NamedTuple):
    """The draws that laws are fitted to: counters in rows of `TERMS`, and groups."""

    rows: NDArray[np.float64]
    groups: list[str]


def make_design(seed: int = 0) -> Design:
    """Return the design without the draws that fill pixels twice."""
    draws = [draw for draw in design.make_draws(seed) if draw.kind != "twice"]
    return Design(
        make_design_rows([count_draw(draw) for draw in draws]), [draw.group for draw in draws]
    )


def fit_device(layout: Design, seed: int, budget_s: float = 0.3) -> FittedDevice:
    """Make a device, time the design on it and fit a law."""
    random = np.random.default_rng(seed)
    truth = make_costs(layout, random)
    clock = Clock()
    names = [str(number) for number in range(len(layout.rows))]
    seconds: Mapping[str, float] = {
        EMPTY: float(truth[0]),
        measured.CONTROL: float(layout.rows[len(names) // 2] @ truth),
        **dict(zip(names, (layout.rows @ truth).tolist(), strict=True)),
    }

    def prepare(order: Sequence[str]) -> dict[str, Drawing]:
        return {name: Drawing(seconds[name], clock, random) for name in order}

    timing = measured.make_profile_timing(budget_s, 0)
    processes = []
    speeds: list[float] = []
    for number in range(timing.processes):
        drawings = prepare(list(seconds))
        process = time_together(drawings, timing, TEST, seed=seed + number, clock=clock)
        processes.append(process)
        speeds += clock.logs[-len(seconds) * sum(process[EMPTY].epochs) :]
    times = {name: Times.concatenate([process[name] for process in processes]) for name in seconds}
    profile_times = measured.normalise_times(times, names)
    fitted = law.fit_law(layout.rows, profile_times.epochs, layout.groups)
    # The fitted costs refer to the mean speed of the machine in the rounds.
    return FittedDevice(truth * float(np.exp(np.mean(speeds))), "sum", fitted)


def fit_misfitting_device(layout: Design, seed: int) -> FittedDevice:
    """Make a device that deviates from a law of some form, and fit a law to the exact times."""
    random = np.random.default_rng(seed)
    form = list(law.FORMS)[seed % len(law.FORMS)]
    truth = make_stage_costs(layout, form, random)
    labels = np.unique(layout.groups, return_inverse=True)[1]
    misfit = random.uniform(*(MISFIT if form == "sum" else MISFIT_OF_STAGES))
    shared = random.uniform(*SHARED)
    common = np.sqrt(shared) * random.standard_normal(labels.max() + 1)[labels]
    errors = misfit * (common + np.sqrt(1.0 - shared) * random.standard_normal(len(labels)))
    times = law.predict_times(layout.rows, truth, form) * np.maximum(1.0 + errors, 0.2)
    return FittedDevice(truth, form, law.fit_law(layout.rows, times[None], layout.groups))


class Residuals(NamedTuple):
    """The form and costs of a profile, (t,), and the relative residuals of its draws, (k,)."""

    layout: Design
    form: str
    costs: NDArray[np.float64]
    errors: NDArray[np.float64]


def recreate_draws(profile: dict[str, Any]) -> tuple[list[Draw], list[dict[str, Any]]]:
    """Return the draws of a profile, made again, and the seconds stored in the profile."""
    step = profile["device"]["details"].get("step") or 1
    draws = [design.snap_draw(draw, step) for draw in design.make_draws(profile["seed"])]
    stored_draws = {(row["kind"], row["name"]): row for row in profile["times"]}
    draws = [draw for draw in draws if (draw.kind, draw.name) in stored_draws]
    return draws, [stored_draws[draw.kind, draw.name] for draw in draws]


def compute_residuals(profile: dict[str, Any]) -> Residuals:
    """Fit a law to the draws of a profile again and return the residuals."""
    draws, stored_draws = recreate_draws(profile)
    indices, _ = select_draws_to_fit(draws)
    retained = [draws[index] for index in indices]
    layout = Design(
        make_design_rows([count_draw(draw) for draw in retained]), [draw.group for draw in retained]
    )
    times = np.array([np.log(stored_draws[index]["epochs"]).mean() for index in indices])
    fitted = law.fit_law(layout.rows, np.exp(times)[None], layout.groups)
    predicted = law.predict_times(layout.rows, fitted.costs, fitted.form)
    return Residuals(layout, fitted.form, fitted.costs, np.exp(times) / predicted - 1.0)


def fit_turned_device(residuals: Residuals, seed: int) -> FittedDevice:
    """Multiply the residuals of each group by a random sign, and fit a law to these times."""
    layout, form, costs, errors = residuals
    labels = np.unique(layout.groups, return_inverse=True)[1]
    signs = np.random.default_rng(seed).choice((-1.0, 1.0), labels.max() + 1)[labels]
    times = law.predict_times(layout.rows, costs, form) * np.maximum(1.0 + signs * errors, 0.2)
    return FittedDevice(costs, form, law.fit_law(layout.rows, times[None], layout.groups))


def compute_group_variance_share(residuals: Residuals) -> float:
    """Return the share of the residuals' variance between groups (one-way analysis of variance).

    S. Searle, G. Casella and C. McCulloch, "Variance Components", 1992, section 3.6.
    """
    labels = np.unique(residuals.layout.groups, return_inverse=True)[1]
    sizes = np.bincount(labels)
    means = np.bincount(labels, residuals.errors) / sizes
    count, groups = len(labels), len(sizes)
    within = float(((residuals.errors - means[labels]) ** 2).sum()) / (count - groups)
    between = float((sizes * (means - residuals.errors.mean()) ** 2).sum()) / (groups - 1)
    alike = (count - float((sizes**2).sum()) / count) / (groups - 1)
    common = max(0.0, (between - within) / alike)
    return common / (common + within)


def make_costs(layout: Design, random: np.random.Generator) -> NDArray[np.float64]:
    """Return random costs of the terms in seconds, (t,)."""
    has_cost = random.random(len(TERMS)) < COST_PROBABILITY
    has_cost[:2] = True
    truth = has_cost * random.uniform(0.1, 1.0, len(TERMS)) * MAX_TERM_S / layout.rows.max(axis=0)
    truth[0] /= 10.0
    return np.asarray(truth)


def make_stage_costs(layout: Design, form: str, random: np.random.Generator) -> NDArray[np.float64]:
    """Return random costs of the terms of a form, (t,); its stages take similar times.

    Each stage has at least one cost.
    """
    costs = make_costs(layout, random)
    for members in law.make_stage_masks(form)[:, 1:] if form != "sum" else ():
        stage = np.flatnonzero(members) + 1
        if not costs[stage].any():
            costs[stage[0]] = 1.0 / layout.rows[:, stage[0]].max()
        times = layout.rows[:, stage] @ costs[stage]
        costs[stage] *= MAX_TERM_S / np.median(times[times > 0]) * MAX_IMBALANCE ** -random.random()
    return np.asarray(costs * law.make_stage_masks(form).any(axis=0))


def main() -> None:
    """Simulate devices and write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--devices", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--misfit", action="store_true")
    parser.add_argument("--residuals", type=Path, nargs="+")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.devices)
    with options.out.open("w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        shares = ("covered", "no_false_cost", "true_form", "too_many_stages")
        if options.residuals:
            table.writerow(("profile", "misfit", "shared", "devices", *shares))
        else:
            header = ("form", "term", "devices", "covered", "devices_without_cost")
            table.writerow((*header, *shares[1:]))
        for profile in sorted(options.residuals or ()):
            residuals = compute_residuals(json.loads(profile.read_text()))
            misfit, shared = (
                np.sqrt(np.mean(residuals.errors**2)),
                compute_group_variance_share(residuals),
            )
            devices = [fit_turned_device(residuals, number) for number in seeds]
            spread = f"{misfit:.3f}", f"{shared:.3f}"
            table.writerow((profile.stem, *spread, len(devices), *summarise_devices(devices)))
            file.flush()
        if not options.residuals:
            layout = make_design()
            fit = fit_misfitting_device if options.misfit else fit_device
            devices = [fit(layout, number) for number in seeds]
            for form in law.FORMS:
                same_form = [device for device in devices if device.form == form]
                if same_form:
                    table.writerows((form, *row) for row in make_term_rows(same_form))


def make_term_rows(devices: Sequence[FittedDevice]) -> Iterator[tuple[object, ...]]:
    """Yield a row for each term that has a cost on some device, and one for all terms."""
    for index, name in enumerate(TERMS):
        with_cost = [device for device in devices if device.truth[index] > 0]
        if not with_cost:
            continue
        covered = sum(
            bool(low <= device.truth[index] <= high)
            for device in with_cost
            for low, high in [device.fitted.intervals[index]]
        )
        without_cost = [device for device in devices if device.truth[index] == 0]
        not_significant = sum(not device.fitted.significant[index] for device in without_cost)
        shares = (
            f"{covered / len(with_cost):.3f}",
            f"{not_significant / len(without_cost):.3f}" if without_cost else "",
        )
        yield name, len(with_cost), shares[0], len(without_cost), shares[1], "", ""
    covered_share, *shares_of_devices = summarise_devices(devices)
    yield "all", len(devices), covered_share, len(devices), *shares_of_devices


def summarise_devices(devices: Sequence[FittedDevice]) -> list[str]:
    """Return shares: of costs covered by intervals, then of devices.

    These are the devices without a false cost, with the true form, and with too many stages.
    """
    covered = [
        float(np.mean((low <= device.truth) & (device.truth <= high), where=device.truth > 0))
        for device in devices
        for low, high in [device.fitted.intervals.T]
    ]
    no_false_cost = [
        not (device.fitted.significant & (device.truth == 0)).any() for device in devices
    ]
    forms = list(law.FORMS)
    more_stages = np.array([forms.index(d.fitted.form) - forms.index(d.form) for d in devices])
    values = (covered, no_false_cost, more_stages == 0, more_stages > 0)
    return [f"{np.mean(value):.3f}" for value in values]


if __name__ == "__main__":
    main()
