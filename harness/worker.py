"""Worker processes for code that may crash, hang or require other environment variables.

A `Worker` has one process at a time, and starts another after a crash. Tasks are module-level
functions; state that outlives a task (an open device) is a module global of the worker process.

A task may be third-party code and is not trusted: it may exit, fork, raise a `BaseException`,
suspend its process, kill its parent (see `serving`), or print without end. Whether the process runs
is known from the operating system, because a child that the task forked keeps the pipe open. The
process group is killed with the process. A `WorkerPool` has workers by name.
"""

import atexit
import contextlib
import logging
import os
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, ClassVar, NoReturn, TypeVar

import psutil

from harness import serving
from harness.machine import system
from harness.machine.process import hide_working_folder
from harness.serving import Limits, TaskError, TaskTimeoutError
from triangulators.errors import summarize_error

__all__ = ["Limits", "OpenWorker", "TaskError", "TaskTimeoutError", "Worker"]

T = TypeVar("T")

_LOG = logging.getLogger(__name__)

MAX_OUTPUT_LINES = 5  # lines of a failed process's output in a message

MAX_OUTPUT_CHARACTERS = 500

SUSPENSION_CHECK_S = 4.0  # interval of checks; a process is killed if two find it suspended
POLL_S = 0.1  # interval at which a waiting caller's `tick` is called, or a signal handled
START_TIMEOUT_S = 120.0  # limit for starting a process; imports take seconds
END_TIMEOUT_S = 2.0  # limit for a process to end on request
MEMORY_SHARE = 0.75  # of the free memory, for a third party's triangulator
_STARTING = threading.Lock()  # held while this process's environment is changed to start another


