"""Executors of tasks: this process, or Dask workers, local or of a scheduler at an address.

A task may run more than once, and must store the same result under the same name each time. Each
thread of a Dask worker runs its tasks in a separate process. A task that crashes ends that process,
not the worker, so the failing task is known. If the worker is killed, the process is killed as well
(on Linux), and the task does not count as failed.
"""

from __future__ import annotations

import logging
import multiprocessing
import pickle
import re
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

from harness.errors import HarnessError, InconclusiveError, UsageError

if TYPE_CHECKING:
    from harness.worker import Worker

MAX_ATTEMPTS = 3  # failures after which a task is not repeated
TASK_TIMEOUT_S = 3600.0
CONNECT_TIMEOUT_S = 60.0  # to a scheduler
QUEUED_TASKS = 2  # at each busy worker thread; they are lost with their worker

SETTINGS = {
    # a worker starts a process for its tasks, which a daemon may not
    "distributed.worker.daemon": False,
    "distributed.comm.timeouts.connect": "20s",
    # the current folder may contain modules of other users
    "distributed.nanny.pre-spawn-environ.PYTHONSAFEPATH": "1",
    # only the command handles Ctrl-C, and ends its workers
    "distributed.worker.preload": ["import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"],
}

_LOG = logging.getLogger(__name__)


class TaskResult(NamedTuple):
    """The value that a task returned, or `failed`, the reason why it failed."""

    value: Any = None
    failed: str = ""


class Executor:
    """Executor that runs tasks in this process, one after another."""

    threads_per_task: int | None = None  # one for each core

    def run_all(self, tasks: Mapping[str, Callable[[], Any]]) -> Iterator[tuple[str, TaskResult]]:
        """Run named tasks; yield the name and the result of each task when it ends."""
        for name, task in tasks.items():
            for _ in range(MAX_ATTEMPTS):
                try:
                    result = TaskResult(task())
                    break
                except HarnessError as error:
                    result = TaskResult(failed=str(error))
                    _LOG.info("%s: attempt failed: %s", name, error)
            yield name, result

    def close(self) -> None:
        """Release workers and connections."""


class DaskExecutor(Executor):
    """Runs tasks as futures of Dask's distributed scheduler, one per worker thread.

    address : `local` for a process per core, `local:N` for N processes, or a scheduler's address
    """

    threads_per_task = 1

    def __init__(self, address: str) -> None:
        from scenes.spec import format_install_command  # not needed in a worker
        from triangulators.compute.kernels import count_usable_cores

        try:
            import dask
            import distributed
        except ImportError as error:
            raise UsageError(f"--dask needs Dask: {format_install_command('dask')}") from error
        self._distributed = distributed
        self._client: Any = None
        self._cluster: Any = None
        dask.config.set(SETTINGS)
        for name in ("distributed", "distributed.client", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        local = re.fullmatch(r"local(?::(\d+))?", address)
        if local is None and ":" not in address:
            raise UsageError(
                f"--dask {address}: give local, local:N or an address, e.g. tcp://host:8786"
            )
        self._address = address
        try:
            if local is not None:
                self._address = self._start_cluster(address, int(local[1] or count_usable_cores()))
            self._client = distributed.Client(
                self._address, timeout=CONNECT_TIMEOUT_S, set_as_default=False
            )
        except KeyboardInterrupt:
            self.close()
            raise
        except OSError as error:
            raise self._make_unreachable_error() from error
        except ValueError as error:
            raise UsageError(f"--dask {address}: {error}") from error

    def _start_cluster(self, address: str, number: int) -> str:
        """Start a local cluster of `number` workers; return its scheduler's address.

        Signals are delayed: a cluster that is interrupted while it starts cannot be closed.
        """
        from harness.machine import system
        from harness.machine.process import hide_working_folder

        if not 1 <= number <= 1024:
            raise UsageError(f"--dask {address}: give 1 to 1024 workers")
        with hide_working_folder(), system.delay_signals(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the port of the dashboard may be taken
            self._cluster = self._distributed.LocalCluster(
                n_workers=number,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:8787",  # not reachable from other machines
                memory_limit=0,  # unlimited: tasks run in other processes
                silence_logs=logging.CRITICAL,
            )
        return str(self._cluster.scheduler_address)

    @property
    def dashboard(self) -> str:
        """Address of the dashboard of the workers."""
        return str(self._client.dashboard_link)

    @property
    def threads(self) -> int:
        """Number of tasks that run at the same time; workers may come and go."""
        return sum(self._client.nthreads().values())

    def run_all(self, tasks: Mapping[str, Callable[[], Any]]) -> Iterator[tuple[str, TaskResult]]:
        """Submit tasks, a few at a time, and yield the result of each."""
        waiting, failures = deque(tasks), Counter[str]()
        running: dict[str, str] = {}
        ended = self._distributed.as_completed(loop=self._client.loop)
        try:
            while waiting or running:
                if self._client.status != "running":  # all submitted tasks are lost
                    raise self._make_unreachable_error()
                room = (1 + QUEUED_TASKS) * max(1, self.threads)
                while waiting and len(running) < room:
                    name = waiting.popleft()
                    pickled = pickle.dumps(tasks[name])
                    future = self._client.submit(run_task, pickled, pure=False)
                    running[future.key] = name
                    ended.add(future)
                future = next(ended)
                name = running.pop(future.key)
                result = self._get_result(future)
                failures[name] += bool(result.failed)
                if result.failed:
                    _LOG.info("%s: attempt %d failed: %s", name, failures[name], result.failed)
                if result.failed and failures[name] < MAX_ATTEMPTS:
                    waiting.append(name)
                else:
                    yield name, result
        except (OSError, RuntimeError, ValueError, self._distributed.CancelledError) as error:
            raise self._make_unreachable_error() from error

    def _get_result(self, future: Any) -> TaskResult:
        """Return a task's result; a failed task is a result, a lost scheduler an exception."""
        try:
            result: TaskResult = future.result(timeout=CONNECT_TIMEOUT_S)
        except self._distributed.scheduler.KilledWorker:
            return TaskResult(failed="the workers that ran the task were killed")
        except (self._distributed.CancelledError, OSError):
            raise
        except Exception as error:  # raised by Dask, e.g. if the worker lacks a module
            text = " ".join(str(error).split())
            return TaskResult(failed=f"{type(error).__name__}: {text}")
        return result if result.failed else TaskResult(pickle.loads(result.value))

    def close(self) -> None:
        """Disconnect from the scheduler, and end a cluster that was started here."""
        for resource in (self._client, self._cluster):
            with suppress(Exception):  # the scheduler may be unreachable, or was never reached
                resource.close(timeout=5)

    def _make_unreachable_error(self) -> InconclusiveError:
        return InconclusiveError(
            f"no scheduler answers at {self._address}: start one (dask scheduler), "
            "then run the same command again"
        )


def run_task(task: bytes) -> TaskResult:
    """Run a pickled task in this thread's process; a failure is a result, not an exception.

    Task and value stay pickled in the Dask worker, whose imports would otherwise take 200 MB.
    """
    try:
        return TaskResult(_get_process().call(_run_pickled, task, timeout_s=TASK_TIMEOUT_S))
    except HarnessError as error:
        return TaskResult(failed=str(error))


def _run_pickled(task: bytes) -> bytes:
    return pickle.dumps(pickle.loads(task)())


def _get_process() -> Worker:
    from harness.worker import get_shared_worker  # not needed without Dask

    # Dask starts workers as daemons, which may not start processes. No public setting lets them
    # start processes that end with the worker.
    multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
    return get_shared_worker("the part's process")
