r"""Measures how triangulating a data set scales: rate, memory, Dask's overhead, time left.

    PYTHONPATH=. .venv/bin/python scripts/scale.py FOLDER --footprints 1000000 10000000 \
        --workers 2 --out results/reference/scale.jsonl

Makes the footprints in FOLDER/data-N, which are kept, and prints one JSON object a line. The
overhead is a ratio of times measured in turns, so that a machine that others use, too, slows both.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import psutil

from harness.machine.processor import processor
from harness.progress import Reporter
from harness.scaling.cluster import DaskCrew
from harness.scaling.dataset import MANIFEST, Dataset
from harness.scaling.task_queue import Alone, Crew, work_through
from harness.scaling.triangulated import Options
from scripts.footprints import CITY, write

ROOT = Path(__file__).resolve().parent.parent
COLUMNS = ("polygons", "seconds", "cpu_seconds")
OPTIONS = Options("optimal:half-perimeter")
EMPTY, APART = 10_000, 500
"""Empty tasks: futures alone, and such as are carried out in the process that parts have."""
PLANNED = 100_000_000
LEFT = re.compile(r"(\d+):(\d\d):(\d\d) left")
FAR_S = 15.0
"""Least time left for which the time shown is judged."""


def main() -> None:
    """Read the command line and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--footprints", type=int, nargs="+", default=[1_000_000])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5, help="turns of the overhead; 0 for none")
    parser.add_argument("--out", type=Path, help="file that gets the lines, too")
    chosen = parser.parse_args()
    lines = []

    def tell(name: str, figures: dict[str, object]) -> None:
        """Print a line, and keep it."""
        load = [round(each, 1) for each in psutil.getloadavg()]
        about = {"figure": name, "cpu": processor()["label"], "load": load}
        lines.append(json.dumps({**about, **figures}))
        print(lines[-1], flush=True)

    out = chosen.folder / "out"
    for footprints in sorted(chosen.footprints):
        data = chosen.folder / f"data-{footprints}"
        write(data, footprints)
        if chosen.rounds and footprints == min(chosen.footprints):
            tell("empty tasks", empty_tasks())
            tell("overhead", overhead(data, chosen.folder, chosen.rounds))
        shutil.rmtree(out, ignore_errors=True)
        found, seconds = whole_command(data, out, chosen.workers)
        tell("footprints", {"footprints": footprints, "workers": chosen.workers, **found})
        shutil.rmtree(out)
    tell("extrapolation", extrapolated(seconds))
    if chosen.out:
        chosen.out.write_text("\n".join(lines) + "\n")


def empty_tasks() -> dict[str, object]:
    """Tasks a second that the scheduler carries out: futures alone, and with a process's answer."""
    crew = DaskCrew("local:1", Reporter(quiet=True))
    try:
        client = crew._client
        client.gather(client.map(int, range(100), pure=False))
        begun, spent = time.perf_counter(), cores_s(psutil.Process())
        client.gather(client.map(int, range(EMPTY), pure=False))
        bare = time.perf_counter() - begun
        cores = cores_s(psutil.Process()) - spent
        tasks = {f"task {number}": (os.getpid, ()) for number in range(APART)}
        begun = time.perf_counter()
        work_through(tasks, crew, lambda *_: None)
        all_s = time.perf_counter() - begun
    finally:
        crew.close()
    return {
        "futures_per_s": round(EMPTY / bare),
        "futures_per_core_s": round(EMPTY / cores),
        "in_the_parts_process_per_s": round(APART / all_s),
    }


def overhead(data: Path, folder: Path, rounds: int) -> dict[str, object]:
    """The cores' time for a city on a worker over that in one process, in turns and warm."""
    pattern = str(data / "city-0000.parquet")
    alone = Alone()
    alone.threads_each = 1
    crew = DaskCrew("local:1", Reporter(quiet=True))
    try:
        timed(pattern, folder / "warm", alone)
        timed(pattern, folder / "warm", crew)
        pairs = []
        for turn in range(rounds):
            order: list[Crew] = [alone, crew] if turn % 2 else [crew, alone]
            seconds = {each: timed(pattern, folder / "turn", each) for each in order}
            pairs.append((seconds[alone], seconds[crew]))
    finally:
        crew.close()
    ratios = np.array([there / here for here, there in pairs])
    draws = np.random.default_rng(0).choice(ratios, (2000, len(ratios)))
    return {
        "footprints": CITY,
        "one_process_core_s": [round(here, 2) for here, _ in pairs],
        "dask_core_s": [round(there, 2) for _, there in pairs],
        "overhead_median": round(float(np.median(ratios) - 1), 4),
        "ci95": np.percentile(np.median(draws, axis=1) - 1, [2.5, 97.5]).round(4).tolist(),
    }


