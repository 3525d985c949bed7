"""The figures of the pages beside docs/findings.md."""

from __future__ import annotations

from docs.held import Held, Sentence
from docs.held.lookups import Row, some, text


def alarms() -> list[str]:
    """Return pairs of equal code: how many, called a regression, inconclusive; then those found
    and all of code that was made slower.
    """
    equal, slower = some("aa/pairs.csv", share=0), some("aa/pairs.csv", share=0.03)
    ends = [row["exit_code"] for row in equal]
    found = sum(row["exit_code"] == "1" for row in slower)
    return [str(n) for n in (len(equal), ends.count("1"), ends.count("5"), found, len(slower))]


STATES, AGAIN = "llvmpipe/states.txt", "llvmpipe/states-again.txt"
"""Runs of `scripts/studies/states.py`: the processor, a line of CSV for each run, then what pairs
of them say.
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


GATE: list[Held] = [
    Sentence(
        "Of {} pairs of equal code {} were called a regression and {} were inconclusive. {} of {}"
        " pairs in which 3 % of one drawing's triangles were drawn twice were found.",
        alarms,
    ),
]

GATE_RULES = (
    r"0 %, whatever|\(5 %\)|95 % interval|excludes 1\b|exceeds 1.015|60,000 characters|3 % of one",
    r"at least 3 %|time=5%|quads=0%|Revels, [^)]*2016|\| \d \||makes it 0",
)
