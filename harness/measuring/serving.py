"""The inside of a worker process: it runs tasks one after another and answers what came of them."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import traceback
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import Any

from harness.errors import HarnessError
from harness.machine import system


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
    memory_bytes: int | None,
) -> None:
    """Run tasks until there are no more; the process's main function.

    parent : whose child this process is meant to be, None if that is the server
    environment : all variables of the process

    Sends None when it is ready for a task, None again when it has read one and what that needs is
    imported, then (True, result) or (False, error).
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
            connection.send(None)
            answer = (True, function(*arguments))
        except EOFError:
            break
        except HarnessError as error:
            answer = (False, error)
        except BaseException as error:  # a task's sys.exit must not end the run
            answer = (False, failure(error))
        if os.getpid() != own:  # forked off by the task; its parent answers
            os._exit(0)
        try:
            connection.send(answer)
        except Exception as error:
            connection.send((False, TaskFailed(f"its result cannot be sent: {one_line(error)}")))
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    os._exit(0)  # drivers' and others' clean-up may crash, or wait for ever


def _prepare(
    parent: int | None, output: str, environment: Mapping[str, str], memory_bytes: int | None
) -> None:
    """Prepare a fresh process before its first task."""
    os.environ.clear()
    os.environ.update(environment)
    if memory_bytes is not None:
        system.limit_memory(memory_bytes)
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


def failure(error: BaseException) -> TaskFailed:
    """Return what is told of an error of a task."""
    if isinstance(error, MemoryError):
        return TaskFailed("it ran out of memory")
    failure = TaskFailed(one_line(error))
    failure.detail = "".join(traceback.format_exception(error))
    return failure


def one_line(error: BaseException) -> str:
    """Return an error's kind and message in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
