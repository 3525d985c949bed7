"""Can the gate be left switched on? It must be quiet on equal runs and loud on slower ones.

A hundred quick runs of the city, about a quarter of an hour; counters cannot see the slower
drawing, so that times alone must tell. Inconclusive ones are counted apart: exit code 5 says that
the machine was too busy, which neither blames a change nor lets it pass for good.
"""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from harness.compare.comparison import compare_runs
from harness.results.run_folder import read_run
from tests.compare.heavy import EXTRA, WHICH
from tests.paths import ROOT

PAIRS, SLOWER = 40, 20
THIRD = "2"
"""Which drawing of a run is the slower one; any will do, but fan, which leaves polygons out."""


def measure(out: Path, **variables: str) -> Path:
    """Measure the city, in a process of its own as a user's runs are."""
    command = [sys.executable, "-m", "harness", "run", "--scene", "city", "--quick", "--quiet"]
    command += ["--rasterisers", "tests.compare.heavy:HeavyOpenGL", "--out", str(out)]
    environment = {**os.environ, **variables}
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="module")
def codes(tmp_path_factory) -> dict[str, Counter[int]]:
    """Exit codes of comparing equal runs, and of runs with 10 % more work in one drawing."""
    folder = tmp_path_factory.mktemp("gate")
    found: dict[str, Counter[int]] = {"equal": Counter(), "slower": Counter()}
    for number in range(PAIRS):
        base = read_run(measure(folder / f"base-{number}"))
        head = read_run(measure(folder / f"head-{number}"))
        found["equal"][compare_runs(base, head).exit_code] += 1
        if number < SLOWER:
            more = measure(folder / f"slower-{number}", **{WHICH: THIRD, EXTRA: "0.1"})
            found["slower"][compare_runs(base, read_run(more)).exit_code] += 1
    for name, counter in found.items():
        print(f"\n{name}: exit codes {dict(sorted(counter.items()))}")
    return found


def test_equal_runs_pass(codes):
    assert sum(codes["equal"].values()) == PAIRS
    assert codes["equal"][1] <= 1


def test_slower_runs_fail(codes):
    assert sum(codes["slower"].values()) == SLOWER
    assert codes["slower"][1] >= 19
