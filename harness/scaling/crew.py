"""Those who carry out tasks: this process, or workers of Dask, here or at an address.

A task may be carried out more than once: when the process that had it is killed. So its result has
to be the same each time, and to be kept under one name.

Inside a worker each of its threads has a process of its own for the tasks. A task that crashes
costs that process, not the worker, so that it is known which one it was. Killing the worker kills
the process, too (on Linux), and says nothing about the task.
"""

from __future__ import annotations

import atexit
import logging
import multiprocessing
import pickle
import re
import threading
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

from harness.errors import INCONCLUSIVE, HarnessError, UsageError

if TYPE_CHECKING:
    from harness.measuring.worker import Worker

ATTEMPTS = 3
"""Times that a task may fail, by itself, before it is set aside."""

LONGEST_S = 3600.0
"""Seconds after which a worker stops a task, which counts as failed."""

CONNECT_S = 60.0
"""Seconds that a scheduler is waited for."""

WAITING = 2
"""Tasks that wait at each worker thread while it is busy; more would only be forgotten with it."""

SETTINGS = {
    # so that a worker may have processes of its own
    "distributed.worker.daemon": False,
    "distributed.comm.timeouts.connect": "20s",
    # the current folder may hold a stranger's modules
    "distributed.nanny.pre-spawn-environ.PYTHONSAFEPATH": "1",
    # Ctrl-C goes to the command alone, which ends its workers
    "distributed.worker.preload": ["import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"],
}

Task = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function and its arguments."""


class Answer(NamedTuple):
    """What became of a task: its value, or why it `failed`, time and again."""

    value: Any = None
    failed: str = ""


class Gone(HarnessError):  # noqa: N818 - says what happened
    """The scheduler cannot be reached."""

    exit_code = INCONCLUSIVE


class Crew:
    """Carries out tasks in this very process, one after another; others do it elsewhere.

    threads_each : threads that a task may use; one for each core if None
    """

    threads_each: int | None = None

    def answers(self, tasks: Mapping[str, Task]) -> Iterator[tuple[str, Answer]]:
        """Carry out tasks; yield the name of each as it ends, and what became of it.

        Raises HarnessError if the crew cannot go on; what was done is done.
        """
        for name, (function, arguments) in tasks.items():
            for _ in range(ATTEMPTS):
                try:
                    answer = Answer(function(*arguments))
                    break
                except HarnessError as error:
                    answer = Answer(failed=str(error))
            yield name, answer

    def close(self) -> None:
        """Give back what it has taken."""


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

    def __init__(self, where: str) -> None:
        from scenes.spec import install  # which a worker does without, and the next
        from triangulators.devices import cores

        try:
            import dask
            import distributed
        except ImportError as error:
            raise UsageError(f"--dask needs Dask: {install('dask')}") from error
        self._distributed = distributed
        self._client: Any = None
        self._cluster: Any = None
        dask.config.set(SETTINGS)
        for name in ("distributed", "distributed.client", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        local = re.fullmatch(r"local(?::(\d+))?", where)
        if local is None and ":" not in where:
            raise UsageError(
                f"--dask {where}: give local, local:N or an address as tcp://host:8786"
            )
        self._where = where
        try:
            if local is not None:
                self._where = self._start(where, int(local[1] or cores()))
            self._client = distributed.Client(self._where, timeout=CONNECT_S, set_as_default=False)
        except KeyboardInterrupt:
            self.close()
            raise
        except OSError as error:
            raise self._gone() from error
        except ValueError as error:
            raise UsageError(f"--dask {where}: {error}") from error

    def _start(self, where: str, number: int) -> str:
        """Start a cluster; a signal that stops the command takes effect when it has started.

        Half a cluster cannot be closed, and complains as Python ends.
        """
        from harness.machine import system
        from harness.machine.user_modules import hidden_working_folder

        if not 1 <= number <= 1024:
            raise UsageError(f"--dask {where}: give 1 to 1024 workers")
        with hidden_working_folder(), system.stopped_after(), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that another program has the dashboard's port
            self._cluster = self._distributed.LocalCluster(
                n_workers=number,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:8787",  # which nobody else can look at
                memory_limit=0,  # the tasks' memory is that of other processes
                silence_logs=logging.CRITICAL,
            )
        return str(self._cluster.scheduler_address)

    @property
    def dashboard(self) -> str:
        """Address of the page that shows what the workers do."""
        return str(self._client.dashboard_link)

    @property
    def threads(self) -> int:
        """How many tasks the workers can do at a time; workers come and go."""
        return sum(self._client.nthreads().values())

    def answers(self, tasks: Mapping[str, Task]) -> Iterator[tuple[str, Answer]]:
        """Keep the workers busy with tasks, a few at a time."""
        waiting, failures = deque(tasks), Counter[str]()
        running: dict[str, str] = {}
        ended = self._distributed.as_completed(loop=self._client.loop)
        try:
            while waiting or running:
                if self._client.status != "running":  # what it would wait for is forgotten
                    raise self._gone()
                room = (1 + WAITING) * max(1, self.threads)
                while waiting and len(running) < room:
                    name = waiting.popleft()
                    packed = pickle.dumps(tasks[name])
                    future = self._client.submit(carry_out, packed, pure=False)
                    running[future.key] = name
                    ended.add(future)
                future = next(ended)
                name = running.pop(future.key)
                answer = self._answer(future)
                failures[name] += bool(answer.failed)
                if answer.failed and failures[name] < ATTEMPTS:
                    waiting.append(name)
                else:
                    yield name, answer
        except (OSError, RuntimeError, ValueError, self._distributed.CancelledError) as error:
            raise self._gone() from error

    def _answer(self, future: Any) -> Answer:
        try:
            answer: Answer = future.result(timeout=CONNECT_S)
        except self._distributed.scheduler.KilledWorker:
            return Answer(failed="the workers that had it died, each time")
        except (self._distributed.CancelledError, OSError):
            raise
        except Exception as error:  # Dask's own: it cannot be sent, or the worker lacks our code
            text = " ".join(str(error).split())
            return Answer(failed=f"{type(error).__name__}: {text}")
        return answer if answer.failed else Answer(pickle.loads(answer.value))

    def close(self) -> None:
        """Let go of the scheduler, and end a cluster that was started here."""
        for each in (self._client, self._cluster):
            with suppress(Exception):  # of a scheduler that is gone, or never was
                each.close(timeout=5)

    def _gone(self) -> Gone:
        return Gone(
            f"no scheduler answers at {self._where}: start one (dask scheduler), "
            "then give the same command again"
        )


_own = threading.local()


def carry_out(task: bytes) -> Answer:
    """Carry out a task in this thread's process; its failure is an answer, not an exception.

    Task and value stay packed here, so that the worker imports nothing of what they need: that
    takes 200 MB.
    """
    try:
        return Answer(_process().call(_unpacked, task, timeout_s=LONGEST_S))
    except HarnessError as error:
        return Answer(failed=str(error))


def _unpacked(task: bytes) -> bytes:
    function, arguments = pickle.loads(task)
    return pickle.dumps(function(*arguments))


def _process() -> Worker:
    worker: Worker | None = getattr(_own, "worker", None)
    if worker is None:
        from harness.measuring.worker import Worker  # what has no crew does without

        # Dask starts its workers as daemons, which may have no processes of their own; there
        # is no public way to say that these end with their parent.
        multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
        worker = _own.worker = Worker("the part's process")
        atexit.register(worker.close, at_once=True)
    return worker
