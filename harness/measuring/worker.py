"""A process of its own for whatever may crash, hang or need its own environment.

One `Worker` is one process, started anew after it died. Tasks are plain module-level functions;
what they need more than once (an open device) they keep in a module global of that process.

A task may be anybody's code, so nothing here trusts it: it may exit, be killed, fork, or raise what
is no `Exception`. Whether the process lives is asked of the system, not of a pipe, for a process
that was forked off would keep a pipe open; and its whole process group ends with it.
"""

from __future__ import annotations

import contextlib
import ctypes
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Protocol, TypeVar

from harness.errors import HarnessError

T = TypeVar("T")

OUTPUT_LINES = 5
"""How many of the last lines that a process printed a failure's reason quotes."""

POLL_S = 0.1
"""How often a waiting caller is told how long it has waited."""

START_S = 120.0
"""Longest that a process may take to start; its imports take seconds, more on a busy machine."""

END_S = 2.0
"""Longest that a process may take to end when asked to."""


class TaskFailed(HarnessError):  # noqa: N818 - says what happened
    """A task crashed, hung or raised; the message says which and quotes its last output.

    detail : the traceback in the worker, "" where there is none
    """

    detail = ""


class TaskTimedOut(TaskFailed):
    """A task ran past its time and was stopped."""


class Executor(Protocol):
    """Runs a function somewhere and waits for its result."""

    def call(
        self,
        function: Callable[..., T],
        *arguments: Any,
        timeout_s: float | None = None,
        tick: Callable[[float], None] | None = None,
    ) -> T:
        """Return `function(*arguments)`; raise TaskFailed where it crashes or hangs."""
        ...

    def close(self) -> None:
        """End the process, if there is one."""
        ...


class Inline:
    """Runs tasks in this very process: for tests, and for debugging with a debugger."""

    def call(
        self,
        function: Callable[..., T],
        *arguments: Any,
        timeout_s: float | None = None,  # noqa: ARG002 - nothing can interrupt an inline call
        tick: Callable[[float], None] | None = None,  # noqa: ARG002
    ) -> T:
        """Return `function(*arguments)`; errors other than HarnessError become TaskFailed."""
        try:
            return function(*arguments)
        except (HarnessError, KeyboardInterrupt):
            raise
        except BaseException as error:
            raise _failure(error) from error

    def close(self) -> None:
        """Nothing to end."""


