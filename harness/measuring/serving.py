"""The server that worker processes are forked from, and the inside of a worker.

The server has imported everything once, and loads no driver: a worker that starts from nothing
takes two seconds for imports and compiled code; one that is forked has both. Python's forkserver
makes the server, which ends with the process that started it. Where there is no safe fork (macOS,
Windows) workers start from nothing.

A worker runs tasks one after another and answers what came of them. Where others' code runs, there
are two processes: one that only waits, and its child, in which the tasks run. What a task does to
its parent it does to that one, and not to the server, from which all other workers are forked.
"""

import ctypes
import errno
import gc
import multiprocessing
import os
import signal
import sys
import traceback
import warnings
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
from triangulators.errors import MOST_TRACED, in_short, shortened

MARK = "RASTER_HARNESS_SERVER"
"""Set in the environment of the server, so that this module knows where it is imported."""

PRELOADED = "harness.measuring.serving"
"""What the server imports before it forks any worker."""

SOURCES = str(Path(__file__).resolve().parents[2])


def wake() -> None:
    """Let the server go on if something has stopped it; nothing could be started or ended else."""
    server = getattr(forkserver._forkserver, "_forkserver_pid", None)
    if server is not None:
        with suppress(ProcessLookupError):
            os.kill(server, signal.SIGCONT)


def start() -> ForkServerContext | SpawnContext:
    """Start the server, if none runs, without waiting for it; return what makes processes."""
    if sys.platform != "linux" or not hasattr(os, "fork"):
        return multiprocessing.get_context("spawn")
    paths = (SOURCES, os.environ.get("PYTHONPATH", ""))
    own = {
        MARK: "1",
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "PYTHONSAFEPATH": "1",  # what lies in the current folder is not the server's
        # Libraries would start threads as they load, which a fork does not take along.
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    before = {name: os.environ.get(name) for name in own}
    os.environ.update(own)
    try:
        multiprocessing.set_forkserver_preload([PRELOADED])
        wake()
        resource_tracker.ensure_running()  # which unblocks what is blocked
        # Until it is in a group of its own, the server holds back what a terminal sends to all.
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        forkserver.ensure_running()
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
    return multiprocessing.get_context("forkserver")


@dataclass(frozen=True)
class Limits:
    """That others' code runs in a process, and what it may take.

    memory_bytes : what it may allocate, so that a greedy one cannot starve the machine; None for
        any, as drivers map more than they use
    file_bytes : how large a file it may write, what it prints included
    """

    memory_bytes: int | None = None
    file_bytes: int = 256 << 20


class TaskFailed(HarnessError):  # noqa: N818 - says what happened
    """A task crashed, hung or raised; the message says which and quotes its last output.

    detail : the traceback in the worker, "" where there is none
    """

    detail = ""


class TaskTimedOut(TaskFailed):
    """A task ran past its time and was stopped."""


def serve(
    connection: Connection,
    output: str,
    environment: Mapping[str, str],
    limits: Limits | None,
) -> None:
    """Run tasks until there are no more; the process's main function.

    environment : all variables of the process
    limits : None if only code of ours runs in it

    Sends None when it is ready for a task, None again when it has read one and what that needs is
    imported, then (True, result) or (False, error).
    """
    _prepare(output, environment, limits)
    if limits is not None and sys.platform == "linux":
        _wait_for_child(connection)
    own = os.getpid()
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
            answer = (False, error if limits is None else _of_ours(error))
        except BaseException as error:  # a task's sys.exit must not end the run
            answer = (False, failure(error))
        if os.getpid() != own:  # forked off by the task; its parent answers
            os._exit(0)
        try:
            connection.send(answer)
        except Exception as error:
            connection.send((False, TaskFailed(f"its result cannot be sent: {in_short(error)}")))
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    os._exit(0)  # drivers' and others' clean-up may crash, or wait for ever


def _prepare(output: str, environment: Mapping[str, str], limits: Limits | None) -> None:
    """Prepare a fresh process before its first task."""
    os.environ.clear()
    os.environ.update(environment)
    if limits is not None:
        system.limit(limits.memory_bytes, limits.file_bytes)
    # A group of its own: what it starts can be ended with it, and Ctrl-C goes to the parent alone,
    # which decides what it means.
    system.lead_group()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _die_with(os.getppid())
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


def _wait_for_child(connection: Connection) -> None:
    """Go on in a child of this process; this one waits for it, and ends as it does."""
    waiting = os.getpid()
    child = os.fork()
    if child == 0:
        _die_with(waiting)
        return
    connection.close()  # whoever holds it would keep it open
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        system.leave_no_core()
        with suppress(OSError):  # nobody can have another answer to SIGKILL
            signal.signal(-code, signal.SIG_DFL)
        os.kill(waiting, -code)
    os._exit(abs(code))


def _of_ours(error: HarnessError) -> HarnessError:
    """Return an error that others' code may have raised or worded as one of ours, in short."""
    kind = type(error) if type(error).__module__.startswith("harness.") else TaskFailed
    return kind(shortened(str(error)))


def failure(error: BaseException) -> TaskFailed:
    """Return what is told of an error of a task."""
    if isinstance(error, MemoryError):
        return TaskFailed("it ran out of memory")
    if isinstance(error, OSError) and error.errno == errno.EFBIG:
        return TaskFailed("it printed, or wrote into a file, more than is let")
    failure = TaskFailed(in_short(error))
    failure.detail = "".join(traceback.format_exception(error))[:MOST_TRACED]
    return failure


def _preload() -> None:
    """Load into the server what workers need, so that they begin with it."""
    # In a group of its own: what a terminal sends to the command is not meant for the server,
    # which ends when the command does.
    system.lead_group()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # What a task starts in a session of its own comes to the server when its worker ends.
    system.adopt()
    warnings.filterwarnings("ignore", message="forkserver: waitpid returned unexpected pid")
    from harness.measuring import tasks  # noqa: F401 - for the workers
    from harness.settings import DEFAULT_TRIANGULATORS
    from harness.triangulating.recipes import parse
    from harness.triangulating.triangulate import warm_up
    from triangulators import many  # noqa: F401 - for the workers
    from triangulators.compute.storing import NotKept, only_kept

    with suppress(NotKept), only_kept():  # on a new machine nothing is compiled yet
        for name in DEFAULT_TRIANGULATORS:
            warm_up(parse(name))
    # Workers collect only what they make: walking over what they share would copy its pages.
    gc.freeze()


if os.environ.pop(MARK, None):
    _preload()
