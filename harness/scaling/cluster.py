"""A crew on Dask: a cluster of this machine's cores, or one that is reached at an address."""

import logging
import os
import pickle
import queue
import re
import time
import warnings
from contextlib import suppress
from typing import Any

from harness.errors import INCONCLUSIVE, HarnessError, UsageError
from harness.machine import system
from harness.progress import Reporter
from harness.scaling import task_queue
from harness.scaling.task_queue import Answer, Crew, Task
from scenes.spec import install

LOCAL = re.compile(r"local(?::(\d+))?")

SETTINGS = {
    # so that a worker may have processes of its own
    "distributed.worker.daemon": False,
    "distributed.comm.timeouts.connect": "20s",
    # Ctrl-C goes to the command alone, which ends its workers
    "distributed.worker.preload": ["import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"],
}

WAITING = 2
"""Tasks that wait at each worker thread while it is busy; more would only be forgotten with it."""

CONNECT_S = 60.0
"""Seconds that a scheduler is waited for."""

LOOK_S = 3.0
"""Seconds between two looks at how many workers there are."""

QUIET_S = 60.0
"""Seconds without a worker after which that is said."""


class Gone(HarnessError):  # noqa: N818 - says what happened
    """The scheduler cannot be reached."""

    exit_code = INCONCLUSIVE


def cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class DaskCrew(Crew):
    """Futures on Dask's distributed scheduler; a worker has one thread for each core it is given.

    where : `local` for a process on each core, `local:N` for N of them, or a scheduler's address

    Raises
    ------
    UsageError
        if Dask is not installed, or `where` is no address
    Gone
        if no scheduler answers there
    """

    threads_each = 1

    def __init__(self, where: str, reporter: Reporter) -> None:
        try:
            import dask
            import distributed
        except ImportError as error:
            raise UsageError(f"--dask needs Dask: {install('dask')}") from error
        self._distributed = distributed
        self._reporter = reporter
        self._ended: queue.Queue[Any] = queue.Queue()
        self._futures: dict[str, tuple[str, Any]] = {}
        self._number = 0
        self._looked = self._alive = 0.0
        self._threads = 0
        self._cluster: Any = None
        dask.config.set(SETTINGS)
        for name in ("distributed", "distributed.client", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        local = LOCAL.fullmatch(where)
        if local is None and ":" not in where:
            raise UsageError(
                f"--dask {where}: give local, local:N or an address as tcp://host:8786"
            )
        if local is not None:
            number = int(local[1] or cores())
            if not 1 <= number <= 1024:
                raise UsageError(f"--dask {where}: give 1 to 1024 workers")
            try:
                self._start(number)
            except KeyboardInterrupt:
                self.close()
                raise
        self._where = where if self._cluster is None else self._cluster.scheduler_address
        self._connect()

    @property
    def dashboard(self) -> str:
        """Address of the page that shows what the workers do."""
        return str(self._client.dashboard_link)

    @property
    def threads(self) -> int:
        """How many tasks the workers can do at a time; looked up now and then."""
        now = time.monotonic()
        if now - self._looked > LOOK_S:
            self._looked = now
            try:
                self._threads = sum(self._client.nthreads().values())
            except (OSError, TimeoutError, RuntimeError, ValueError) as error:
                raise self._gone() from error
            if self._threads:
                self._alive = now
            elif now - self._alive > QUIET_S:
                self._reporter.once(f"no worker is connected to {self._where}; waiting for one")
        return self._threads

    @property
    def room(self) -> int:
        """How many tasks it may have at a time."""
        return (1 + WAITING) * max(1, self.threads)

    def start(self, name: str, task: Task) -> None:
        """Send a task to the scheduler."""
        self._number += 1
        key = f"{name}-{os.getpid()}-{self._number}"
        try:
            packed = pickle.dumps(task)
            future = self._client.submit(task_queue.carry_out, packed, key=key, pure=False)
        except (OSError, RuntimeError, ValueError) as error:
            raise self._gone() from error
        self._futures[key] = (name, future)
        future.add_done_callback(self._ended.put)

    def ended(self, timeout_s: float) -> list[tuple[str, Answer]]:
        """Return tasks that ended since the last call."""
        futures: list[Any] = []
        try:
            futures.append(self._ended.get(timeout=timeout_s))
            while not self._ended.empty():
                futures.append(self._ended.get())
        except queue.Empty:
            if self._client.status not in ("running", "connecting"):
                raise self._gone() from None
        return [(self._futures.pop(each.key)[0], self._answer(each)) for each in futures]

    def _answer(self, future: Any) -> Answer:
        if future.cancelled() or future.status == "lost":
            raise self._gone()
        try:
            answer: Answer = future.result(timeout=CONNECT_S)
        except self._distributed.scheduler.KilledWorker:
            return Answer(failed="the workers that had it died, each time")
        except (self._distributed.CancelledError, OSError, TimeoutError) as error:
            raise self._gone() from error
        except Exception as error:  # Dask's own: it cannot be sent, or the worker lacks our code
            text = " ".join(str(error).split())
            return Answer(failed=f"{type(error).__name__}: {text}")
        if isinstance(answer.value, bytes):
            return Answer(pickle.loads(answer.value))
        return answer

    def close(self) -> None:
        """Let go of the scheduler, and end a cluster that was started here."""
        self._futures.clear()
        with suppress(Exception):  # of a scheduler that is gone, or never was
            self._client.close(timeout=2)
        if self._cluster is not None:
            self._cluster.close(timeout=5)

    def _start(self, number: int) -> Any:
        """Start a cluster; a signal that stops the command takes effect when it has started.

        Half a cluster cannot be closed, and complains as Python ends.
        """
        with system.stopped_after(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that another program has the dashboard's port
            self._cluster = self._distributed.LocalCluster(
                n_workers=number,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:8787",  # which nobody else can look at
                memory_limit=0,  # the tasks' memory is that of other processes
                silence_logs=logging.CRITICAL,
            )

    def _connect(self) -> None:
        begun = time.monotonic()
        while True:
            try:
                self._client = self._distributed.Client(
                    self._where, timeout=5, set_as_default=False
                )
                self._looked, self._alive = 0.0, time.monotonic()
                return
            except (OSError, TimeoutError, ValueError) as error:
                if isinstance(error, ValueError) and not isinstance(error, TimeoutError):
                    raise UsageError(f"--dask {self._where}: {error}") from error
                if time.monotonic() - begun > CONNECT_S:
                    raise self._gone() from error
                time.sleep(0.5)

    def _gone(self) -> Gone:
        return Gone(
            f"no scheduler answers at {self._where}: start one (dask scheduler), "
            "then give the same command again"
        )
