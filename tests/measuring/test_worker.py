"""A worker's crash, hang or error fails one task, with the reason."""

import ctypes
import os
import re
import signal
import sys
import time
from contextlib import nullcontext
from pathlib import Path

import psutil
import pytest

from harness.errors import NoRasteriserError
from harness.worker import Limits, TaskError, TaskTimeoutError, Worker
from tests.paths import run_python
from triangulators.errors import MAX_TRACEBACK

NO_SERVER = "elsewhere there is no fork server, and orphans are not adopted"
ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason=NO_SERVER)


def read_variable(name: str) -> tuple[str | None, int]:
    return os.environ.get(name), os.getpid()


def shout_and_die() -> None:
    sys.stderr.write("driver: lost the device\n")
    sys.stderr.flush()
    ctypes.string_at(0)


def raise_error(error: type[Exception], message: str) -> None:
    raise error(message)


def leave_a_child(path: str, code: int | None) -> int:
    """Fork a process that sleeps for long, then return, or end with an exit code."""
    if (child := os.fork()) == 0:
        time.sleep(3600)
    Path(path).write_text(str(child))
    if code is not None:
        os._exit(code)
    return 17


def leave_a_daemon(path: str, code: int | None) -> int:
    """Leave a sleeping orphan in a new session, then return, or end with an exit code."""
    if (child := os.fork()) == 0:
        os.setsid()
        leave_a_child(path, 0)
    os.waitpid(child, 0)
    if code is not None:
        os._exit(code)
    return 17


def fork_and_return() -> str:
    return "child" if os.fork() == 0 else "parent"


def return_local_function() -> object:
    return lambda: None


def print_and_die() -> None:
    os.write(1, b"first" + b"x" * 5_000_000 + b"\nlast")
    os._exit(1)


def print_for_ever() -> None:
    while True:
        sys.stdout.write("x" * (1 << 16))


class TheirError(NoRasteriserError):
    """A third-party error, which this process would have to import."""


def send_to(who: str, number: int) -> None:
    process = psutil.Process()
    if who != "itself":
        process = process.parent()
    if who == "the server":
        process = process.parent()
    process.send_signal(number)
    time.sleep(3600)


@pytest.fixture(scope="module")
def worker():
    with Worker("the test worker", {"MOCK_SETTING": "17"}) as started:
        yield started


def test_tasks_run_in_one_process_with_its_own_environment(worker):
    first = worker.call(read_variable, "MOCK_SETTING")
    assert first[0] == "17"
    assert first == worker.call(read_variable, "MOCK_SETTING")
    assert first[1] != os.getpid()
    assert "MOCK_SETTING" not in os.environ


def test_a_crash_is_reported_with_the_last_output(worker):
    with pytest.raises(TaskError, match=r"crashed: SIGSEGV; last output: .*lost the device"):
        worker.call(shout_and_die)
    assert worker.call(read_variable, "MOCK_SETTING")[0] == "17"


LONG = "x" * 5_000_000


@pytest.mark.parametrize(
    ("task", "arguments"),
    [(print_and_die, ()), (print_for_ever, ())]
    + [(raise_error, (error, LONG)) for error in (ValueError, TheirError)],
)
def test_output_and_errors_are_truncated(task, arguments):
    with Worker("a plugin", limits=Limits(file_bytes=10_000_000)) as printing:
        with pytest.raises(TaskError) as caught:
            printing.call(task, *arguments)
        assert len(str(caught.value)) < 800
        assert len(caught.value.detail) <= MAX_TRACEBACK
        assert printing._output.stat().st_size <= 10_000_000
        assert type(caught.value) is TaskError
    if task is print_and_die:
        assert "crashed: exit code 1; last output: ... x" in str(caught.value)
        assert str(caught.value).endswith("| last")


@ON_LINUX
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize("who", ["itself", "its parent", "the server"])
def test_a_plugin_that_signals_its_parents_fails_only_its_task(who, number, monkeypatch):
    monkeypatch.setattr("harness.worker.SUSPENSION_CHECK_S", 0.3)
    with Worker("a device") as other, Worker("a plugin", limits=Limits()) as killing:
        assert other.call(os.getpid) != killing.call(os.getpid)
        start = time.monotonic()
        limit_s = 1.0 if (who, number) == ("the server", signal.SIGSTOP) else 300.0
        reason = "crashed: SIGKILL" if number == signal.SIGKILL else "was suspended"
        if who == "the server":  # all workers end; a stopped server starts none
            killed = "crashed: the fork server was killed"
            reason = killed if limit_s > 1 else "exceeded the time limit"
        with pytest.raises(TaskError, match=f"^a plugin {reason}"):
            killing.call(send_to, who, number, timeout_s=limit_s)
        assert time.monotonic() - start < 10
        for worker in (other, killing):
            assert worker.call(read_variable, "MOCK_SETTING")[0] is None
        assert time.monotonic() - start < 60


def test_a_hang_is_stopped(worker):
    start = time.monotonic()
    with pytest.raises(TaskTimeoutError, match=r"exceeded the time limit of 0\.5 s and was killed"):
        worker.call(time.sleep, 60.0, timeout_s=0.5)
    assert time.monotonic() - start < 20


