"""The machine's side of a run: worker processes, open devices, and where the time goes."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar

import psutil
from shapely import Polygon

from harness.frame import Frame
from harness.measuring import tasks
from harness.measuring.timing import Settings, Times
from harness.measuring.worker import Executor, TaskFailed
from harness.rasterisers.base import Counters, Device, Options, Triangles
from harness.triangulating.frames import FrameTriangulation, is_builtin, triangulate_polygons

T = TypeVar("T")

MEMORY_SHARE = 0.75
"""Of the memory that is free, what a triangulator that others wrote may take."""


class OpenWorker(Protocol):
    """Makes the processes of a run."""

    def __call__(
        self, name: str, environment: Mapping[str, str], memory_bytes: int | None = None
    ) -> Executor:
        """Return an executor called `name`; see `harness.measuring.worker.Worker`."""
        ...


@dataclass(frozen=True)
class Target:
    """A rasteriser on a device."""

    rasteriser: str
    device: Device

    @property
    def label(self) -> str:
        """Name for messages."""
        return f"{self.rasteriser} on {self.device.name}"


class Bench:
    """Runs tasks where they belong: a process for each device and for each foreign triangulator.

    Processes are started when first needed, replaced after a failure, and kept until `close`.

    open_worker : how processes are made; tests give inline ones
    timeout_s : longest that one task may take, apart from the time it was told to spend drawing
    database : model database that triangulations are read from and written to
    """

    def __init__(
        self, open_worker: OpenWorker, timeout_s: float, database: Path | None = None
    ) -> None:
        self._open_worker = open_worker
        self._timeout_s = timeout_s
        self._database = database
        self._workers: dict[str, Executor] = {}
        self._opened: dict[str, tasks.Opened] = {}
        self.seconds: dict[str, float] = defaultdict(float)
        self.stopping = False
        self._background = ThreadPoolExecutor(max_workers=1)
        self._opening: dict[str, Future[tasks.Opened]] = {}

    def triangulate(
        self,
        name: str,
        polygons: Sequence[Polygon],
        seed: int,
        calibration: Mapping[str, float] | None = None,
    ) -> FrameTriangulation:
        """Run a triangulator over polygons in px.

        Raises
        ------
        TaskFailed
            if its process crashed, hung or ran out of memory
        """
        own = is_builtin(name)
        label = "triangulators" if own else f"triangulator {name}"
        limit = None if own else int(MEMORY_SHARE * psutil.virtual_memory().available)
        with self.clocked("triangulate"):
            arguments = (name, polygons, seed, calibration, self._database)
            return self._call(label, {}, limit, triangulate_polygons, *arguments)

    def open(self, target: Target) -> tasks.Opened:
        """Open the device, test its timer, and return what it is; done once.

        Raises
        ------
        HarnessError
            if it cannot be opened
        """
        if target.label not in self._opened:
            opening = self._opening.pop(target.label, None)
            with self.clocked("open"):
                self._opened[target.label] = (
                    opening.result() if opening else self._on(target, tasks.open_device)
                )
        return self._opened[target.label]

    def open_soon(self, target: Target) -> None:
        """Begin to open a device, in its own process, while this one does something else."""
        if target.label not in self._opened and target.label not in self._opening:
            # A process ends with the thread that started it, so this one does.
            self._worker(target.label, target.device.environment, None)
            self._opening[target.label] = self._background.submit(
                self._on, target, tasks.open_device
            )

    def count(
        self, target: Target, frame: Frame, triangles: Triangles, options: Options
    ) -> Counters:
        """Count what drawing `triangles` costs.

        Raises
        ------
        HarnessError
            if the device cannot do it, or fails
        """
        with self.clocked("count"):
            counters: Counters = self._on(target, tasks.count, frame, triangles, options)
            return counters

    def time(
        self,
        target: Target,
        candidates: Mapping[str, tuple[Frame, Triangles]],
        options: Options,
        settings: Settings,
        seed: int,
        tick: Callable[[float], None] | None = None,
    ) -> tuple[dict[str, dict[str, Times]], dict[str, str]]:
        """Time the candidates, (frame, triangles), together, in shuffled rounds.

        If the device fails under them, each is tried alone, so that only the one that brings it
        down is lost.

        Returns ({candidate: its group's times by name}, {candidate: why it failed}).
        """
        test = self.open(target).timer
        timeout_s = self._timeout_s + 3 * settings.budget_s * (len(candidates) + 2)
        arguments = (dict(candidates), options, settings, test, seed)
        try:
            with self.clocked("time"):
                group = self._on(
                    target, tasks.time_group, *arguments, timeout_s=timeout_s, tick=tick
                )
        except TaskFailed as error:
            if len(candidates) == 1:
                return {}, {next(iter(candidates)): str(error)}
            groups: dict[str, dict[str, Times]] = {}
            failures: dict[str, str] = {}
            for name, candidate in candidates.items():
                alone = {name: candidate}
                more, failed = self.time(target, alone, options, settings, seed, tick)
                groups |= more
                failures |= failed
            return groups, failures
        return dict.fromkeys(candidates, group), {}

    def describe(self) -> dict[str, Any]:
        """Return what is known of the devices that were opened, JSON-ready, by label."""
        return {
            label: {
                "details": opened.details,
                "timer": None if opened.timer is None else asdict(opened.timer),
            }
            for label, opened in self._opened.items()
        }

    def close(self) -> None:
        """End all processes."""
        self._background.shutdown(wait=True, cancel_futures=True)
        for worker in self._workers.values():
            worker.close()
        self._workers.clear()

    @contextmanager
    def clocked(self, stage: str) -> Iterator[None]:
        """Add the time spent inside to `seconds[stage]`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - start

    def _on(
        self,
        target: Target,
        function: Callable[..., T],
        *arguments: Any,
        timeout_s: float | None = None,
        tick: Callable[[float], None] | None = None,
    ) -> T:
        return self._call(
            target.label,
            target.device.environment,
            None,
            function,
            target.rasteriser,
            target.device,
            *arguments,
            timeout_s=timeout_s,
            tick=tick,
        )

    def _call(
        self,
        label: str,
        environment: Mapping[str, str],
        memory_bytes: int | None,
        function: Callable[..., T],
        *arguments: Any,
        timeout_s: float | None = None,
        tick: Callable[[float], None] | None = None,
    ) -> T:
        worker = self._worker(label, environment, memory_bytes)
        try:
            return worker.call(
                function, *arguments, timeout_s=timeout_s or self._timeout_s, tick=tick
            )
        except TaskFailed:
            # A context that was lost stays lost: what comes next gets a fresh process.
            self._workers.pop(label).close()
            raise

    def _worker(
        self, label: str, environment: Mapping[str, str], memory_bytes: int | None
    ) -> Executor:
        if label not in self._workers:
            self._workers[label] = self._open_worker(label, environment, memory_bytes)
        return self._workers[label]
