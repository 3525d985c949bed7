"""Measures designed draws and held-out polygons, and fits a device's cost model to the first."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import NothingMeasured, UsageError
from harness.figures.ratios import paired_ratio
from harness.frame import SUBPIXEL, Frame, View, frame_as_it_is, make_frame, on_grid
from harness.measuring.processes import Backend, Bench
from harness.measuring.timing import EMPTY, REFERENCE, TimingSettings
from harness.progress import Reporter
from harness.rasterisers.base import Options
from harness.stored import atomic
from harness.study import cost_model, model_terms
from harness.study.design import STEERED, Design
from harness.study.subjects import choose_polygons
from harness.triangulating.recipes import parse
from scenes import Scene
from triangulators.criteria import predict

Draw = tuple[Frame, NDArray[np.int32]]

GROUP = 24
"""Draws timed together: enough to interleave, few enough for many rounds."""

HELD_OUT = (
    *("ear-clipping", "delaunay", "sweep", "greedy", "worst:half-perimeter"),
    *(f"optimal:{name}" for name in STEERED),
)
"""Triangulators of the held-out polygons: good ones in many ways, for a model must choose among
them, and the worst."""
RANDOM = tuple(f"random#{number}" for number in range(12))

LEAST_R2 = 0.8
"""A fit that explains less than this share of the held-out draws' variance, over polygons or within
them, is refused: its optimum would follow the noise. Quiet machines reach 0.98 both ways."""


@dataclass(frozen=True)
class Validation:
    """How the fitted model predicts polygons it was not fitted on.

    r2_over : of log time over all draws; r2_within : within polygons, their means taken out
    """

    r2_over: float
    r2_within: float
    polygons: int
    draws: int

    def __str__(self) -> str:
        """How well the held-out draws are predicted."""
        return (
            f"R2 on {self.draws} draws of {self.polygons} held-out polygons: "
            f"{self.r2_over:.4f} over polygons, {self.r2_within:.4f} within"
        )

    @property
    def good(self) -> bool:
        """Whether `LEAST_R2` is reached both ways; never where a figure is not a number."""
        return self.r2_over >= LEAST_R2 and self.r2_within >= LEAST_R2


@dataclass(frozen=True)
class Timed:
    """Draws timed in ratio to the reference draw of the same rounds.

    ratios : (k,) medians; halves : (k, 2) medians of either half of the rounds; reference_s : the
    reference's median seconds in each group; empty_s : those of a draw of nothing
    """

    ratios: NDArray[np.float64]
    halves: NDArray[np.float64]
    reference_s: list[float]
    empty_s: list[float]


def calibrate(
    backend: Backend,
    bench: Bench,
    scenes: Sequence[Scene],
    settings: TimingSettings,
    options: Options,
    resolution: int,
    reporter: Reporter,
    seed: int = 0,
    terms: Sequence[str] = cost_model.TERMS[1:],
) -> tuple[cost_model.Fit, Validation, list[model_terms.Model]]:
    """Fit the model on designed draws of `backend` and test it on polygons of the scenes.

    terms : those that the model may have. Returns the fit with all of them, how it does on held-out
    polygons, and the best models with fewer terms. Every other held-out polygon chooses the models
    with fewer terms; the figures of all are of the rest, which nothing was chosen by
    """
    designed, sets = designed_draws(bench, resolution, seed)
    draws, polygons, _ = held_out_draws(bench, scenes, resolution, seed)
    time_all = partial(time_draws, backend, bench, settings, options, reporter)
    fitted_on = time_all(designed, "designed draws")
    tested_on = time_all(draws, "polygons", polygons)
    second = float(np.median([*fitted_on.reference_s, *tested_on.reference_s]))
    design, seconds = design_of(designed), fitted_on.ratios * second
    fit = cost_model.fit(design, seconds, sets, seed, terms=terms)
    choosing, telling = model_terms.HeldOut(
        design_of(draws), tested_on.ratios * second, tested_on.halves * second, polygons
    ).split()
    with reporter.stage("models with fewer terms", model_terms.number_of_sets(terms)) as stage:
        fewer = model_terms.alternatives(
            design, seconds, sets, choosing, telling, terms, stage.advance
        )
    every = fewer[-1]  # the model with all terms, which is the fit
    told = len(set(telling.polygons)), len(telling.polygons)
    validation = Validation(every.r2_over, every.r2_within, *told)
    return fit, validation, fewer


def designed_draws(bench: Bench, resolution: int, seed: int) -> tuple[list[Draw], list[int]]:
    """Return draws of the designed polygons by several triangulators, and each draw's set."""
    draws: list[Draw] = []
    sets: list[int] = []
    for number, polygons in enumerate(cost_model.designed_polygons(resolution, seed)):
        frame = frame_as_it_is(resolution, *on_grid(polygons))
        for name in cost_model.CUTS:
            triangles = frame.join(bench.triangulate(parse(name, seed=seed), polygons).parts)
            if len(triangles) > 0:
                draws.append((frame, triangles))
                sets.append(number)
    return draws, sets


