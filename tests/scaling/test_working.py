"""Tasks, attempts and losses, on a crew whose moves are written down."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable

import pytest

from harness.errors import UsageError
from harness.scaling.task_queue import (
    ATTEMPTS,
    LOSSES,
    Answer,
    Crew,
    SchedulerLost,
    Task,
    work_through,
)

NAMES = [f"task {number}" for number in range(20)]


class Scripted:
    """Answers as it is told to; notes how many tasks it ever had at a time."""

    room = 4
    threads_each = 1

    def __init__(self, answer: Callable[[str, int], Answer | None]) -> None:
        self._answer = answer
        self._has: deque[str] = deque()
        self.begun: Counter[str] = Counter()
        self.reconnected = 0
        self.most = 0

    def start(self, name: str, task: Task) -> None:
        self.begun[name] += 1
        self._has.append(name)
        self.most = max(self.most, len(self._has))

    def ended(self, timeout_s: float) -> list[tuple[str, Answer]]:
        name = self._has.popleft()
        answer = self._answer(name, self.begun[name])
        if answer is None:
            raise SchedulerLost
        return [(name, answer)]

    def reconnect(self) -> None:
        self.reconnected += 1
        self._has.clear()

    def close(self) -> None:
        pass


def tasks() -> dict[str, Task]:
    return {name: (str, (name,)) for name in NAMES}


def carried_out(answer: Callable[[str, int], Answer | None]):
    crew, done = Scripted(answer), Counter()
    aside = work_through(tasks(), crew, lambda name, value: done.update([name]))
    return crew, done, aside


def test_every_task_ends_once_and_few_wait_at_a_time():
    crew, done, aside = carried_out(lambda name, time: Answer(name))
    assert done == Counter(NAMES)
    assert aside == {}
    assert crew.most == Scripted.room
    assert crew.begun == Counter(NAMES)


def test_a_task_that_fails_is_set_aside_after_three_attempts_of_its_own():
    bad = Answer(failed="died: SIGSEGV")
    crew, done, aside = carried_out(lambda name, time: bad if name == NAMES[3] else Answer())
    assert aside == {NAMES[3]: "died: SIGSEGV"}
    assert crew.begun[NAMES[3]] == ATTEMPTS
    assert done == Counter(set(NAMES) - {NAMES[3]})
    assert all(crew.begun[name] == 1 for name in done)


def test_a_task_that_fails_twice_and_then_works_is_done():
    bad = Answer(failed="no space")
    _, done, aside = carried_out(lambda name, time: bad if time < ATTEMPTS else Answer())
    assert aside == {}
    assert done == Counter(NAMES)


def test_workers_that_die_under_a_task_do_not_count_as_its_failures():
    lost = Answer(failed="the workers died", lost=True)
    crew, done, aside = carried_out(lambda name, time: lost if time < LOSSES else Answer())
    assert aside == {}
    assert done == Counter(NAMES)
    crew, done, aside = carried_out(lambda name, time: lost if name == NAMES[0] else Answer())
    assert aside == {NAMES[0]: "the workers died"}
    assert crew.begun[NAMES[0]] == LOSSES


def test_a_scheduler_that_is_lost_costs_what_it_had_and_no_more():
    lost_at = {NAMES[5]: 1, NAMES[11]: 1, NAMES[12]: 2}
    crew, done, aside = carried_out(
        lambda name, time: None if lost_at.get(name) == time else Answer()
    )
    assert aside == {}
    assert done == Counter(NAMES)
    assert crew.reconnected == 3
    assert crew.begun[NAMES[4]] == 1


def test_an_answer_that_nobody_waits_for_counts_for_nothing(monkeypatch):
    """As it comes twice, or from a queue that was given up while tasks of it were running."""
    ended = Scripted.ended
    others = [(name, Answer()) for name in ("of another queue", NAMES[0])]
    monkeypatch.setattr(Scripted, "ended", lambda *given: ended(*given) * 2 + others)
    _, done, aside = carried_out(lambda name, time: Answer())
    assert aside == {}
    assert done == Counter(NAMES)


def test_a_scheduler_that_does_not_come_back_ends_it(monkeypatch):
    crew = Scripted(lambda name, time: None)

    def gone() -> None:
        raise UsageError("no scheduler")

    monkeypatch.setattr(crew, "reconnect", gone)
    with pytest.raises(UsageError, match="no scheduler"):
        work_through(tasks(), crew, lambda name, value: None)


def test_alone_a_failure_is_an_answer_and_a_defect_is_not():
    def bad(name: str) -> None:
        raise UsageError(name)

    def worse(name: str) -> None:
        raise ZeroDivisionError

    assert work_through({"a": (bad, ("why",))}, Crew(), lambda *_: None) == {"a": "why"}
    with pytest.raises(ZeroDivisionError):
        work_through({"a": (worse, ("why",))}, Crew(), lambda *_: None)