def timed(pattern: str, out: Path, crew: Crew) -> float:
    """Seconds of the cores that all parts of a file take: of this process and those under it.

    They hardly depend on what else the machine does, as seconds of the clock do.
    """
    dataset = Dataset(pattern, out, OPTIONS)
    begun = cores_s(psutil.Process())
    dataset.complete(crew, Reporter(quiet=True))
    taken = cores_s(psutil.Process()) - begun
    shutil.rmtree(out)
    return taken


def cores_s(top: psutil.Process) -> float:
    """Seconds of the cores that a process and those under it, which live, have had."""
    spent = 0.0
    for process in (top, *top.children(recursive=True)):
        with contextlib.suppress(psutil.NoSuchProcess):
            times = process.cpu_times()
            spent += times.user + times.system
    return spent


def whole_command(data: Path, out: Path, workers: int) -> tuple[dict[str, object], np.ndarray]:
    """Run and watch the command; returns figures, and (n, 3) COLUMNS of its parts."""
    command = [sys.executable, "-m", "harness", "triangulate", str(data / "*.parquet")]
    begun = time.monotonic()
    process = subprocess.Popen(
        [*command, "-o", str(out), "--dask", f"local:{workers}"],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    said: list[tuple[float, str]] = []
    peaks = {"worker": 0, "command": 0, "core_ms": 0}
    watch(process, lambda line: said.append((time.monotonic() - begun, line)), peaks)
    taken = time.monotonic() - begun
    assert process.stdout is not None
    last = process.stdout.read().strip()
    assert process.returncode == 0, said[-3:]
    parts = json.loads((out / MANIFEST).read_text())["parts"]
    seconds = np.array([[part[name] for name in COLUMNS] for part in parts])
    size = sum(file.stat().st_size for file in out.glob("*.parquet"))
    polygons = seconds[:, 0].sum()
    return {
        "said": last,
        "seconds": round(taken, 1),
        "footprints_per_s_and_worker": round(polygons / seconds[:, 1].sum()),
        "footprints_per_core_s": round(polygons / seconds[:, 2].sum()),
        "all_core_s": round(peaks["core_ms"] / 1e3, 1),
        "of_wall_time": round(polygons / taken / workers),
        "peak_mb_a_worker": round(peaks["worker"] / 1e6),
        "peak_mb_command": round(peaks["command"] / 1e6),
        "output_bytes_a_footprint": round(size / polygons),
        "time_left": judged(said, taken),
    }, seconds


def watch(
    process: subprocess.Popen[str], heard: Callable[[str], object], peaks: dict[str, int]
) -> None:
    """Pass on what the process says, and note the most memory that it and a worker ever have.

    A worker's is that of its process and of the processes under it, each with its share of pages
    that several have (PSS).
    """
    import threading

    def listen() -> None:
        assert process.stderr is not None
        for line in process.stderr:
            heard(line.strip())

    listener = threading.Thread(target=listen)
    listener.start()
    top = psutil.Process(process.pid)
    while process.poll() is None:
        try:
            peaks["core_ms"] = max(peaks["core_ms"], round(1e3 * cores_s(top)))
            peaks["command"] = max(peaks["command"], memory(top))
            for child in top.children():
                family = [child, *child.children(recursive=True)]
                if len(family) > 1:
                    peaks["worker"] = max(peaks["worker"], sum(map(memory, family)))
        except psutil.NoSuchProcess:
            continue
        time.sleep(0.2)
    listener.join()


def memory(process: psutil.Process) -> int:
    """Bytes of a process, its share of what it shares."""
    try:
        return int(process.memory_full_info().pss)
    except (psutil.NoSuchProcess, psutil.AccessDenied):
        return 0


def judged(said: list[tuple[float, str]], taken: float) -> dict[str, object]:
    """How far the time left that was shown was from what it became, relative to the latter."""
    errors = []
    for at, line in said:
        match = LEFT.search(line)
        if match and taken - at >= FAR_S:
            hours, minutes, seconds = map(int, match.groups())
            errors.append((3600 * hours + 60 * minutes + seconds) / (taken - at) - 1)
    if not errors:
        return {"shown": 0}
    sizes = np.abs(errors)
    return {
        "shown": len(errors),
        "right_to_20_percent": int((sizes <= 0.2).sum()),
        "median_error": round(float(np.median(sizes)), 3),
        "worst_error": round(float(sizes.max()), 3),
    }


def extrapolated(seconds: np.ndarray) -> dict[str, object]:
    """Core-hours for 100 M footprints by the parts' own, with a 95 % bootstrap interval."""
    draws = np.random.default_rng(0).integers(0, len(seconds), (2000, len(seconds)))
    polygons, _, spent = seconds[draws].sum(axis=1).T
    low, middle, high = np.percentile(spent / polygons, [2.5, 50, 97.5]) * PLANNED / 3600
    return {
        "core_hours": [round(float(each), 3) for each in (low, middle, high)],
        **{
            f"minutes_on_{workers}": [
                round(float(60 * e / workers), 2) for e in (low, middle, high)
            ]
            for workers in (1, 16, 256)
        },
    }


if __name__ == "__main__":
    main()