class Worker:
    """One spawned process with its own environment; tasks run in it one after another.

    Parameters
    ----------
    name : shown in messages
    environment : variables set in the process before any task runs
    memory_bytes : what the process may allocate, so that a greedy one cannot starve the machine

    The process ends with the thread that made the worker, if that dies.
    """

    def __init__(
        self,
        name: str,
        environment: Mapping[str, str] | None = None,
        memory_bytes: int | None = None,
    ) -> None:
        self.name = name
        with tempfile.NamedTemporaryFile(prefix="harness-output-", delete=False) as file:
            self._output = Path(file.name)
        self._settings = (os.getpid(), str(self._output), dict(environment or {}), memory_bytes)
        self._process: SpawnProcess | None = None
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

        `tick` is called every tenth of a second with the seconds waited. The time that the process
        takes to start does not count.

        Raises
        ------
        TaskFailed
            if the process dies, at once, or the function raises
        TaskTimedOut
            if it runs past `timeout_s`; it is killed
        HarnessError
            as the function raised it
        """
        if self._process is None:
            self._start()
        written = self._output.stat().st_size
        self._receive(written, START_S, None)
        try:
            self._connection.send((function, arguments))
        except OSError:
            self._died(written)
        done, result = self._receive(written, timeout_s, tick)
        # What comes next waits for the process to be ready, as after a start.
        if done:
            value: T = result
            return value
        raise result

    def close(self) -> None:
        """End the process and whatever it started."""
        self._end()
        self._output.unlink(missing_ok=True)

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        arguments = (theirs, *self._settings)
        self._process = context.Process(target=_serve, args=arguments, daemon=True)
        self._process.start()
        theirs.close()

    def _receive(
        self, written: int, timeout_s: float | None, tick: Callable[[float], None] | None
    ) -> Any:
        """Wait for what the process sends next."""
        assert self._process is not None
        start = time.monotonic()
        while not self._connection.poll(POLL_S):
            waited = time.monotonic() - start
            # It may have answered and died since: then there is something to read.
            if self._process.exitcode is not None and not self._connection.poll(0):
                self._died(written)
            if timeout_s is not None and waited > timeout_s:
                self._end(at_once=True)
                reason = f"{self.name} ran past {timeout_s:g} s and was stopped"
                raise TaskTimedOut(self._quote(reason, written))
            if tick:
                tick(waited)
        try:
            return self._connection.recv()
        except (EOFError, OSError):
            self._died(written)
        except Exception as error:
            raise TaskFailed(
                f"{self.name}: its result cannot be read: {_one_line(error)}"
            ) from error

    def _died(self, written: int) -> NoReturn:
        assert self._process is not None
        self._process.join(END_S)
        code = self._process.exitcode
        self._end(at_once=True)
        raise TaskFailed(self._quote(f"{self.name} died: {_explain_exit(code)}", written))

    def _end(self, *, at_once: bool = False) -> None:
        """End the process, and every process that it started and left."""
        process, self._process = self._process, None
        if process is None or process.pid is None:
            return
        if not at_once:
            with contextlib.suppress(OSError):
                self._connection.send(None)
            process.join(END_S)
        # The group's number is the process's, which made it; it may have died before it did.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.kill()
        process.join()
        self._connection.close()

    def _quote(self, reason: str, written: int) -> str:
        with contextlib.suppress(OSError), self._output.open("rb") as file:
            file.seek(written)
            lines = file.read().decode(errors="replace").strip().splitlines()[-OUTPUT_LINES:]
            if lines:
                return f"{reason}; last output: {' | '.join(line.strip() for line in lines)}"
        return reason

    def __enter__(self) -> Worker:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def _serve(
    connection: Connection,
    parent: int,
    output: str,
    environment: Mapping[str, str],
    memory_bytes: int | None,
) -> None:
    """Run tasks until there are no more; the process's main function.

    Sends None when it is ready for a task, then (True, result) or (False, error).
    """
    _prepare(parent, output, environment, memory_bytes)
    own = os.getpid()
    answer: tuple[bool, Any]
    while True:
        connection.send(None)
        try:
            task = connection.recv()
            if task is None:
                break
            function, arguments = task
            answer = (True, function(*arguments))
        except EOFError:
            break
        except HarnessError as error:
            answer = (False, error)
        except BaseException as error:  # a task's sys.exit must not end the run
            answer = (False, _failure(error))
        if os.getpid() != own:  # forked off by the task; its parent answers
            os._exit(0)
        try:
            connection.send(answer)
        except Exception as error:
            connection.send((False, TaskFailed(f"its result cannot be sent: {_one_line(error)}")))
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(0)  # drivers' and others' clean-up may crash, or wait for ever


def _prepare(
    parent: int, output: str, environment: Mapping[str, str], memory_bytes: int | None
) -> None:
    """Prepare a fresh process before its first task."""
    os.environ.update(environment)
    if memory_bytes is not None:
        resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    # A group of its own: what it starts can be ended with it, and Ctrl-C goes to the parent alone,
    # which decides what it means.
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _die_with(parent)
    descriptor = os.open(output, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    for stream, number in ((sys.__stdout__, 1), (sys.__stderr__, 2)):
        os.dup2(descriptor, stream.fileno() if stream else number)
    os.close(descriptor)


def _die_with(parent: int) -> None:
    """Have the kernel end this process when its parent is killed; Linux only."""
    if sys.platform != "linux":
        return
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)
    if os.getppid() != parent:  # it died before the call above
        os._exit(1)


def _explain_exit(code: int | None) -> str:
    if code is not None and code < 0:
        name = signal.Signals(-code).name
        hint = " (perhaps out of memory)" if -code == signal.SIGKILL else ""
        return f"{name}{hint}"
    return f"exit code {code}"


def _failure(error: BaseException) -> TaskFailed:
    """Return what is told of an error of a task."""
    if isinstance(error, MemoryError):
        return TaskFailed("it ran out of memory")
    failure = TaskFailed(_one_line(error))
    failure.detail = "".join(traceback.format_exception(error))
    return failure


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
