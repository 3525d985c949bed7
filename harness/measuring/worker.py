"""A process of its own for whatever may crash, hang or need its own environment.

One `Worker` is one process, started anew after it died. Tasks are plain module-level functions;
what they need more than once (an open device) they keep in a module global of that process.
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
from collections.abc import Callable, Mapping
from concurrent.futures import TimeoutError as FutureTimeoutError
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, TypeVar

from pebble import ProcessExpired, ProcessPool

from harness.errors import HarnessError

T = TypeVar("T")

STDERR_LINES = 5
"""How many of the last lines on standard error a failure's reason quotes."""

POLL_S = 0.1
"""How often a waiting caller is told how long it has waited."""


class TaskFailed(HarnessError):  # noqa: N818 - says what happened
    """A task crashed, hung or raised; the message says which and quotes its last output."""


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
        except HarnessError:
            raise
        except Exception as error:
            raise TaskFailed(_one_line(error)) from error

    def close(self) -> None:
        """Nothing to end."""


class Worker:
    """One spawned process with its own environment; tasks run in it one after another.

    Parameters
    ----------
    name : shown in messages
    environment : variables set in the process before any task runs
    memory_bytes : what the process may allocate, so that a greedy one cannot starve the machine
    """

    def __init__(
        self,
        name: str,
        environment: Mapping[str, str] | None = None,
        memory_bytes: int | None = None,
    ) -> None:
        self.name = name
        with tempfile.NamedTemporaryFile(prefix="harness-stderr-", delete=False) as file:
            self._stderr = Path(file.name)
        self._pool = ProcessPool(
            max_workers=1,
            context=multiprocessing.get_context("spawn"),
            initializer=_start,
            initargs=(os.getpid(), str(self._stderr), dict(environment or {}), memory_bytes),
        )

    def call(
        self,
        function: Callable[..., T],
        *arguments: Any,
        timeout_s: float | None = None,
        tick: Callable[[float], None] | None = None,
    ) -> T:
        """Run `function(*arguments)` in the process and return its result.

        `tick` is called every tenth of a second with the seconds waited.

        Raises
        ------
        TaskFailed
            if the process dies or the function raises
        TaskTimedOut
            if it runs past `timeout_s`; it is killed
        HarnessError
            as the function raised it
        """
        written = self._stderr.stat().st_size
        future = self._pool.schedule(function, args=arguments, timeout=timeout_s)
        waited = 0.0
        while True:
            try:
                return future.result(timeout=POLL_S)
            except FutureTimeoutError as error:
                if future.done():
                    reason = f"{self.name} ran past {timeout_s:g} s and was stopped"
                    raise TaskTimedOut(self._quote(reason, written)) from error
                waited += POLL_S
                if tick:
                    tick(waited)
            except ProcessExpired as error:
                reason = f"{self.name} died: {_explain_exit(error.exitcode)}"
                raise TaskFailed(self._quote(reason, written)) from error
            except HarnessError:
                raise
            except MemoryError as error:
                raise TaskFailed(f"{self.name} ran out of memory") from error
            except Exception as error:
                raise TaskFailed(_one_line(error)) from error

    def close(self) -> None:
        """End the process."""
        self._pool.stop()
        self._pool.join()
        self._stderr.unlink(missing_ok=True)

    def _quote(self, reason: str, written: int) -> str:
        with contextlib.suppress(OSError), self._stderr.open("rb") as file:
            file.seek(written)
            lines = file.read().decode(errors="replace").strip().splitlines()[-STDERR_LINES:]
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


def _start(
    parent: int, stderr: str, environment: Mapping[str, str], memory_bytes: int | None
) -> None:
    """Prepare a fresh process before its first task."""
    os.environ.update(environment)
    if memory_bytes is not None:
        resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    # Ctrl-C goes to the whole group; only the parent decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _die_with(parent)
    descriptor = os.open(stderr, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    os.dup2(descriptor, sys.__stderr__.fileno() if sys.__stderr__ else 2)
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


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
