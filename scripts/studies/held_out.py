"""Draws of polygons that no law was fitted to, timed so that triangulations can be compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from harness.errors import NothingMeasured
from harness.figures.intervals import paired_ratio
from harness.frame import Frame, View, make_frame
from harness.measuring.processes import Backend, Bench
from harness.measuring.timing import EMPTY, REFERENCE, TimingSettings
from harness.progress import Reporter
from harness.rasterisers.base import Options
from harness.settings import StudySize
from harness.study.subjects import choose_polygons
from harness.triangulating.recipes import parse
from scenes import Scene

Draw = tuple[Frame, NDArray[np.int32]]

GROUP = 24
"""Draws timed together: enough to interleave, few enough for many rounds."""


@dataclass(frozen=True)
class HeldOut:
    """Draws of polygons that a profile is judged on.

    seconds : (k,); halves : (k, 2) seconds by either half of the rounds; polygons : (k,) the
    polygon of each draw
    """

    seconds: NDArray[np.float64]
    halves: NDArray[np.float64]
    polygons: Sequence[str]

    @cached_property
    def rows(self) -> list[NDArray[np.intp]]:
        """The draws of each polygon."""
        labels = np.unique(np.asarray(self.polygons, dtype=str), return_inverse=True)[1]
        return [np.flatnonzero(labels == label) for label in range(labels.max() + 1)]


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


def held_out_draws(
    bench: Bench,
    scenes: Sequence[Scene],
    resolution: int,
    seed: int,
    names: Sequence[str],
    calibration: Mapping[str, float],
) -> tuple[list[Draw], list[str], list[str]]:
    """Return draws of polygons by several triangulators, and each draw's polygon and triangulator.

    names : triangulators; calibration : the costs that optimal:calibrated minimises
    """
    draws: list[Draw] = []
    polygons: list[str] = []
    ways: list[str] = []
    for place, scene in enumerate(scenes):
        for number, alone in choose_polygons(scene, StudySize(polygons=24)):
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
    compared: Sequence[str],
) -> Timed:
    """Time draws in groups, each together with the reference draw.

    The ratio to it removes the machine's speed, which may change from minute to minute, but not
    what a machine's state does to one drawing more than to another. So those that will be compared
    are drawn in the same rounds.

    compared : (k,) draws of one name will be compared with each other

    Raises
    ------
    NothingMeasured
        if the device fails under one of them
    """
    ratios = np.full(len(draws), np.nan)
    halves = np.full((len(draws), 2), np.nan)
    seconds: list[float] = []
    empty: list[float] = []
    done = 0
    with reporter.stage(f"timing {title}: {backend.label}", len(draws)) as stage:
        for seed, members in enumerate(_groups(compared)):
            candidates = {str(member): (*draws[member], options) for member in members}
            groups, failures = bench.time(backend, candidates, settings, seed)
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
