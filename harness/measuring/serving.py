"""The inside of a worker process: it runs tasks one after another and answers what came of them.

Where others' code runs, there are two processes: one that only waits, and its child, in which the
tasks run. What a task does to its parent it does to that one, and not to the server, from which all
other workers are forked.
"""

from __future__ import annotations

import ctypes
import errno
import os
import signal
import sys
import traceback
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from harness.errors import HarnessError
from harness.machine import system
from triangulators.errors import MOST_TRACED, in_short, shortened


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
    parent: int | None,
    output: str,
    environment: Mapping[str, str],
    limits: Limits | None,
) -> None:
    """Run tasks until there are no more; the process's main function.

    parent : whose child this process is meant to be, None if that is the server
    environment : all variables of the process
    limits : None if only code of ours runs in it

    Sends None when it is ready for a task, None again when it has read one and what that needs is
    imported, then (True, result) or (False, error).
    """
    _prepare(parent, output, environment, limits)
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


def _prepare(
    parent: int | None, output: str, environment: Mapping[str, str], limits: Limits | None
) -> None:
    """Prepare a fresh process before its first task."""
    os.environ.clear()
    os.environ.update(environment)
    if limits is not None:
        system.limit(limits.memory_bytes, limits.file_bytes)
    # A group of its own: what it starts can be ended with it, and Ctrl-C goes to the parent alone,
    # which decides what it means.
    system.lead_group()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _die_with(parent)
    descriptor = os.open(output, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    for stream, number in ((sys.__stdout__, 1), (sys.__stderr__, 2)):
        os.dup2(descriptor, stream.fileno() if stream else number)
    os.close(descriptor)


def _die_with(parent: int | None) -> None:
    """Have the kernel end this process when its parent is killed; Linux only."""
    if sys.platform != "linux":
        return
    parent = parent or os.getppid()
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
