"""The figures of the pages beside docs/findings.md."""

from __future__ import annotations

from docs.held import Held, Sentence
from docs.held.lookups import Row, one, percent, some, table_row, text


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


PRODUCERS = {
    "mean over polygons": "mean over polygons: regret, gains, what is advised",
    "ratio over tiles": "ratio of sums over polygons or tiles",
    "correlation": "rank correlation, median over polygons",
    "criteria compared": "difference of two criteria's correlations",
    "regret of times": "regret by draw times",
    "median time": "draw time",
    "ratio of times": "ratio of draw times, its processes and runs",
    "ratio of times in use": "the same, beside other programs",
    "the best of seven": "what the fastest of seven saves",
    "break-even": "draws until triangulating pays",
    "two runs compared": "growth from one run to another (`compare`)",
    "share of A/A pairs": "share of pairs called a regression",
}
"""Rows of `coverage.csv` by what they are of."""

KEPT = 0.93
"""What an interval of 95 % is asked to hold the truth in."""


def intervals() -> list[str]:
    """Return a row for each producer of intervals: how often they hold the truth, and where not."""
    lines = []
    for name, label in PRODUCERS.items():
        rows = some("coverage.csv", interval=name)
        kept = [float(row["covered"]) for row in rows if not _below(row["covered"])]
        simpler = [float(row["before"]) for row in rows if row["before"]]
        lost = [f"{row['data']}: {row['covered']}" for row in rows if _below(row["covered"])]
        told = f"{min(simpler):.3f}" if simpler else ""
        cells = (str(len(rows)), f"{min(kept):.3f}", told, "; ".join(lost))
        lines.append(table_row(label, *cells))
    whole, profiles = one("law-coverage.csv", term="all"), some("law-coverage-profiles.csv")
    lost = [
        f"as {row['profile']} misses it: {row['within']}, a false cost in"
        f" {percent(1 - float(row['nothing_shown']))} % of devices"
        for row in profiles
        if _below(row["within"])
    ]
    least = min(float(row["within"]) for row in (whole, *profiles) if not _below(row["within"]))
    cells = (str(1 + len(profiles)), f"{least:.3f}", "", "; ".join(lost))
    return [*lines, table_row("a cost of a device's law (`profile`)", *cells)]


def _below(share: str) -> bool:
    return float(share) < KEPT


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
