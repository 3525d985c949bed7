"""The figures of the pages beside docs/findings.md."""

from __future__ import annotations

from itertools import combinations
from math import hypot, log

from docs.held import Held, Sentence
from docs.held.lookups import BEST_FOR_H, Row, one, percent, some, table_row


def alarms() -> list[str]:
    """Return pairs of equal code: how many, called a regression, inconclusive; then those found
    and all of code that was made slower.
    """
    equal, slower = some("aa/pairs.csv", share=0), some("aa/pairs.csv", share=0.03)
    ends = [row["exit_code"] for row in equal]
    found = sum(row["exit_code"] == "1" for row in slower)
    return [str(n) for n in (len(equal), ends.count("1"), ends.count("5"), found, len(slower))]


BESIDE = {
    "quiet": "nothing",
    "loop": "an endless loop",
    "loops": "four of them",
    "copying": "a program that copies memory",
    "compiling": "a compiler",
    "midway": "two loops, from midway on",
    "half-core": "a loop, on the only core",
}
"""States of `scripts/states_matrix.py`, whose tables these are."""


def states() -> list[str]:
    """Return a row for each state: its runs, what they are called, and what is said of them."""
    lines = []
    for state, what in BESIDE.items():
        runs = some("states/states.csv", state=state)
        calls = [run["told"] for run in runs]
        told = [str(calls.count(name)) for name in ("quiet", "disturbed", "not to be trusted")]
        draws = [float(run["reference_ms"]) for run in runs if run["scene"] == "city"]
        best = some("states/ratios.csv", state=state, scene="city", triangulator=BEST_FOR_H)
        ratios = [float(row["ratio"]) for row in best]
        planted = some("states/planted.csv", state=state)
        said = (
            sum(run["compare"] == "1" for run in runs),
            sum(run["wrong"] == "True" for run in runs),
            f"{sum(row['compare'] == '1' for row in planted)} of {len(planted)}",
        )
        ends = [f"{min(draws):.2f} to {max(draws):.2f}", f"{min(ratios):.3f} to {max(ratios):.3f}"]
        lines.append(table_row(what, str(len(runs)), *told, *ends, *map(str, said)))
    return lines


def apart() -> list[str]:
    """Return of how many pairs of quiet runs' ratios how many differ more than chance lets them."""
    found: dict[tuple[str, ...], list[Row]] = {}
    for row in some("states/ratios.csv", state="quiet"):
        found.setdefault((row["scene"], row["kind"], row["triangulator"]), []).append(row)
    pairs = [pair for rows in found.values() for pair in combinations(rows, 2)]
    return [str(sum(_differ(*pair) for pair in pairs)), str(len(pairs))]


def _differ(one: Row, other: Row) -> bool:
    value, half = zip(*map(_log, (one, other)), strict=True)
    return bool(abs(value[0] - value[1]) > hypot(*half))


def _log(row: Row) -> tuple[float, float]:
    return log(float(row["ratio"])), log(float(row["high"]) / float(row["low"])) / 2


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
    r"lies above 1\b",
    r"at least 3 %|time=5%|quads=0%|Revels, [^)]*2016|\| \d \||makes it 0",
)
