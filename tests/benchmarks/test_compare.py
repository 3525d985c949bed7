"""Error rates of the gate: it must pass equal runs and fail slower ones.

A hundred quick runs of the city take about 15 minutes. Counters do not show the slower drawing, so
that only times can. Inconclusive comparisons (exit code 5, a busy machine) are counted separately.
"""

from collections import Counter
from pathlib import Path

import pytest

from harness.compare.comparison import compare_runs
from harness.results.run_folder import read_run
from tests.compare.heavy import EXTRA, WHICH
from tests.paths import run_python

PAIRS, SLOWER = 40, 20
SLOWED_INDEX = "2"
"""Index of the slower drawing of a run; any except fan, which skips polygons."""


def measure(out: Path, **variables: str) -> Path:
    command = ["-m", "harness", "run", "--scene", "city", "--quick", "--quiet"]
    command += ["--rasterisers", "tests.compare.heavy:HeavyOpenGL", "--out", out]
    process = run_python(*command, env=variables, timeout=900)
    assert process.returncode == 0, process.stderr
    return out


@pytest.fixture(scope="module")
def codes(tmp_path_factory) -> dict[str, Counter[int]]:
    """Count exit codes for equal runs, and for runs with 10 % more work in one drawing."""
    folder = tmp_path_factory.mktemp("gate")
    counts: dict[str, Counter[int]] = {"equal": Counter(), "slower": Counter()}
    for number in range(PAIRS):
        base = read_run(measure(folder / f"base-{number}"))
        head = read_run(measure(folder / f"head-{number}"))
        counts["equal"][compare_runs(base, head).exit_code] += 1
        if number < SLOWER:
            slower = measure(folder / f"slower-{number}", **{WHICH: SLOWED_INDEX, EXTRA: "0.1"})
            counts["slower"][compare_runs(base, read_run(slower)).exit_code] += 1
    for name, counter in counts.items():
        print(f"\n{name}: exit codes {dict(sorted(counter.items()))}")
    return counts


def test_equal_runs_pass(codes):
    assert sum(codes["equal"].values()) == PAIRS
    assert codes["equal"][1] <= 1


def test_slower_runs_fail(codes):
    assert sum(codes["slower"].values()) == SLOWER
    assert codes["slower"][1] >= 19
