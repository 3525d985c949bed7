"""The worker processes of a run, which compile, triangulate, count and time."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from harness.frame import Frame
from harness.measuring import tasks
from harness.measuring.other_version import OtherVersion, triangulate_with_other_version
from harness.measuring.timing import Times
from harness.metrics.registry import MIN_QUADS, OUTLINE
from harness.rasterisers import BUILT_IN
from harness.rasterisers.base import Counters, Device, Options, Triangles
from harness.settings import TimingSettings
from harness.triangulating.recipes import Recipe
from harness.triangulating.triangulate import (
    FrameTriangulation,
    time_in_rounds,
    triangulate_polygons,
    warm_up,
)
from harness.worker import (
    Limits,
    OpenWorker,
    TaskError,
    TaskTimeoutError,
    WorkerPool,
    WorkerSpec,
    get_third_party_limits,
    wait_for_result,
)
from triangulators.compute.compiled_files import is_cached
from triangulators.compute.kernels import count_usable_cores

T = TypeVar("T")

_LOG = logging.getLogger(__name__)

MIN_IMPORT_TIMEOUT_S = 60.0  # minimum time limit of imports of third-party code

MIN_ROUNDS, MAX_ROUNDS = 5, 12  # rounds that time triangulation; above 12, intervals narrow little

TRIANGULATING_SHARE = 1 / 3  # budget for timing triangulation, relative to that for timing draws

COMPILE_TIMEOUT_S = 900.0  # time limit of compiling, which does not count as triangulating

COMPILED_LATE = "triangulators.geometry.order"  # compiled after the optimum's kernels

TRIANGULATORS = WorkerSpec("triangulators")

SECOND_PROCESS = WorkerSpec("second process")  # it compiles, and computes lower bounds


def get_rasteriser_worker(name: str) -> WorkerSpec:
    """Return the worker that lists a rasteriser's devices and options."""
    return WorkerSpec(f"rasteriser {name}", limits=None if name in BUILT_IN else Limits())


def get_triangulator_worker(recipe: Recipe) -> WorkerSpec:
    """Return the worker in which the triangulator of `recipe` runs."""
    if recipe.builtin:
        return TRIANGULATORS
    return WorkerSpec(f"triangulator {recipe}", limits=get_third_party_limits())


def collect_bounds(
    pending: Mapping[str, Future[NDArray[np.int64]]],
) -> dict[str, NDArray[np.int64]]:
    """Wait for lower bounds, (p,) by name, -1 if unknown; omit a bound that fails to compute."""
    bounds = {}
    for name, future in pending.items():
        with suppress(TaskError):  # measurements do not depend on the bounds
            bounds[name] = wait_for_result(future)
    return bounds


@dataclass(frozen=True)
class Backend:
    """A rasteriser on a device."""

    rasteriser: str
    device: Device

    @property
    def label(self) -> str:
        """Name of the backend in messages and `run.json`."""
        return f"{self.rasteriser} on {self.device.name}"

    @property
    def worker(self) -> WorkerSpec:
        """Worker in which the device draws."""
        limits = get_rasteriser_worker(self.rasteriser).limits
        return WorkerSpec(self.label, self.device.environment, limits)


