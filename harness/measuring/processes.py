"""The machine's side of a run: worker processes, open devices, and where the time goes.

All that a run has done elsewhere goes through `Bench.submit`, our own code and others' alike.
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import psutil
from shapely import Polygon

from harness.frame import Frame
from harness.measuring import tasks
from harness.measuring.other_version import OtherVersion, triangulate_elsewhere
from harness.measuring.timing import Times
from harness.measuring.worker import Limits, OpenWorker, TaskFailed, TaskTimedOut, Worker
from harness.rasterisers import BUILT_IN
from harness.rasterisers.base import Counters, Device, Options, Triangles
from harness.settings import TimingSettings
from harness.triangulating.recipes import Recipe
from harness.triangulating.result import FrameTriangulation
from harness.triangulating.rounds import time_in_rounds
from harness.triangulating.triangulate import triangulate_polygons, warm_up
from triangulators.compute.compiled_files import is_kept
from triangulators.devices import cores

T = TypeVar("T")

MEMORY_SHARE = 0.75
"""Of the memory that is free, what a triangulator that others wrote may take."""

IMPORT_S = 60.0
"""Least time that a third party's code is given to be imported and asked what it is."""

FEWEST_ROUNDS, MOST_ROUNDS = 5, 12
"""Rounds of triangulating; the most is as many as an interval gains much from."""

TRIANGULATING_SHARE = 1 / 3
"""Of the seconds for which a triangulator's triangles are drawn, those for triangulating again."""

COMPILE_S = 900.0
"""Longest that compiling a triangulator of ours may take, which is not the triangulator's time."""


POLL_S = 0.1
"""How often, at least, whoever waits for a task is open to signals."""

COMPILED_LATE = "triangulators.geometry.order"
"""A module whose kernels are compiled once the optimum's are."""


def foreign_limits() -> Limits:
    """Return what a process may take in which others' code triangulates."""
    return Limits(int(MEMORY_SHARE * psutil.virtual_memory().available))


@dataclass(frozen=True)
class Home:
    """A process for tasks: its name, its variables, and whether others' code runs in it."""

    label: str
    environment: Mapping[str, str] = field(default_factory=dict)
    limits: Limits | None = None


TRIANGULATORS = Home("triangulators")
"""Triangulates, by all that is ours."""

SECOND = Home("second process")
"""Compiles and computes while the first triangulates."""


def rasteriser_home(name: str) -> Home:
    """Return where the rasteriser `name` is asked what it can do."""
    return Home(f"rasteriser {name}", limits=None if name in BUILT_IN else Limits())


def home_of(recipe: Recipe) -> Home:
    """Return where a recipe's triangulator runs."""
    return TRIANGULATORS if recipe.builtin else Home(f"triangulator {recipe}", {}, foreign_limits())


@dataclass(frozen=True)
class Backend:
    """A rasteriser on a device."""

    rasteriser: str
    device: Device

    @property
    def label(self) -> str:
        """Name for messages."""
        return f"{self.rasteriser} on {self.device.name}"

    @property
    def home(self) -> Home:
        """Where it draws."""
        limits = rasteriser_home(self.rasteriser).limits
        return Home(self.label, self.device.environment, limits)