class Worker:
    """A process with its own environment variables that runs tasks one after another.

    The process ends at the latest with the thread that constructed the worker. `limits` are for
    third-party code.
    """

    def __init__(
        self,
        name: str,
        environment: Mapping[str, str] | None = None,
        limits: Limits | None = None,
    ) -> None:
        self.name = name
        with tempfile.NamedTemporaryFile(prefix="harness-output-", delete=False) as file:
            self._output = Path(file.name)
        self._environment = dict(environment or {})
        self._limits = limits
        self._process: BaseProcess | None = None
        self._server: int | None = None
        self._written = 0  # bytes of output before the current task
        self._connection: Connection
        self._start()

    def call(
        self,
        function: Callable[..., T],
        *arguments: Any,
        timeout_s: float | None = None,
        tick: Callable[[float], None] | None = None,
    ) -> T:
        """Run `function(*arguments)` in the process and return its result.

        `tick` is called every tenth of a second with the seconds waited. `timeout_s` does not
        include the start of the process.

        Raises TaskError if the process crashes or the function raises (but a HarnessError unchanged
        if `limits` is None), and TaskTimeoutError after `timeout_s`; the process is then killed.
        """
        if self._process is not None and self._process.exitcode is not None:
            self._end(at_once=True)  # killed since its last task
        if self._process is None:
            self._start()
        self._written = self._output.stat().st_size
        self._receive(START_TIMEOUT_S, None)
        try:
            self._connection.send((function, arguments))
        except OSError:
            self._raise_crash()
        except Exception as error:
            # End the process: it has announced that it waits for a task, and will not do so again.
            self._end(at_once=True)
            raise TaskError(
                f"{self.name}: the task cannot be sent: {summarize_error(error)}"
            ) from error
        try:
            # Imports that unpickling the task triggers do not count as the task's time.
            answer = self._receive(START_TIMEOUT_S, None)
            if answer is None:
                answer = self._receive(timeout_s, tick)
        except KeyboardInterrupt:
            # End the process: the answer to this task would be taken for the next task's answer.
            self._end(at_once=True)
            raise
        succeeded, result = answer
        if succeeded:
            value: T = result
            return value
        raise result

    def close(self, *, at_once: bool = False) -> None:
        """End the process and its descendants."""
        self._end(at_once=at_once)
        with contextlib.suppress(OSError):  # Windows does not delete open files
            self._output.unlink(missing_ok=True)

    def _start(self) -> None:
        with _STARTING:
            context = serving.start_server()
            forked = context.get_start_method() == "forkserver"
            self._connection, child_end = context.Pipe()
            arguments = (
                child_end,
                str(self._output),
                # All variables, as the server's may be older than this process's.
                {**os.environ, **self._environment},
                self._limits,
            )
            self._process = context.Process(target=serving.serve, args=arguments, daemon=True)
            try:
                with hide_working_folder():  # which a new Python would search first
                    self._process.start()
            except (EOFError, OSError) as error:  # the fork server has ended
                self._process = None
                reason = summarize_error(error)
                raise TaskError(
                    f"{self.name}: no process can be started ({reason}); close other programs, or "
                    "allow more memory and processes (ulimit)"
                ) from error
            child_end.close()
        _LOG.info("%s: started process %s", self.name, self._process.pid)
        with contextlib.suppress(psutil.NoSuchProcess):  # the process has ended already
            self._server = psutil.Process(self._process.pid).ppid() if forked else None

    def _receive(self, timeout_s: float | None, tick: Callable[[float], None] | None) -> Any:
        """Return the process's next message; errors quote the output since the task began."""
        assert self._process is not None
        start = time.monotonic()
        next_check_s, suspended = SUSPENSION_CHECK_S, False
        while not self._connection.poll(POLL_S):
            waited = time.monotonic() - start
            if waited > next_check_s:
                next_check_s, before = waited + SUSPENSION_CHECK_S, suspended
                suspended = system.is_suspended(self._process.pid or 0)
                if suspended and before:
                    self._end(at_once=True)
                    self._raise_failure(f"{self.name} was suspended (SIGSTOP) and killed")
            # The process may have answered before it ended; then there is a message to read.
            if self._process.exitcode is not None and not self._connection.poll(0):
                self._raise_crash()
            if timeout_s is not None and waited > timeout_s:
                self._end(at_once=True)
                reason = f"{self.name} exceeded the time limit of {timeout_s:g} s and was killed"
                self._raise_failure(reason, TaskTimeoutError)
            if tick:
                tick(waited)
        try:
            return self._connection.recv()
        except (EOFError, OSError):
            self._raise_crash()
        except Exception as error:
            raise TaskError(
                f"{self.name}: the result cannot be read: {summarize_error(error)}"
            ) from error

    def _raise_crash(self) -> NoReturn:
        assert self._process is not None
        self._process.join(END_TIMEOUT_S)
        cause = system.describe_exit(self._process.exitcode)
        if self._server is not None and not system.is_running(self._server):
            cause = "the fork server was killed, by this process or another"
        self._end(at_once=True)
        self._raise_failure(f"{self.name} crashed: {cause}")

    def _raise_failure(self, reason: str, kind: type[TaskError] = TaskError) -> NoReturn:
        """Raise an error with the reason and the end of the task's output."""
        with contextlib.suppress(OSError), self._output.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(self._written, size - 4 * MAX_OUTPUT_CHARACTERS))
            lines = file.read().decode(errors="replace").strip().splitlines()[-MAX_OUTPUT_LINES:]
            text = " | ".join(line.strip() for line in lines)
            if text:
                ellipsis = "... " if len(text) > MAX_OUTPUT_CHARACTERS else ""
                reason += f"; last output: {ellipsis}{text[-MAX_OUTPUT_CHARACTERS:]}"
        _LOG.info("%s", reason)
        raise kind(reason)

    def _end(self, *, at_once: bool = False) -> None:
        process, self._process = self._process, None
        if process is None or process.pid is None:
            return
        if not at_once:
            with contextlib.suppress(OSError):
                self._connection.send(None)
            process.join(END_TIMEOUT_S)
        serving.wake_server()
        # The process leads its group, unless it ended before it could create one.
        system.kill_group(process.pid)
        process.kill()
        process.join()
        if self._server is not None:
            system.kill_orphans(self._server)
        self._connection.close()
        cause = system.describe_exit(process.exitcode)
        _LOG.info("%s: process %s ended, %s", self.name, process.pid, cause)

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


OpenWorker = Callable[[str, Mapping[str, str], Limits | None], Worker]  # signature of `Worker`

_shared = threading.local()


def get_shared_worker(name: str, limits: Callable[[], Limits] | None = None) -> Worker:
    """Return this thread's worker called `name`; start it on first use, end it at program exit."""
    workers: dict[str, Worker] = _shared.__dict__.setdefault("workers", {})
    if name not in workers:
        workers[name] = Worker(name, limits=limits() if limits else None)
        atexit.register(workers[name].close, at_once=True)
    return workers[name]


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

    @contextlib.contextmanager
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
