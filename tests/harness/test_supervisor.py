"""The program can be stopped while a library's C code runs; nothing is left behind."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
import pytest

from harness.machine import system
from tests.paths import ROOT, run_python

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="supervision is for Linux")

STUCK = """
import itertools, os, subprocess, sys, tempfile
class Hook:
    def find_spec(self, name, *_):
        if name == "typer":
            other = subprocess.Popen(["sleep", "600"], start_new_session=True)
            with tempfile.NamedTemporaryFile(delete=False) as file:
                print(os.getpid(), other.pid, file.name, flush=True)
            sum(itertools.repeat(0))  # in C: no signal is handled, no other thread runs
sys.meta_path.insert(0, Hook())
"""

GRACEFUL = """
import signal, time
from harness import supervisor
supervisor.continue_in_child()
def stop(*_):
    supervisor.allow_cleanup(unlimited=True)
    time.sleep(supervisor.END_TIMEOUT_S + 1)
    raise SystemExit(7)
signal.signal(signal.SIGTERM, stop)
print("ready", flush=True)
time.sleep(600)
"""


STARTED: list[subprocess.Popen[str]] = []
"""Programs of the present test, which would run forever if it fails."""


@pytest.fixture
def shared():
    """Return a folder for temporary files with a short path, as sockets require."""
    folder = Path(tempfile.mkdtemp(prefix="rh-"))
    yield folder
    while STARTED:
        if (process := STARTED.pop()).poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    shutil.rmtree(folder)


def start(shared: Path, hook: Path, *command: str) -> subprocess.Popen[str]:
    paths = os.pathsep.join([str(hook), str(ROOT)])
    environment = {**os.environ, "PYTHONPATH": paths, "TMPDIR": str(shared)}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    start = [sys.executable, *command]
    STARTED.append(subprocess.Popen(start, env=environment, start_new_session=True, **pipes))
    return STARTED[-1]


def start_stuck(shared: Path, folder: Path) -> tuple[subprocess.Popen[str], list[int], Path]:
    """Start the program; return it, its child and grandchild, and a temporary file."""
    (folder / "sitecustomize.py").write_text(STUCK)
    process = start(shared, folder, "-m", "harness", "list", "scenes")
    child, other, name = process.stdout.readline().split()
    running = psutil.Process(int(child))
    before = running.cpu_times().user
    while running.cpu_times().user < before + 0.1:  # the program is in C code then
        time.sleep(0.01)
    return process, [int(child), int(other)], Path(name)


def wait_for_end(pids: list[int]) -> None:
    while any(psutil.pid_exists(pid) for pid in pids):
        time.sleep(0.01)


@pytest.mark.parametrize("to_group", [True, False])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_a_program_in_c_code(shared, tmp_path, number, to_group):
    process, others, file = start_stuck(shared, tmp_path)
    assert file.is_relative_to(shared)
    (os.killpg if to_group else os.kill)(process.pid, number)
    _, err = process.communicate(timeout=60)
    assert not any(psutil.pid_exists(pid) for pid in others)
    assert (process.returncode, err) == (130, "stopped\n")
    assert list(shared.iterdir()) == []


def test_next_start_removes_what_a_killed_program_left(shared, tmp_path):
    process, (child, other), file = start_stuck(shared, tmp_path)
    second, others, _ = start_stuck(shared, tmp_path)
    process.kill()
    process.wait()
    wait_for_end([child])  # the kernel ends it with its parent
    os.kill(other, signal.SIGKILL)
    assert file.exists()
    # Left by a parent that was killed before its child.
    without_lock = shared / f"{system.TEMPORARY_PREFIX}new"
    without_lock.mkdir()
    done = run_python("-m", "harness", "list", "criteria", env={"TMPDIR": str(shared)})
    assert done.returncode == 0
    assert not file.exists()
    assert len(list(shared.iterdir())) == 1  # the folder of the program that still runs
    without_lock.mkdir()  # as if its child were still exiting
    os.killpg(second.pid, signal.SIGTERM)
    second.communicate(timeout=60)
    wait_for_end(others)
    assert list(shared.iterdir()) == []


def test_program_that_stores_results_gets_more_time(shared, tmp_path):
    process = start(shared, tmp_path, "-c", GRACEFUL)
    assert process.stdout.readline() == "ready\n"
    process.terminate()
    assert process.wait(timeout=60) == 7


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGKILL])
def test_crash_is_one_line(shared, tmp_path, number):
    code = "import os; from harness.supervisor import continue_in_child; continue_in_child(); "
    process = start(shared, tmp_path, "-c", f"{code} os.kill(os.getpid(), {int(number)})")
    _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert err.startswith(f"error: the program was ended by {number.name}")
    assert err.count("\n") == 1
    assert list(shared.iterdir()) == []