@pytest.mark.parametrize("code", [0, 3])
def test_errors_and_exits_are_reported_in_one_line(worker, code):
    with pytest.raises(TaskError, match=r"^ValueError: two lines$") as failure:
        worker.call(raise_error, ValueError, "two\nlines")
    assert "in raise_error" in failure.value.detail
    with pytest.raises(TaskError, match=rf"^SystemExit: {code}$"):
        worker.call(sys.exit, code)


def test_harness_errors_keep_their_class(worker):
    with pytest.raises(NoRasteriserError, match="no such device"):
        worker.call(raise_error, NoRasteriserError, "no such device")


def test_ticks_report_the_waiting_time(worker):
    waited: list[float] = []
    worker.call(time.sleep, 0.5, tick=waited.append)
    assert waited == sorted(waited)
    assert waited


def test_results_of_interrupted_tasks_are_discarded(worker):
    def interrupt(waited: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        worker.call(time.sleep, 5.0, tick=interrupt)
    assert worker.call(read_variable, "MOCK_SETTING")[0] == "17"


@pytest.mark.parametrize("code", [None, 1])
@pytest.mark.parametrize("leave", [leave_a_child, pytest.param(leave_a_daemon, marks=ON_LINUX)])
def test_child_processes_end_with_the_worker(tmp_path, leave, code):
    """The child has copies of all pipes; its parent answers or crashes. Other workers continue."""
    start = time.monotonic()
    with Worker("another") as other:
        ends = pytest.raises(TaskError, match="crashed: exit code 1") if code else nullcontext()
        with Worker("the forking worker") as forking, ends:
            assert forking.call(leave, str(tmp_path / "pid"), code, timeout_s=300) == 17
        assert time.monotonic() - start < 60
        child = int((tmp_path / "pid").read_text())
        for _ in range(600):  # it is killed, which may take the system some time
            status = psutil.pid_exists(child) and psutil.Process(child).status()
            if status in (False, psutil.STATUS_ZOMBIE):
                break
            time.sleep(0.1)
        else:
            pytest.fail("it lives on")
        assert other.call(read_variable, "MOCK_SETTING")[0] is None


def test_results_of_forked_children_are_ignored(worker):
    assert worker.call(fork_and_return) == "parent"
    time.sleep(0.2)
    assert worker.call(read_variable, "MOCK_SETTING")[0] == "17"


def test_output_of_tasks_is_not_printed(worker, capfd):
    worker.call(print, "from a plugin")
    assert capfd.readouterr().out == ""


def test_unpicklable_tasks_and_results_are_failures(worker):
    with pytest.raises(TaskError, match="the result cannot be sent"):
        worker.call(return_local_function)
    with pytest.raises(TaskError, match="the test worker: the task cannot be sent"):
        worker.call(lambda: None)
    assert worker.call(read_variable, "MOCK_SETTING")[0] == "17"


def read_server_state() -> tuple[int, int, int, set[str]]:
    server = psutil.Process(os.getppid())
    libraries = {Path(line.path).name for line in server.memory_maps()}
    return server.pid, server.num_threads(), os.getpgid(server.pid), libraries


@ON_LINUX
def test_workers_are_forked_from_one_clean_server():
    with Worker("one") as one, Worker("two") as two:
        first, second = one.call(read_server_state), two.call(read_server_state)
    assert first[:3] == second[:3]
    server, threads, group, libraries = first
    assert server not in (os.getpid(), os.getppid())
    assert threads == 1
    assert group == server
    assert any(name.startswith("libllvmlite") for name in libraries)  # compiled code is loaded
    assert not any(re.match("lib(EGL|GL|OSMesa|gallium|vulkan|wgpu)", name) for name in libraries)


def test_workers_get_the_current_environment(monkeypatch):
    with Worker("before") as worker:
        assert worker.call(read_variable, "MOCK_LATER")[0] is None
    monkeypatch.setenv("MOCK_LATER", "yes")
    with Worker("after") as worker:
        assert worker.call(read_variable, "MOCK_LATER")[0] == "yes"
        assert worker.call(read_variable, "PYTHONSAFEPATH")[0] == os.environ.get("PYTHONSAFEPATH")


CTRL_C = """
import os, signal
signal.signal(signal.SIGINT, lambda *_: print("heard", flush=True))
from harness.serving import start_server
from harness.worker import Worker
if __name__ == "__main__":
    start_server()
    os.killpg(0, signal.SIGINT)
    with Worker("a worker") as worker:
        print(worker.call(len, [1, 2]))
"""


@ON_LINUX
def test_ctrl_c_does_not_reach_the_loading_server(tmp_path):
    (tmp_path / "own.py").write_text(CTRL_C)
    done = run_python(tmp_path / "own.py", start_new_session=True)
    assert (done.stdout, done.stderr) == ("heard\n2\n", "")


def test_process_that_cannot_be_started_is_one_error(monkeypatch):
    """The fork server ends if memory is lacking."""

    def fail(_: object) -> None:
        raise EOFError("unexpected EOF")

    monkeypatch.setattr("multiprocessing.process.BaseProcess.start", fail)
    with pytest.raises(TaskError, match=r"no process can be started .*EOFError.*ulimit"):
        Worker("worker")
