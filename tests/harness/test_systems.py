"""Runs on systems without EGL, GLU, OSMesa and POSIX functions."""

import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from harness.machine import system
from harness.results.run_folder import read_run
from tests.paths import ROOT, run_python

BARE = Path(__file__).parents[1] / "bare"


def call(*arguments: str, cwd: Path) -> str:
    """Run the command line in a process without these; return the output."""
    path = os.pathsep.join([str(BARE), str(ROOT)])
    environment = {"PYTHONPATH": path, "COLUMNS": "200"}
    done = run_python("-P", "-m", "harness", *arguments, cwd=cwd, env=environment, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_webgpu_is_the_default_without_egl(tmp_path, block):
    out = call("triangulate", str(block), "-o", "triangles.geojson", cwd=tmp_path)
    assert "triangles.geojson" in out
    scene = ("--scene", str(block), "--triangulators", "fan,ear-clipping,refined")
    call("run", *scene, "--quick", "--out", "drawn", cwd=tmp_path)
    records = read_run(tmp_path / "drawn").records
    assert {record.id.rasteriser for record in records} == {"webgpu"}
    assert all(record.is_ok for record in records), records
    assert (tmp_path / "drawn/report.html").is_file()
    call("report", "drawn", cwd=tmp_path)
    assert "No regression" in call("compare", "drawn", "drawn", cwd=tmp_path)


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        *((0, "exit code 0"), (-11, "SIGSEGV"), (-9, "SIGKILL (perhaps out of memory)")),
        *((-40, "signal 40"), (0xC0000005, "exit code 0xC0000005"), (None, "exit code None")),
    ],
)
def test_exit_codes_of_processes_are_described(code, expected):
    assert system.describe_exit(code) == expected


def test_process_trees_end_without_process_groups(monkeypatch):
    monkeypatch.delattr(os, "killpg")
    start = "import subprocess, sys; print(subprocess.Popen(['sleep', '60']).pid, flush=True)"
    command = [sys.executable, "-c", f"{start}; import time; time.sleep(60)"]
    parent = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    child = psutil.Process(int(parent.stdout.readline()))
    system.kill_group(parent.pid)
    assert parent.wait(10) == -9
    assert psutil.wait_procs([child], timeout=10)[1] == []
