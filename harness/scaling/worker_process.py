"""What happens inside a Dask worker: each of its threads has a process of its own for the tasks.

A task that crashes costs that process, not the worker, so that it is known which one it was.
Killing the worker kills the process, too (on Linux), and says nothing about the task.
"""

from __future__ import annotations

import atexit
import multiprocessing
import pickle
import threading

from harness.errors import HarnessError
from harness.measuring.worker import Worker
from harness.scaling.task_queue import Answer

LONGEST_S = 3600.0
"""Seconds after which a task is stopped, and counts as failed."""

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


def allow_children() -> None:
    """Let this process have processes of its own.

    Dask's nanny starts its workers as daemons, which may not; there is no public way to say that
    these end with their parent.
    """
    multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]


def _process() -> Worker:
    worker: Worker | None = getattr(_own, "worker", None)
    if worker is None:
        allow_children()
        worker = _own.worker = Worker("the part's process")
        atexit.register(worker.close, at_once=True)
    return worker
