"""Kills a run at a given moment and checks that nothing finished is lost.

Run as a program, it measures a scene on the scripted rasteriser and nothing more: no processes, no
plots.
"""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

from harness.frame import View
from harness.measuring.plan import Plan
from harness.stored.folder import Record, read_run
from tests.measuring.test_run import measure, plan_for
from tests.paths import ROOT

RESOLUTIONS = (64, 96, 128, 256, 512, 1024)
CASES = 24

ALONE = (sys.executable, "-m", "tests.measuring.killing")
"""The measuring alone; SCENE and --out or --resume DIR follow."""


def plan_of(scene: Path) -> Plan:
    """Return the plan of many short cases."""
    views = tuple(View(size) for size in RESOLUTIONS)
    return plan_for(scene, views=views)


def kill_and_resume(
    scene: Path,
    out: Path,
    cases: int,
    later_s: float,
    expected: list[Record],
) -> int:
    """Kill -9 a run `later_s` after it wrote its `cases`-th record, then resume it.

    Returns how many cases were finished when it died.
    """
    process = subprocess.Popen(
        [*ALONE, str(scene), "--out", str(out)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    while process.poll() is None and _written(out) < cases:
        time.sleep(0.001)
    time.sleep(later_s)
    process.send_signal(signal.SIGKILL)
    process.wait()
    if not (out / "run.json").exists():  # it had not begun
        return 0
    finished = read_run(out).records
    lines = (out / "cases.jsonl").read_bytes().split(b"\n")
    assert [json.loads(line)["key"] for line in lines[:-1]] == [r["key"] for r in finished]
    again = [*ALONE, str(scene), "--resume", str(out)]
    subprocess.run(again, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    resumed = read_run(out)
    assert resumed.problems == []
    # A run's state, which its records are given as they are read, is known when it has ended.
    kept = [{**record, "state": None} for record in resumed.records]
    assert kept[: len(finished)] == [{**record, "state": None} for record in finished]
    assert {r["key"]: r["counters"] for r in resumed.records} == {
        r["key"]: r["counters"] for r in expected
    }
    assert not (out / "counted.jsonl").exists()
    return len(finished)


def _written(out: Path) -> int:
    try:
        return (out / "cases.jsonl").read_bytes().count(b"\n")
    except OSError:
        return -1


if __name__ == "__main__":
    name, option, folder = sys.argv[1:]
    measure(plan_of(Path(name)), Path(folder), resume=option == "--resume")