class MeasuringPool(WorkerPool):
    """Workers: one per device, one for built-in triangulators, one per third-party triangulator.

    timeout_s : time limit of a task, in addition to the requested drawing time
    other : the interleaved baseline, which runs the recipes with `Recipe.other`, or None
    """

    abandoned = (SECOND_PROCESS.name,)

    def __init__(
        self,
        open_worker: OpenWorker,
        timeout_s: float,
        database: Path | None = None,
        other: OtherVersion | None = None,
    ) -> None:
        super().__init__(open_worker, timeout_s)
        self.database = database
        self.other = other
        self.stopping = self.is_timing = False
        self._opened: dict[str, tasks.OpenedDevice] = {}
        self._compiled: set[str] = set()

    def compile_kernels(self, recipe: Recipe, tick: Callable[[float], None] | None = None) -> None:
        """Compile or load a triangulator's kernels, once; do nothing for the baseline's."""
        if not recipe.other and recipe.base not in self._compiled:
            timeout_s = max(COMPILE_TIMEOUT_S, self.timeout_s) if recipe.builtin else self.timeout_s
            message = f"compilation exceeded {timeout_s:g} s; close other programs, then --resume"
            self._run_recipe("compile", message, warm_up, recipe, timeout_s=timeout_s, tick=tick)
            self._compiled.add(recipe.base)

    def compile_ahead(self, recipes: Sequence[Recipe]) -> None:
        """Start compiling uncached triangulators in the second process, the last one first."""
        builtin = [recipe for recipe in reversed(recipes) if recipe.builtin]
        if (
            self.is_used(SECOND_PROCESS)
            or len(builtin) < 2
            or count_usable_cores() < 2
            or is_cached(COMPILED_LATE)
        ):
            return
        self.compute_in_second_process(warm_up, *builtin)

    def triangulate(
        self,
        recipe: Recipe,
        polygons: Sequence[Polygon],
        tick: Callable[[float], None] | None = None,
    ) -> FrameTriangulation:
        """Run a triangulator over polygons in px; compile first if necessary."""
        self.compile_kernels(recipe)
        message = (
            f"triangulation exceeded {self.timeout_s:g} s; increase --timeout, or give a smaller "
            "scene (limit=)"
        )
        if recipe.other:
            task = (triangulate_with_other_version, recipe, polygons, self.other)
            return self._run_recipe("triangulate", message, *task, tick=tick)
        arguments = (triangulate_polygons, recipe, polygons, self.database)
        result = self._run_recipe("triangulate", message, *arguments, tick=tick)
        _LOG.info("%s: %d of %d polygons from the cache", recipe, result.cached, len(polygons))
        return result

    def _run_recipe(
        self,
        stage: str,
        message: str,
        function: Callable[..., T],
        recipe: Recipe,
        *arguments: Any,
        **options: Any,
    ) -> T:
        """Run `function(recipe, *arguments)` in the worker of the recipe's triangulator.

        message : text of the error if a built-in triangulator exceeds the time limit
        """
        try:
            with self.time_stage(stage):
                return self.run(
                    get_triangulator_worker(recipe), function, recipe, *arguments, **options
                )
        except TaskTimeoutError as error:
            if recipe.builtin:
                raise TaskTimeoutError(message) from error
            raise

    def time_triangulating(
        self,
        seconds_by_recipe: Mapping[Recipe, float],
        polygons: Sequence[Polygon],
        budget_s: float,
        seed: int,
    ) -> dict[Recipe, list[float]]:
        """Time the triangulators again in several rounds; return each round's seconds by recipe.

        A recipe whose first triangulation needs more than half of `budget_s` is skipped. Rounds of
        third-party triangulators, which run in separate processes, are not interleaved.
        """
        timed = [recipe for recipe, seconds in seconds_by_recipe.items() if 2 * seconds <= budget_s]
        if not timed:
            return {}
        mean_s = sum(seconds_by_recipe[recipe] for recipe in timed) / len(timed)
        fitting = int(TRIANGULATING_SHARE * budget_s / max(mean_s, 1e-9))
        rounds = min(MAX_ROUNDS, max(MIN_ROUNDS, fitting))
        builtin = [recipe for recipe in timed if recipe.builtin]
        groups = [builtin, *([recipe] for recipe in timed if not recipe.builtin)]
        seconds: dict[Recipe, list[float]] = {}
        for group in filter(None, groups):
            arguments = (group, polygons, rounds, seed)
            timeout_s = self.timeout_s + 10 * budget_s * len(group)
            with self.time_stage("triangulate"), suppress(TaskError):
                worker = get_triangulator_worker(group[0])
                samples = self.run(worker, time_in_rounds, *arguments, timeout_s=timeout_s)
                seconds |= dict(zip(group, samples, strict=True))
        return seconds

    def compute_in_second_process(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Start a function, with the time limit of compiling."""
        timeout_s = max(COMPILE_TIMEOUT_S, self.timeout_s)
        return self.submit(SECOND_PROCESS, function, *arguments, timeout_s=timeout_s)

    def start_bounds(
        self, frame: Frame, parts: Sequence[NDArray[np.int32] | None]
    ) -> dict[str, Future[NDArray[np.int64]]]:
        """Start computing lower bounds of each polygon's quads in the second process.

        parts : for each polygon any triangulation (m, 3) that uses every vertex, or None
        """
        compute = self.compute_in_second_process
        return {
            OUTLINE: compute(tasks.compute_outline_bounds, frame, parts),
            MIN_QUADS: compute(tasks.compute_min_quads, frame, self.database),
        }

    def open_device(self, backend: Backend) -> tasks.OpenedDevice:
        """Open a device and test its timer, on the first call; return its details."""
        if backend.label not in self._opened:
            with self.time_stage("open"):
                arguments = (backend.rasteriser, backend.device)
                self._opened[backend.label] = self.run(
                    backend.worker, tasks.open_device, *arguments
                )
        return self._opened[backend.label]

    def draw_and_count(
        self, backend: Backend, frame: Frame, triangles: Triangles, options: Options
    ) -> Counters:
        """Draw triangles (m, 3) and return exact counts, e.g. of shaded quads, per polygon."""
        with self.time_stage("count"):
            arguments = (backend.rasteriser, backend.device, frame, triangles, options)
            return self.run(backend.worker, tasks.draw_and_count, *arguments)

    def time_drawings(
        self,
        backend: Backend,
        candidates: Mapping[str, tasks.Candidate],
        settings: TimingSettings,
        seed: int,
        tick: Callable[[float], None] | None = None,
    ) -> tuple[dict[str, dict[str, Times]], dict[str, str]]:
        """Time the candidates together, in shuffled rounds, in one or several successive processes.

        If the device fails, candidates are timed one by one. Returns two dictionaries by candidate:
        the times, by name, of all drawings timed in the same rounds; and the reasons of failures.
        """
        test = self.open_device(backend).timer
        timeout_s = self.timeout_s + 3 * settings.budget_s * (len(candidates) + 2)
        parts: list[dict[str, Times]] = []
        report: Callable[[float], None] = tick or (lambda _: None)
        start = time.perf_counter()
        try:
            with self.time_stage("time"):
                for number in range(settings.processes):
                    elapsed = time.perf_counter() - start
                    share = settings.get_process_settings(number, elapsed)
                    if share is None:
                        break
                    if number > 0:
                        # A new process has another memory layout, which affects times.
                        self.replace_worker(backend.worker)
                    arguments = (backend.rasteriser, backend.device, dict(candidates))
                    parts.append(
                        self.run(
                            backend.worker,
                            tasks.time_group,
                            *(*arguments, share, test, seed + number),
                            timeout_s=timeout_s,
                            tick=lambda waited, elapsed=elapsed: report(elapsed + waited),
                        )
                    )
        except TaskError as error:
            if len(candidates) == 1:
                return {}, {next(iter(candidates)): str(error)}
            groups: dict[str, dict[str, Times]] = {}
            failures: dict[str, str] = {}
            for name, candidate in candidates.items():
                times, failed = self.time_drawings(backend, {name: candidate}, settings, seed, tick)
                groups |= times
                failures |= failed
            return groups, failures
        group = {name: Times.concatenate([part[name] for part in parts]) for name in parts[0]}
        return dict.fromkeys(candidates, group), {}

    def describe_devices(self) -> dict[str, Any]:
        """Return the driver's details and the timer test of each opened device, by label."""
        return {
            label: {"details": opened.details, "timer": opened.timer and asdict(opened.timer)}
            for label, opened in self._opened.items()
        }

    def replace_worker(self, spec: WorkerSpec) -> None:
        """End a worker; if its process had compiled kernels, they are loaded again."""
        super().replace_worker(spec)
        if spec == TRIANGULATORS:
            self._compiled.clear()
