"""A process of its own for whatever may crash, hang or need its own environment.

One `Worker` is one process, started anew after it died. Tasks are plain module-level functions;
what they need more than once (an open device) they keep in a module global of that process.

A task may be anybody's code, so nothing here trusts it: it may exit, be killed, fork, or raise what
is no `Exception`. Whether the process lives is asked of the system, not of a pipe, for a process
that was forked off would keep a pipe open; and its whole process group ends with it. It may stop
its process or kill its parent, too (see `serving`), and print without an end.
"""

import contextlib
import os
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import psutil

from harness.machine import system
from harness.measuring import serving
from harness.measuring.serving import Limits, TaskFailed, TaskTimedOut
from triangulators.errors import in_short

__all__ = ["Limits", "OpenWorker", "TaskFailed", "TaskTimedOut", "Worker"]

T = TypeVar("T")

OUTPUT_LINES = 5
"""How many of the last lines that a process printed a failure's reason quotes."""

OUTPUT_CHARACTERS = 500
"""How many of the last characters, at most."""

STOPPED_S = 4.0
"""How often it is asked whether a process was stopped; after the second time it is ended."""

POLL_S = 0.1
"""How often a waiting caller is told how long it has waited."""

START_S = 120.0
"""Longest that a process may take to start; its imports take seconds, more on a busy machine."""

END_S = 2.0
"""Longest that a process may take to end when asked to."""


_STARTING = threading.Lock()
"""To start a process changes the environment of this one for a moment."""


class Worker:
    """One process with its own environment; tasks run in it one after another.

    Parameters
    ----------
    name : shown in messages
    environment : variables set in the process before any task runs
    limits : of a process in which others' code runs

    The process ends with the thread that made the worker, if that dies.
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
        if self._process is not None and self._process.exitcode is not None:
            self._end(at_once=True)  # something has killed it since its last task
        if self._process is None:
            self._start()
        written = self._output.stat().st_size
        self._receive(written, START_S, None)
        try:
            self._connection.send((function, arguments))
        except OSError:
            self._died(written)
        except Exception as error:
            # The process has said that it waits for a task, and would not say so again.
            self._end(at_once=True)
            raise TaskFailed(f"{self.name}: the task cannot be sent: {in_short(error)}") from error
        try:
            # What the task needs of the harness is imported first, which is not the task's time.
            answer = self._receive(written, START_S, None)
            if answer is None:
                answer = self._receive(written, timeout_s, tick)
        except KeyboardInterrupt:
            # What the process still sends would be taken for the next task's answer.
            self._end(at_once=True)
            raise
        done, result = answer
        if done:
            value: T = result
            return value
        raise result

    def close(self, *, at_once: bool = False) -> None:
        """End the process and whatever it started."""
        self._end(at_once=at_once)
        with contextlib.suppress(OSError):  # Windows deletes no file that somebody has open
            self._output.unlink(missing_ok=True)

    def _start(self) -> None:
        with _STARTING:
            context = serving.start()
            forked = context.get_start_method() == "forkserver"
            self._connection, theirs = context.Pipe()
            arguments = (
                theirs,
                str(self._output),
                # All of it: the server may have been started before this process changed its own.
                {**os.environ, **self._environment},
                self._limits,
            )
            self._process = context.Process(target=serving.serve, args=arguments, daemon=True)
            self._process.start()
            theirs.close()
        with contextlib.suppress(psutil.NoSuchProcess):  # it has died at once
            self._server = psutil.Process(self._process.pid).ppid() if forked else None

    def _receive(
        self, written: int, timeout_s: float | None, tick: Callable[[float], None] | None
    ) -> Any:
        """Wait for what the process sends next."""
        assert self._process is not None
        start = time.monotonic()
        asked, stopped = STOPPED_S, False
        while not self._connection.poll(POLL_S):
            waited = time.monotonic() - start
            if waited > asked:
                asked, before = waited + STOPPED_S, stopped
                stopped = system.is_stopped(self._process.pid or 0)
                if stopped and before:
                    self._end(at_once=True)
                    reason = f"{self.name} has stopped its process, or that which started it"
                    raise TaskFailed(self._quote(f"{reason} (SIGSTOP), and was ended", written))
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
                f"{self.name}: its result cannot be read: {in_short(error)}"
            ) from error

    def _died(self, written: int) -> NoReturn:
        assert self._process is not None
        self._process.join(END_S)
        how = system.ending(self._process.exitcode)
        if self._server is not None and not system.is_running(self._server):
            how = "with the process that starts all others, which it or another has killed"
        self._end(at_once=True)
        raise TaskFailed(self._quote(f"{self.name} died: {how}", written))

    def _end(self, *, at_once: bool = False) -> None:
        """End the process, and every process that it started and left."""
        process, self._process = self._process, None
        if process is None or process.pid is None:
            return
        if not at_once:
            with contextlib.suppress(OSError):
                self._connection.send(None)
            process.join(END_S)
        serving.wake()
        # The group's number is the process's, which made it; it may have died before it did.
        system.end_group(process.pid)
        process.kill()
        process.join()
        if self._server is not None:
            system.end_strays(self._server)
        self._connection.close()

    def _quote(self, reason: str, written: int) -> str:
        with contextlib.suppress(OSError), self._output.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(written, size - 4 * OUTPUT_CHARACTERS))
            lines = file.read().decode(errors="replace").strip().splitlines()[-OUTPUT_LINES:]
            text = " | ".join(line.strip() for line in lines)
            if text:
                cut = "... " if len(text) > OUTPUT_CHARACTERS else ""
                return f"{reason}; last output: {cut}{text[-OUTPUT_CHARACTERS:]}"
        return reason

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


OpenWorker = Callable[[str, Mapping[str, str], Limits | None], Worker]
"""Makes the processes of a run, as `Worker` does of its arguments."""
