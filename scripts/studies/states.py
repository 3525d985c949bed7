"""Ratios of times in several states of the machine: whether equal runs agree, and what rounds tell.

    PYTHONPATH=. python scripts/studies/states.py OUT [--runs 12] [--repeats 4]
        [--load copy|compute] [--half]

Each run is one `harness run` in a fresh process, which goes into OUT/<load>-<number>; runs that
are there already are kept. With repeats, each run times everything in so many fresh processes, for
so many times the seconds. With a load, another program copies memory, or computes, on another
core; with --half it does so in the second half of each run alone.

Prints the processor and, for each triangulator's ratio to ear clipping: of all runs in OUT the
reference draw and the ratio, by three ways to take the rounds; and of runs of one load in how many
pairs the difference is more than 1.96 standard errors: of all pairs, and of those in one state,
whose reference draws are within 3 % of each other. The ways: `all` rounds, as the harness does;
`quiet` rounds alone, whose reference draw is at most 15 % over the run's tenth percentile; and a
line `fitted` through all rounds, at that percentile. Both take the reference draw's median over
nine rounds.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from harness.figures.groups import time_ratio
from harness.machine.environment import label_of
from harness.stored.folder import Record, read_run

BASE = "ear-clipping"
NAMES = ("delaunay", "optimal:half-perimeter")
SMOOTHED = 9
LIMIT = 1.15
ONE_STATE = 1.03
"""Ratio of two runs' reference draws up to which the machine counts as in one state."""

PROGRAMS = {
    "copy": "import os, numpy as n; p = os.getppid(); a = n.ones(1 << 24); b = a.copy()\n"
    "while os.getppid() == p: b[:] = a",
    "compute": "import os; p = os.getppid()\nwhile os.getppid() == p: sum(range(100_000))",
}
"""They end with whoever started them, even where that was killed."""

Values = NDArray[np.float64]


def main() -> None:
    """Make the runs that are wanted and print what all of them say."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--runs", type=int, default=12)
    parser.add_argument("--repeats", type=int, default=1, help="processes of a run")
    parser.add_argument("--load", choices=("none", *PROGRAMS), default="none")
    parser.add_argument("--half", action="store_true", help="load in the second half alone")
    parser.add_argument("--seconds", type=float, default=15.0, help="of timing in a run")
    parser.add_argument("--run", default="--scene city --resolution 1024")
    given = parser.parse_args()
    name = given.load + ("-half" if given.half else "")
    name += f"-in-{given.repeats}" if given.repeats > 1 else ""
    for number in range(given.runs):
        folder = given.out / f"{name}-{number}"
        if not (folder / "run.json").exists():
            _run(folder, given)
    report(given.out)


def _run(folder: Path, given: argparse.Namespace) -> None:
    budget = given.seconds / (len(NAMES) + 3)
    command = [sys.executable, "-m", "harness", "run", *given.run.split(), "--device", "llvmpipe"]
    command += ["--triangulators", ",".join((BASE, *NAMES)), "--budget", f"{budget:g}"]
    command += ["--precision", "0.0001", "--repeats", str(given.repeats)]
    command += ["--out", str(folder), "--quiet"]
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    over = threading.Event()
    load = threading.Thread(target=_load, args=(folder, given, over))
    if given.load != "none":
        load.start()
    code = run.wait()
    over.set()
    if given.load != "none":
        load.join()
    if code:
        raise SystemExit(f"{' '.join(command)}: exit code {code}")


def _load(folder: Path, given: argparse.Namespace, over: threading.Event) -> None:
    """Wait until the run is timing, or half of that is over, and be a neighbour until it ends."""
    counted = folder / "counted.jsonl"
    while not counted.exists() and not over.wait(0.1):
        pass
    began = time.monotonic()
    while given.half and time.monotonic() < began + given.seconds / 2 and not over.wait(0.1):
        pass
    if not over.is_set():
        program = subprocess.Popen([sys.executable, "-c", PROGRAMS[given.load]])
        over.wait()
        program.kill()
        program.wait()


def report(out: Path) -> None:
    """Print what all runs in the folder say."""
    first = next(out.glob("*-*"))
    print(f"# {label_of(read_run(first).facts)}")
    print("triangulator,run,reference_ms,quiet_rounds,all,low,high,quiet,fitted")
    found: dict[tuple[str, str], list[tuple[float, float, float]]] = {}
    for folder in sorted(out.glob("*-*"), key=lambda path: (path.name[:7], path.stat().st_mtime)):
        records = {record["triangulator"]: record for record in read_run(folder).records}
        for name in NAMES:
            ratio = time_ratio(records[name], records[BASE])
            if ratio is None:
                raise SystemExit(f"{folder}: {name} was not timed beside {BASE}")
            kept, quiet, fitted = by_reference(records[name], records[BASE])
            median = float(np.median(records[name]["time"]["reference_s"])) * 1e3
            print(
                f"{name},{folder.name},{median:.3f},{kept:.2f},"
                f"{ratio.value:.4f},{ratio.low:.4f},{ratio.high:.4f},{quiet:.4f},{fitted:.4f}"
            )
            key = name, folder.name.rpartition("-")[0]
            half_width = np.log(ratio.high / ratio.low) / 2
            run = (float(np.log(ratio.value)), float(half_width), median)
            found.setdefault(key, []).append(run)
    for (name, load), runs in found.items():
        near = list(apart(runs, ONE_STATE))
        every = list(apart(runs, np.inf))
        spread = np.std([value for value, _, _ in runs], ddof=1)
        print(
            f"{name}, {load}: {sum(near)} of {len(near)} pairs in one state apart, {sum(every)} of "
            f"{len(every)} of all; runs scatter by {spread:.2%}"
        )


def apart(runs: list[tuple[float, float, float]], limit: float) -> Iterator[bool]:
    """Yield of each pair whether it differs by more than both 95 % intervals allow.

    runs : logarithm of the ratio, half its interval's width, the reference draw
    limit : ratio of the reference draws up to which a pair counts
    """
    for (one, near, first), (other, far, second) in combinations(runs, 2):
        if max(first, second) <= limit * min(first, second):
            yield bool(abs(one - other) > np.hypot(near, far))


def by_reference(record: Record, base: Record) -> tuple[float, float, float]:
    """Return the share of quiet rounds, their ratio, and that of a line at the quiet reference."""
    reference = smoothed(np.array(record["time"]["reference_s"]))
    logs = np.log(np.array(record["time"]["samples_s"]) / np.array(base["time"]["samples_s"]))
    best = np.quantile(reference, 0.1)
    quiet = reference <= LIMIT * best
    _, level = np.polyfit(np.log(reference / best), logs, 1)
    if np.log(reference.max() / best) < np.log(LIMIT):
        level = float(np.median(logs))  # nothing to fit a line through
    return float(quiet.mean()), float(np.exp(np.median(logs[quiet]))), float(np.exp(level))


def smoothed(reference: Values) -> Values:
    """Return each round's reference draw as the median of the rounds around it."""
    filtered: Values = median_filter(reference, SMOOTHED, mode="nearest")
    return filtered


if __name__ == "__main__":
    os.environ.setdefault("PYTHONPATH", ".")
    main()
