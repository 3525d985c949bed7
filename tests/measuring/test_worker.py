"""A worker's crash, hang or error costs one task, and says what happened."""

from __future__ import annotations

import ctypes
import os
import sys
import time
from pathlib import Path

import pytest

from harness.errors import NoRasteriser
from harness.measuring.worker import TaskFailed, Worker


def environment_of(name: str) -> tuple[str | None, int]:
    return os.environ.get(name), os.getpid()


def shout_and_die() -> None:
    sys.stderr.write("driver: lost the device\n")
    sys.stderr.flush()
    ctypes.string_at(0)


def sleep(seconds: float) -> None:
    time.sleep(seconds)


def raise_value_error() -> None:
    raise ValueError("two\nlines")


def raise_no_rasteriser() -> None:
    raise NoRasteriser("no such device")


def leave_a_grandchild_file(path: str) -> None:
    Path(path).write_text(str(os.getpid()))
    time.sleep(60)


@pytest.fixture(scope="module")
def worker():
    with Worker("the test worker", {"MOCK_SETTING": "17"}) as started:
        yield started


def test_tasks_run_in_one_process_with_its_own_environment(worker):
    first = worker.call(environment_of, "MOCK_SETTING")
    assert first[0] == "17"
    assert first == worker.call(environment_of, "MOCK_SETTING")
    assert first[1] != os.getpid()
    assert "MOCK_SETTING" not in os.environ


def test_a_crash_is_named_with_the_last_output_and_the_next_task_runs(worker):
    with pytest.raises(TaskFailed, match=r"died: SIGSEGV; last output: .*lost the device"):
        worker.call(shout_and_die)
    assert worker.call(environment_of, "MOCK_SETTING")[0] == "17"


def test_a_hang_is_stopped(worker):
    start = time.monotonic()
    with pytest.raises(TaskFailed, match=r"ran past 0\.5 s and was stopped"):
        worker.call(sleep, 60.0, timeout_s=0.5)
    assert time.monotonic() - start < 20


def test_an_error_is_one_line(worker):
    with pytest.raises(TaskFailed, match=r"^ValueError: two lines$"):
        worker.call(raise_value_error)


def test_an_error_of_the_harness_keeps_its_kind(worker):
    with pytest.raises(NoRasteriser, match="no such device"):
        worker.call(raise_no_rasteriser)


def test_ticks_say_how_long_it_takes(worker):
    waited: list[float] = []
    worker.call(sleep, 0.5, tick=waited.append)
    assert waited == sorted(waited)
    assert waited
