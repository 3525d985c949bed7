"""A pool of named worker processes, each of which runs tasks one after another."""

import logging
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeVar

import psutil

from harness.machine import system
from harness.workers.worker import POLL_S, Limits, OpenWorker, TaskError, Worker

T = TypeVar("T")

_LOG = logging.getLogger(__name__)

MEMORY_SHARE = 0.75  # of the free memory, for a third party's triangulator


def get_third_party_limits() -> Limits:
    """Return the limits of a process in which a third party's code triangulates."""
    memory = system.query_psutil(psutil.virtual_memory)
    return Limits(int(MEMORY_SHARE * memory.available) if memory else None)


@dataclass(frozen=True)
class WorkerSpec:
    """Description of a worker process; `limits` are for third-party code."""

    name: str
    environment: Mapping[str, str] = field(default_factory=dict)
    limits: Limits | None = None


class WorkerPool:
    """Worker processes by name, started on first use; each runs one task at a time."""

    abandoned: ClassVar[tuple[str, ...]] = ()  # names of workers whose tasks `close` does not await

    def __init__(self, open_worker: OpenWorker, timeout_s: float) -> None:
        self._open_worker = open_worker
        self.timeout_s = timeout_s
        self.seconds: dict[str, float] = defaultdict(float)
        self._workers: dict[str, Worker] = {}
        self._threads = defaultdict[str, ThreadPoolExecutor](lambda: ThreadPoolExecutor(1))

    def submit(
        self,
        spec: WorkerSpec,
        function: Callable[..., T],
        *arguments: Any,
        timeout_s: float | None = None,
        tick: Callable[[float], None] | None = None,
    ) -> Future[T]:
        """Start running a function in a worker, after previously submitted tasks.

        `Worker.call` describes the options, and the errors that the future's `result()` raises.
        """
        limit_s = timeout_s or self.timeout_s
        return self._threads[spec.name].submit(
            self._call, spec, function, *arguments, timeout_s=limit_s, tick=tick
        )

    def run(
        self, spec: WorkerSpec, function: Callable[..., T], *arguments: Any, **options: Any
    ) -> T:
        """Run a function in a worker as `submit` does, and wait for the result."""
        return wait_for_result(self.submit(spec, function, *arguments, **options))

    def is_used(self, spec: WorkerSpec) -> bool:
        """Return whether a task was submitted to the worker."""
        return spec.name in self._threads

    def replace_worker(self, spec: WorkerSpec) -> None:
        """End a worker; the next task starts a new process."""
        if worker := self._workers.pop(spec.name, None):
            worker.close()

    def close(self, *, at_once: bool = False) -> None:
        """End all workers after their tasks in progress; cancel tasks that wait.

        With `at_once` all workers, otherwise only those in `abandoned`, are killed at once.
        """
        for name, thread in self._threads.items():
            thread.shutdown(wait=not at_once and name not in self.abandoned, cancel_futures=True)
        for name, worker in list(self._workers.items()):
            worker.close(at_once=at_once or name in self.abandoned)
        self._workers.clear()

    @contextmanager
    def time_stage(self, stage: str) -> Iterator[None]:
        """Add the duration of the block to `seconds[stage]`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - start

    def _call(
        self, spec: WorkerSpec, function: Callable[..., T], *arguments: Any, **options: Any
    ) -> T:
        if spec.name not in self._workers:
            worker = self._open_worker(spec.name, spec.environment, spec.limits)
            self._workers[spec.name] = worker
        try:
            return self._workers[spec.name].call(function, *arguments, **options)
        except TaskError:
            # A lost graphics context does not recover.
            _LOG.info("%s: the next task gets a new process", spec.name)
            self.replace_worker(spec)
            raise


def wait_for_result(future: Future[T]) -> T:
    """Wait for a task and return its result; a signal handler may raise meanwhile."""
    while not wait([future], POLL_S).done:
        pass
    return future.result()