class Bench:
    """Runs tasks where they belong: a process for each device and for each foreign triangulator.

    Processes are started when first needed, replaced after a failure, and kept until `close`.

    open_worker : how processes are made
    timeout_s : longest that one task may take, apart from the time it was told to spend drawing
    database : model database that triangulations are read from and written to
    other : another version of the code, which triangulates, too
    """

    def __init__(
        self,
        open_worker: OpenWorker,
        timeout_s: float,
        database: Path | None = None,
        other: OtherVersion | None = None,
    ) -> None:
        self._open_worker = open_worker
        self.timeout_s = timeout_s
        self.database = database
        self.other = other
        self._workers: dict[str, Worker] = {}
        self._opened: dict[str, tasks.Opened] = {}
        self.seconds: dict[str, float] = defaultdict(float)
        self.stopping = False
        self._threads: dict[str, ThreadPoolExecutor] = {}
        self._compiled: set[str] = set()

    def submit(
        self,
        home: Home,
        function: Callable[..., T],
        *arguments: Any,
        timeout_s: float | None = None,
        tick: Callable[[float], None] | None = None,
    ) -> Future[T]:
        """Begin to run a function in a process, after what was begun there before.

        timeout_s : longest that it may take, if not what the bench gives each task
        tick : called while it runs, with the seconds so far

        The result raises `TaskFailed` if the process crashed or hung, or the function raised.
        """
        if home.label not in self._threads:
            self._threads[home.label] = ThreadPoolExecutor(max_workers=1)
        limit_s = timeout_s or self.timeout_s
        return self._threads[home.label].submit(
            self._call, home, function, arguments, limit_s, tick
        )

    def run(self, home: Home, function: Callable[..., T], *arguments: Any, **how: Any) -> T:
        """Return what `submit` gives, once it is there."""
        return result_of(self.submit(home, function, *arguments, **how))

    def compile(self, recipe: Recipe, tick: Callable[[float], None] | None = None) -> None:
        """Have what a triangulator of this version needs compiled, or loaded; done once.

        Raises
        ------
        TaskFailed
            if its process crashed, hung or ran out of memory
        """
        if not recipe.other and recipe.base not in self._compiled:
            timeout_s = max(COMPILE_S, self.timeout_s) if recipe.builtin else self.timeout_s
            said = (
                f"compiling it took more than {timeout_s:g} s; close other programs, and --resume"
            )
            self._waited("compile", said, warm_up, recipe, timeout_s=timeout_s, tick=tick)
            self._compiled.add(recipe.base)

    def compile_ahead(self, recipes: Sequence[Recipe]) -> None:
        """Begin to compile in a second process, if nothing is compiled yet; from the last on.

        `compile` begins with the first, and finds on disk what the second process has done.
        """
        ours = [recipe for recipe in reversed(recipes) if recipe.builtin]
        begun = SECOND.label in self._threads
        if begun or len(ours) < 2 or cores() < 2 or is_kept(COMPILED_LATE):
            return
        self.compute(warm_up, *ours)

    def triangulate(
        self,
        recipe: Recipe,
        polygons: Sequence[Polygon],
        tick: Callable[[float], None] | None = None,
    ) -> FrameTriangulation:
        """Run a triangulator over polygons in px, compiled first if that was not done.

        tick : called while it is waited for, with the seconds so far

        Raises
        ------
        TaskFailed
            if its process crashed, hung or ran out of memory
        """
        self.compile(recipe)
        said = (
            f"triangulating took more than {self.timeout_s:g} s; give it longer with "
            "--timeout, or a smaller scene (limit=)"
        )
        if recipe.other:
            given = (triangulate_elsewhere, recipe, polygons, self.other)
            return self._waited("triangulate", said, *given, tick=tick)
        arguments = (triangulate_polygons, recipe, polygons, self.database)
        return self._waited("triangulate", said, *arguments, tick=tick)

    def _waited(
        self,
        stage: str,
        said: str,
        function: Callable[..., T],
        recipe: Recipe,
        *rest: Any,
        **how: Any,
    ) -> T:
        """Run a function of a recipe in its process; `said` where ours ran past its time."""
        try:
            with self.clocked(stage):
                return self.run(home_of(recipe), function, recipe, *rest, **how)
        except TaskTimedOut as error:
            if recipe.builtin:
                raise TaskTimedOut(said) from error
            raise

    def time_triangulating(
        self, once: Mapping[Recipe, float], polygons: Sequence[Polygon], budget_s: float, seed: int
    ) -> dict[Recipe, list[float]]:
        """Triangulate again in rounds; returns the seconds of each round, as `time_in_rounds` does.

        once : seconds that each triangulator took; what would take too long is left out
        budget_s : seconds for which each is drawn; a share of that is spent here

        Third parties' triangulators, each in a process of its own, have rounds of their own.
        """
        chosen = [recipe for recipe, seconds in once.items() if 2 * seconds <= budget_s]
        if not chosen:
            return {}
        mean_s = sum(once[recipe] for recipe in chosen) / len(chosen)
        wanted = int(TRIANGULATING_SHARE * budget_s / max(mean_s, 1e-9))
        rounds = min(MOST_ROUNDS, max(FEWEST_ROUNDS, wanted))
        together = [recipe for recipe in chosen if recipe.builtin]
        groups = [together, *([recipe] for recipe in chosen if not recipe.builtin)]
        found: dict[Recipe, list[float]] = {}
        for group in filter(None, groups):
            arguments = (group, polygons, rounds, seed)
            timeout_s = self.timeout_s + 10 * budget_s * len(group)
            with self.clocked("triangulate"), suppress(TaskFailed):
                home = home_of(group[0])
                samples = self.run(home, time_in_rounds, *arguments, timeout_s=timeout_s)
                found |= dict(zip(group, samples, strict=True))
        return found

    def compute(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Begin to run a function of ours in the second process.

        What a triangulator may take does not limit it.
        """
        return self.submit(SECOND, function, *arguments, timeout_s=max(COMPILE_S, self.timeout_s))

    def open(self, backend: Backend) -> tasks.Opened:
        """Open the device, test its timer, and return what it is; done once.

        Raises
        ------
        HarnessError
            if it cannot be opened
        """
        if backend.label not in self._opened:
            with self.clocked("open"):
                arguments = (backend.rasteriser, backend.device)
                self._opened[backend.label] = self.run(backend.home, tasks.open_device, *arguments)
        return self._opened[backend.label]

    def count(
        self, backend: Backend, frame: Frame, triangles: Triangles, options: Options
    ) -> Counters:
        """Count what drawing `triangles` costs.

        Raises
        ------
        HarnessError
            if the device cannot do it, or fails
        """
        with self.clocked("count"):
            drawn = (backend.rasteriser, backend.device, frame, triangles, options)
            return self.run(backend.home, tasks.count, *drawn)

    def time(
        self,
        backend: Backend,
        candidates: Mapping[str, tasks.Candidate],
        settings: TimingSettings,
        seed: int,
        tick: Callable[[float], None] | None = None,
    ) -> tuple[dict[str, dict[str, Times]], dict[str, str]]:
        """Time the candidates together, in shuffled rounds.

        In as many fresh processes, one after the other, as the settings want, or as there is time
        for.

        If the device fails under them, each is tried alone, so that only the one that brings it
        down is lost.

        Returns ({candidate: its group's times by name}, {candidate: why it failed}).
        """
        test = self.open(backend).timer
        timeout_s = self.timeout_s + 3 * settings.budget_s * (len(candidates) + 2)
        parts: list[dict[str, Times]] = []
        told: Callable[[float], None] = tick or (lambda _: None)
        began = time.perf_counter()
        try:
            with self.clocked("time"):
                for number in range(settings.processes):
                    spent = time.perf_counter() - began
                    share = settings.of_process(number, spent)
                    if share is None:
                        break
                    if number > 0:
                        # The next one is fresh: where a process lies in memory is drawn anew, too.
                        self._workers.pop(backend.label).close()
                    drawn = (backend.rasteriser, backend.device, dict(candidates))
                    parts.append(
                        self.run(
                            backend.home,
                            tasks.time_group,
                            *(*drawn, share, test, seed + number),
                            timeout_s=timeout_s,
                            tick=lambda waited, spent=spent: told(spent + waited),
                        )
                    )
        except TaskFailed as error:
            if len(candidates) == 1:
                return {}, {next(iter(candidates)): str(error)}
            groups: dict[str, dict[str, Times]] = {}
            failures: dict[str, str] = {}
            for name, candidate in candidates.items():
                more, failed = self.time(backend, {name: candidate}, settings, seed, tick)
                groups |= more
                failures |= failed
            return groups, failures
        group = {name: Times.of_processes([part[name] for part in parts]) for name in parts[0]}
        return dict.fromkeys(candidates, group), {}

    def describe(self) -> dict[str, Any]:
        """Return what is known of the devices that were opened, JSON-ready, by label."""
        return {label: asdict(opened) for label, opened in self._opened.items()}

    def close(self, *, at_once: bool = False) -> None:
        """End all processes; `at_once`: whatever they are doing. The second one's work is over."""
        for label, thread in self._threads.items():
            thread.shutdown(wait=not at_once and label != SECOND.label, cancel_futures=True)
        for label, worker in list(self._workers.items()):
            worker.close(at_once=at_once or label == SECOND.label)
        self._workers.clear()

    @contextmanager
    def clocked(self, stage: str) -> Iterator[None]:
        """Add the time spent inside to `seconds[stage]`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - start

    def _call(
        self,
        home: Home,
        function: Callable[..., T],
        arguments: Sequence[Any],
        timeout_s: float,
        tick: Callable[[float], None] | None,
    ) -> T:
        if home.label not in self._workers:
            opened = self._open_worker(home.label, home.environment, home.limits)
            self._workers[home.label] = opened
        worker = self._workers[home.label]
        try:
            return worker.call(function, *arguments, timeout_s=timeout_s, tick=tick)
        except TaskFailed:
            # A context that was lost stays lost: what comes next gets a fresh process.
            if failed := self._workers.pop(home.label, None):
                failed.close()
            if home == TRIANGULATORS:
                self._compiled.clear()
            raise


def result_of(future: Future[T]) -> T:
    """Wait for what was begun, and return it; a signal's handler may raise meanwhile."""
    while not wait([future], POLL_S).done:
        pass
    return future.result()
