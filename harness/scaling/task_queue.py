"""Keeps a crew busy with tasks, a few at a time, and counts what fails.

A task may be carried out more than once: when the process that had it is killed. So its result has
to be the same each time, and to be kept under one name.

Inside a worker each of its threads has a process of its own for the tasks. A task that crashes
costs that process, not the worker, so that it is known which one it was. Killing the worker kills
the process, too (on Linux), and says nothing about the task.
"""

from __future__ import annotations

import atexit
import multiprocessing
import pickle
import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from harness.errors import HarnessError

if TYPE_CHECKING:
    from harness.measuring.worker import Worker

ATTEMPTS = 3
"""Times that a task may fail, by itself, before it is set aside."""

POLL_S = 0.5
"""Longest wait for the next task that ends."""

Task = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function and its arguments."""


@dataclass(frozen=True)
class Answer:
    """What became of a task.

    value : what it returned, where it ended well
    failed : why it failed, "" where it did not
    """

    value: Any = None
    failed: str = ""


class Crew:
    """Carries out tasks in this very process, one after another; others do it elsewhere.

    threads_each : threads that a task may use; one for each core if None
    """

    threads_each: int | None = None

    def __init__(self) -> None:
        self._waiting: deque[tuple[str, Task]] = deque()

    @property
    def room(self) -> int:
        """How many tasks it may have at a time."""
        return 1

    def start(self, name: str, task: Task) -> None:
        """Begin a task; raises HarnessError. Here `ended` carries it out."""
        self._waiting.append((name, task))

    def ended(self, timeout_s: float) -> list[tuple[str, Answer]]:  # noqa: ARG002 - others wait
        """Return tasks that ended since the last call; raises HarnessError."""
        if not self._waiting:
            return []
        name, (function, arguments) = self._waiting.popleft()
        try:
            return [(name, Answer(function(*arguments)))]
        except HarnessError as error:
            return [(name, Answer(failed=str(error)))]

    def close(self) -> None:
        """Give back what it has taken."""


def work_through(
    tasks: Mapping[str, Task], crew: Crew, done: Callable[[str, Any], None]
) -> dict[str, str]:
    """Carry out all tasks; return those that were set aside, and why.

    done : told of each task that ended well, and its value, as soon as it did

    Raises
    ------
    HarnessError
        if the crew cannot go on; what was done is done
    """
    waiting = deque(tasks)
    running: set[str] = set()
    failures: Counter[str] = Counter()
    aside: dict[str, str] = {}
    while waiting or running:
        while waiting and len(running) < crew.room:
            name = waiting.popleft()
            running.add(name)
            crew.start(name, tasks[name])
        for name, answer in crew.ended(POLL_S):
            running.remove(name)
            if not answer.failed:
                done(name, answer.value)
                continue
            failures[name] += 1
            if failures[name] < ATTEMPTS:
                waiting.append(name)
            else:
                aside[name] = answer.failed
    return aside


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
