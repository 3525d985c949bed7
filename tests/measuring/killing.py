"""Kills a run at a given moment and checks that nothing finished is lost."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

from harness.stored.folder import Record, read_run
from tests.paths import ROOT


def command(scene: Path, out: Path, *more: str) -> list[str]:
    """A run of many short cases on the scripted rasteriser."""
    return [
        *(sys.executable, "-m", "harness", "run", "--scene", str(scene), "--quiet", "--quick"),
        *("--rasterisers", "tests.mock:MockRasteriser", "--resolution", "64,96,128,256,512,1024"),
        *("--triangulators", "ear-clipping,delaunay,optimal:overdraw,optimal:half-perimeter"),
        *more,
        str(out),
    ]


def whole_run(scene: Path, out: Path) -> list[Record]:
    """Run without a kill; returns the records."""
    subprocess.run(command(scene, out, "--out"), cwd=ROOT, check=True, capture_output=True)
    return read_run(out).records


def kill_and_resume(
    scene: Path, out: Path, cases: int, later_s: float, expected: list[Record]
) -> int:
    """Kill -9 a run `later_s` after it wrote its `cases`-th record, then resume it.

    Returns how many cases were finished when it died.
    """
    process = subprocess.Popen(
        command(scene, out, "--out"), cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    while process.poll() is None and _written(out) < cases:
        time.sleep(0.001)
    time.sleep(later_s)
    process.send_signal(signal.SIGKILL)
    process.wait()
    if not (out / "run.json").exists():  # it had not begun
        subprocess.run(command(scene, out / "new", "--out"), cwd=ROOT, check=True)
        return 0
    finished = read_run(out).records
    lines = (out / "cases.jsonl").read_bytes().split(b"\n")
    assert [json.loads(line)["key"] for line in lines[:-1]] == [r["key"] for r in finished]
    subprocess.run(command(scene, out, "--resume"), cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    resumed = read_run(out)
    assert resumed.problems == []
    assert resumed.records[: len(finished)] == finished
    assert {r["key"]: r["counters"] for r in resumed.records} == {
        r["key"]: r["counters"] for r in expected
    }
    return len(finished)


def _written(out: Path) -> int:
    try:
        return (out / "cases.jsonl").read_bytes().count(b"\n")
    except OSError:
        return -1
