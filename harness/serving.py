"""The fork server of worker processes, and the main loop of a worker.

The server has imported all modules, and loads no driver, so a forked worker saves two seconds of
imports and of loading compiled code. The server ends with the process that started it. On systems
without a safe fork (macOS, Windows) workers start from scratch.

A worker for third-party code has two processes: one only waits, and its child runs the tasks. So a
task that kills or suspends its parent does not affect the server.
"""

import errno
import multiprocessing
import os
import signal
import sys
import traceback
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext, SpawnContext
from pathlib import Path
from typing import Any

from harness.errors import HarnessError
from harness.machine import system
from harness.machine.process import start_log
from triangulators.errors import MAX_TRACEBACK, summarize_error, truncate

MARK = "RASTER_HARNESS_SERVER"  # environment variable that only the server has, read by `PRELOADED`
PRELOADED = "harness.measuring.tasks"  # module that the server imports before a fork

SOURCES = str(Path(__file__).resolve().parents[1])


def wake_server() -> None:
    """Resume the server, as a suspended server cannot start or end processes."""
    server = getattr(forkserver._forkserver, "_forkserver_pid", None)
    if server is not None:
        with suppress(ProcessLookupError):
            os.kill(server, signal.SIGCONT)


def start_server() -> ForkServerContext | SpawnContext:
    """Start the server unless it runs; return multiprocessing's context that starts workers."""
    if sys.platform != "linux" or not hasattr(os, "fork"):
        return multiprocessing.get_context("spawn")
    paths = (SOURCES, os.environ.get("PYTHONPATH", ""))
    variables = {
        MARK: "1",
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "PYTHONSAFEPATH": "1",  # no modules of the current folder
        # Libraries would start threads on import, and a fork does not copy threads.
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    with system.set_variables(variables):
        multiprocessing.set_forkserver_preload([PRELOADED])
        wake_server()
        resource_tracker.ensure_running()  # before signals are blocked, as it unblocks them
        # Block Ctrl-C until the server has its own process group.
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        forkserver.ensure_running()
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    return multiprocessing.get_context("forkserver")


@dataclass(frozen=True)
class Limits:
    """Limits of a process in which third-party code runs.

    memory_bytes : maximum address space; None with a driver, which maps more memory than it uses
    file_bytes : maximum size of a written file, including the captured output
    """

    memory_bytes: int | None = None
    file_bytes: int = 256 << 20


class TaskError(HarnessError):
    """A task crashed, hung or raised an exception; `detail` is the traceback in the worker."""

    detail = ""


class TaskTimeoutError(TaskError):
    """A task exceeded its time limit and was killed."""


def serve(
    connection: Connection,
    output: str,
    environment: Mapping[str, str],
    limits: Limits | None,
) -> None:
    """Run the tasks received from `connection` until a task is None; main function of a worker.

    Sends None when ready for a task, None again after unpickling a task, then (True, result) or
    (False, error). `output` is a file for standard output and standard error, `environment` all
    variables of the process.
    """
    _set_up_process(output, environment, limits)
    if limits is not None and sys.platform == "linux":
        _wait_for_child(connection)
    pid = os.getpid()
    answer: tuple[bool, Any]
    while True:
        connection.send(None)
        try:
            task = connection.recv()
            if task is None:
                break
            function, arguments = task
            connection.send(None)
            answer = (True, function(*arguments))
        except EOFError:
            break
        except HarnessError as error:
            answer = (False, error if limits is None else _make_safe_error(error))
        except BaseException as error:  # a task's sys.exit must not end the run
            answer = (False, make_failure(error))
        if os.getpid() != pid:  # a fork made by the task; the parent answers
            os._exit(0)
        try:
            connection.send(answer)
        except Exception as error:
            connection.send(
                (False, TaskError(f"the result cannot be sent: {summarize_error(error)}"))
            )
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    os._exit(0)  # without clean-up, in which drivers and plugins may crash or hang


def _set_up_process(output: str, environment: Mapping[str, str], limits: Limits | None) -> None:
    os.environ.clear()
    os.environ.update(environment)
    if limits is not None:
        system.set_limits(limits.memory_bytes, limits.file_bytes)
    # A process group, so that descendants are killed as well and Ctrl-C reaches only the parent.
    system.start_process_group()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    system.end_with_parent(os.getppid())
    descriptor = os.open(output, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    for stream, number in ((sys.__stdout__, 1), (sys.__stderr__, 2)):
        os.dup2(descriptor, stream.fileno() if stream else number)
    os.close(descriptor)
    with suppress(OSError):
        start_log()


def _wait_for_child(connection: Connection) -> None:
    """Fork, and return in the child; this process waits for the child and ends in the same way."""
    waiting = os.getpid()
    child = os.fork()
    if child == 0:
        system.end_with_parent(waiting)
        return
    connection.close()  # an open copy would hide that the child has ended
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        system.disable_core_dump()
        with suppress(OSError):  # SIGKILL cannot be handled
            signal.signal(-code, signal.SIG_DFL)
        os.kill(waiting, -code)
    os._exit(abs(code))


def _make_safe_error(error: HarnessError) -> HarnessError:
    """Return an error of third-party code, truncated, as a class of the harness."""
    kind = type(error) if type(error).__module__.startswith("harness.") else TaskError
    return kind(truncate(str(error)))


def make_failure(error: BaseException) -> TaskError:
    """Return the `TaskError` that reports that a task raised `error`."""
    if isinstance(error, MemoryError):
        return TaskError("out of memory")
    if isinstance(error, OSError) and error.errno == errno.EFBIG:
        return TaskError("output limit exceeded (256 MiB)")
    failure = TaskError(summarize_error(error))
    failure.detail = "".join(traceback.format_exception(error))[:MAX_TRACEBACK]
    return failure