def design_of(draws: Sequence[Draw]) -> NDArray[np.float64]:
    """Return (k, 9) rows of `cost_model.TERMS`, from coordinates alone."""
    predicted = (predict(frame.points / SUBPIXEL, triangles) for frame, triangles in draws)
    return np.array([cost_model.terms(figures) for figures in predicted])


def held_out_draws(
    bench: Bench,
    scenes: Sequence[Scene],
    resolution: int,
    seed: int,
    names: Sequence[str] = (*HELD_OUT, *RANDOM),
    calibration: Mapping[str, float] | None = None,
) -> tuple[list[Draw], list[str], list[str]]:
    """Return draws of polygons by several triangulators, and each draw's polygon and triangulator.

    names : triangulators; calibration : coefficients that optimal:calibrated minimises
    """
    draws: list[Draw] = []
    polygons: list[str] = []
    ways: list[str] = []
    for place, scene in enumerate(scenes):
        for number, alone in choose_polygons(scene, Design(polygons=24)):
            frame = make_frame(alone.polygons, View(resolution))
            for name in names:
                recipe = parse(name, seed=seed, calibration=calibration)
                parts = bench.triangulate(recipe, frame.polygons).parts
                if all(part is not None for part in parts):
                    draws.append((frame, frame.join(parts)))
                    polygons.append(f"{place} {scene.name} {number}")
                    ways.append(name)
    return draws, polygons, ways


def time_draws(
    backend: Backend,
    bench: Bench,
    settings: TimingSettings,
    options: Options,
    reporter: Reporter,
    draws: Sequence[Draw],
    title: str,
    compared: Sequence[str] | None = None,
) -> Timed:
    """Time draws in groups, each together with the reference draw.

    The ratio to it removes the machine's speed, which may change from minute to minute, but not
    what a machine's state does to one drawing more than to another. So those that will be compared
    are drawn in the same rounds.

    compared : (k,) draws of one name will be compared with each other; none by default

    Raises
    ------
    NothingMeasured
        if the device fails under one of them
    """
    ratios = np.full(len(draws), np.nan)
    halves = np.full((len(draws), 2), np.nan)
    seconds: list[float] = []
    empty: list[float] = []
    names = [str(number) for number in range(len(draws))] if compared is None else compared
    done = 0
    with reporter.stage(f"timing {title}: {backend.label}", len(draws)) as stage:
        for seed, members in enumerate(_groups(names)):
            candidates = {str(member): draws[member] for member in members}
            groups, failures = bench.time(backend, candidates, options, settings, seed)
            if failures:
                raise NothingMeasured(f"{backend.label}: {next(iter(failures.values()))}")
            group = next(iter(groups.values()))
            reference = group[REFERENCE]
            seconds.append(reference.median_s)
            empty.append(group[EMPTY].median_s)
            for member in members:
                samples = group[str(member)].samples_s
                ratios[member] = paired_ratio(samples, reference.samples_s).value
                halves[member] = _halves(np.divide(samples, reference.samples_s), reference.epochs)
            done += len(members)
            stage.complete(done)
    return Timed(ratios, halves, seconds, empty)


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


def write(
    fit: cost_model.Fit,
    validation: Validation,
    device: dict[str, Any],
    file: Path,
    fewer: Sequence[model_terms.Model] = (),
) -> Path:
    """Write a calibration file: the fit, how it did on held-out polygons, and of what device.

    fewer : models with fewer terms, kept beside it

    A fit that is not good goes to `<name>.refused.json` beside it, so that it can be looked at and
    an older, good calibration stays. Returns the file.
    """
    content = {
        "schema_version": 1,
        "device": device,
        **fit.to_json(),
        "refused": not validation.good,
        "models": [model.to_json() for model in fewer],
        "held_out": {
            "r2_over_polygons": validation.r2_over,
            "r2_within_polygons": validation.r2_within,
            "polygons": validation.polygons,
            "draws": validation.draws,
        },
    }
    return keep(content, file)


def keep(content: Mapping[str, Any], file: Path) -> Path:
    """Write a calibration's content to `file`, or beside it where it is `refused`.

    Returns the file that was written.
    """
    if content["refused"]:
        file = file.with_name(f"{file.stem}.refused.json")
    file.parent.mkdir(parents=True, exist_ok=True)
    atomic.write(file, (json.dumps(content, indent=2) + "\n").encode())
    return file


def read_coefficients(file: Path) -> dict[str, float]:
    """Return the coefficients of a calibration file, by `cost_model.TERMS`.

    Raises
    ------
    UsageError
        if it is missing, no calibration, or was refused when it was made
    """
    try:
        content = json.loads(atomic.read(file))
        if content.get("refused"):
            raise UsageError(
                f"{file} was refused: it fits too badly; repeat raster-harness calibrate"
            )
        stored = content["coefficients"]
        # A file that is older than D, Q, P and R gives them no weight.
        since = dict.fromkeys(cost_model.TERMS[5:], 0.0)
        return {name: float((since | stored)[name]) for name in cost_model.TERMS}
    except FileNotFoundError:
        raise UsageError(f"no calibration {file}; make it: raster-harness calibrate") from None
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UsageError(f"{file} is not a calibration: {error!r}") from error
