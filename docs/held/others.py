"""The figures of the pages beside docs/findings.md."""

from __future__ import annotations

import math
from statistics import NormalDist

from docs.held import Held, Sentence
from docs.held.lookups import (
    Row,
    matched,
    some,
    text,
)
from harness.figures.intervals import RUN_SCATTER
from scripts.studies import states as studied


def alarms() -> list[str]:
    """Return pairs of equal code: how many, called a regression, inconclusive; then those found
    and all of code that was made slower.
    """
    equal, slower = some("aa/pairs.csv", share=0), some("aa/pairs.csv", share=0.03)
    ends = [row["exit_code"] for row in equal]
    found = sum(row["exit_code"] == "1" for row in slower)
    return [str(n) for n in (len(equal), ends.count("1"), ends.count("5"), found, len(slower))]


STATES, IN_FOUR, AGAIN = (
    f"llvmpipe/{name}.txt" for name in ("states", "states-in-four", "states-again")
)
"""Runs of `scripts/studies/states.py`: the processor, a line of CSV for each run, then what pairs
of them say. The first two are from before intervals held `RUN_SCATTER`, which the first one told.
"""

LOADS = {"none": "nothing", "copy": "a program that copies memory", "compute": "one that adds"}


def states() -> list[str]:
    """Return a row for each processor and state: how many runs, and the ends of what they say."""
    rows = []
    for file in (STATES, AGAIN):
        runs = _runs(file)
        for load, what in LOADS.items():
            of_state = [run for run in runs if run["run"].startswith(f"{load}-")]
            best = [run for run in of_state if run["triangulator"] == "optimal:half-perimeter"]
            others = [run for run in of_state if run["triangulator"] == "delaunay"]
            cells = [_ends(best, "reference_ms", 2), _ends(best, "all", 3), _ends(others, "all", 3)]
            where = text(file).splitlines()[0].removeprefix("# ")
            rows.append(f"| {where} | {what} | {len(best)} | {' | '.join(cells)} |")
    return rows


def _runs(file: str) -> list[Row]:
    lines = [line.split(",") for line in text(file).splitlines() if line.count(",") == 8]
    return [dict(zip(lines[0], line, strict=True)) for line in lines[1:]]


def _ends(runs: list[Row], column: str, digits: int) -> str:
    found = [float(run[column]) for run in runs]
    return f"{min(found):.{digits}f} to {max(found):.{digits}f}"


def apart() -> list[str]:
    """Return of how many pairs of undisturbed runs in one state, of both triangulators, how many
    are further apart than both intervals allow: by what each run alone says, of the first two
    studies; then with what runs scatter, of all three.
    """
    alone = [number for file in (STATES, IN_FOUR) for number in _apart(file, scattered=False)]
    held = [number for file in (STATES, IN_FOUR, AGAIN) for number in _apart(file, scattered=True)]
    return [*alone, *held]


def _apart(file: str, *, scattered: bool) -> tuple[str, str]:
    found: list[bool] = []
    held = NormalDist().inv_cdf(0.975) * RUN_SCATTER
    for name in studied.NAMES:
        runs = []
        for run in _runs(file):
            if run["triangulator"] != name or not run["run"].startswith("none-"):
                continue
            own = math.log(float(run["high"]) / float(run["low"])) / 2
            alone = own if file != AGAIN else math.sqrt(max(0.0, own**2 - held**2))
            reach = math.hypot(alone, held if scattered else 0.0)
            runs.append((math.log(float(run["all"])), reach, float(run["reference_ms"])))
        found += studied.apart(runs, studied.ONE_STATE)
    return str(sum(found)), str(len(found))


THEOREMS = (
    r"In an hour, a hunt (?s:.*?)by up to 5 %\)",
    r"(?s)^.*?## How an optimum is proven",
    r"(?s)\*\*Potentials make exclusions.*?\*\*Large polygons",
    r"\d(?=\. [A-Z])|1960|19\d\d|2014|2018|step \d|edges? \d",
    r"one hole and up to 64 vertices",
    r"250 lines|eight million|2,000 vertices",
)
"""Definitions, and an example that a test computes."""

GATE: list[Held] = [
    Sentence(
        "Of {} pairs of equal code {} were called a regression and {} were inconclusive. {} of {}"
        " pairs in which 3 % of one drawing's triangles were drawn twice were found.",
        alarms,
    ),
]

GATE_RULES = (
    r"0 %, whatever|\(5 %\)|95 % interval|excludes 1\b|0.75 %|exceeds 1.015|60,000 characters",
    r"3 % of one|at least 3 %|2x2|time=5%|quads=0%|quads=1%|\b3 or more",
    r"Revels, [^)]*2016",
    r"\| \d \||makes it 0|in which 10 % of",
)

EQUALITY = "llvmpipe/optimum-equality.txt"


def _on_device() -> list[str]:
    lines = text(EQUALITY).splitlines()
    scenes = [line for line in lines if " px, " in line]
    of_scenes = sum(int(line.split()[-2].replace(",", "")) for line in scenes)
    generated = sum(line.startswith("footprints, seed") for line in lines)
    (footprints,) = matched(EQUALITY, r"footprints on the device: ([\d,]+)")
    return [footprints, str(generated), f"{of_scenes:,}"]


GPU: list[Held] = [
    Sentence(
        "{} footprints of {} generated cities and {} rings of all scenes (three views each, the"
        " optimum and the worst)",
        _on_device,
    ),
]

GPU_DESIGN = (r"(?s)^.*?## What was measured where",)
"""What the algorithm is made for, what it costs on paper, and what others have published."""
