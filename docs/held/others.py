"""The figures of the pages beside docs/findings.md."""

from __future__ import annotations

import re

from docs.held import Held, Sentence, Table
from docs.held.lookups import (
    Row,
    interval,
    matched,
    one,
    percent,
    some,
    table_row,
    text,
    two,
    whole,
)

SHARES = "learned/shares.csv"
SCENES = {"glyphs": "letters"}


def learned() -> list[str]:
    """Return the table of savings when a scene is held out."""
    lines = []
    for scene in dict.fromkeys(row["held_out"] for row in some(SHARES)):

        def share(at: str, rule: str, scene: str = scene) -> tuple[str, str]:
            row = one(SHARES, held_out=scene, at=at, rule=rule)
            return two(row["share_of_saving"]), interval(row["low"], row["high"], two)

        flips = one(SHARES, held_out=scene, at="refined", rule="refined")
        saved, within = share("refined", "refined")
        lines.append(
            table_row(
                SCENES.get(scene, scene),
                whole(flips["polygons"]),
                " ".join(share("a quarter", "learned")),
                " ".join(share("a quarter", "small first")),
                f"**{saved}** {within}",
                two(flips["share_of_time"]),
            )
        )
    return lines


def _city(column: str, **where: object) -> str:
    return two(one(SHARES, held_out="city", **where)[column])


LEARNED: list[Held] = [
    Sentence(
        "for it takes {} there:",
        lambda: [_city("share_of_time", at="refined", rule="refined")],
    ),
    Table(
        "| held out | polygons | learned, a quarter of the time | small first | refined, whatever"
        " it takes | refined's time |",
        learned,
    ),
    Sentence(
        "On city the features, the prediction and ear clipping alone take {} of the optimum's"
        " time.",
        lambda: [_city("spent_before", at="a quarter", rule="learned")],
    ),
]

LEARNED_PLAN = (
    r"(?s)^.*?\n---\n",
    r"Run on 2026-11-22",
    r"\b95 %",
)
"""The plan was registered before anything was measured; it is never changed."""


def alarms() -> list[str]:
    """Return pairs of equal code: how many, called a regression, inconclusive; then those found
    and all of code that was made slower.
    """
    equal, slower = some("aa/pairs.csv", share=0), some("aa/pairs.csv", share=0.03)
    ends = [row["exit_code"] for row in equal]
    found = sum(row["exit_code"] == "1" for row in slower)
    return [str(n) for n in (len(equal), ends.count("1"), ends.count("5"), found, len(slower))]


STATES = "llvmpipe/states.txt"
"""Runs of `scripts/studies/states.py`: a line of CSV for each, then what pairs of them say."""


def states() -> list[str]:
    """Return a row for each state of the machine: how many runs, and the ends of what they say."""
    lines = [line.split(",") for line in text(STATES).splitlines() if line.count(",") == 8]
    runs = [dict(zip(lines[0], line, strict=True)) for line in lines[1:]]
    told = {"none": "nothing", "copy": "a program that copies memory", "compute": "one that adds"}
    rows = []
    for state, what in told.items():
        of_state = [run for run in runs if run["run"].startswith(f"{state}-")]
        best = [run for run in of_state if run["triangulator"] == "optimal:half-perimeter"]
        others = [run for run in of_state if run["triangulator"] == "delaunay"]
        cells = [_ends(best, "reference_ms", 2), _ends(best, "all", 3), _ends(others, "all", 3)]
        rows.append(f"| {what} | {len(best)} | {' | '.join(cells)} |")
    return rows


def _ends(runs: list[Row], column: str, digits: int) -> str:
    found = [float(run[column]) for run in runs]
    return f"{min(found):.{digits}f} to {max(found):.{digits}f}"


def apart() -> list[str]:
    """Return pairs of undisturbed runs that are apart and how many there are, of the best for H:
    of runs in one state, then of all; then the same of Delaunay.
    """
    pattern = r"{}, none: (\d+) of (\d+) pairs in one state apart, (\d+) of (\d+) of all"
    names = ("optimal:half-perimeter", "delaunay")
    return [number for name in names for number in matched(STATES, pattern.format(name))]


HUNT = "hunt.txt"
"""What `scripts/studies/hunt.py` printed in an hour."""


def hunted() -> list[str]:
    """Return optima and those that the search missed; of Q on small polygons, and of A on stars and
    squares, which share that is, and by how much at most.
    """
    (tried,) = matched(HUNT, r"([\d,]+) optima;")
    rows = re.findall(r"(\S.*?)  +(\S+) +([\d,]+) +([\d,]+) +([\d.]+)%", text(HUNT))
    found = [tried, whole(sum(_count(row[3]) for row in rows))]
    for criterion, kinds in (("expected-quads", ("small",)), ("overdraw", ("stars", "squares"))):
        some_ = [row for row in rows if row[1] == criterion and row[0].startswith(kinds)]
        share = sum(_count(row[3]) for row in some_) / sum(_count(row[2]) for row in some_)
        found += [percent(share), whole(max(float(row[4]) for row in some_))]
    return found


def _count(cell: str) -> int:
    return int(cell.replace(",", ""))


THEORY: list[Held] = [
    Sentence(
        "set {} proven optima of hostile polygons with holes against that search"
        " (`results/reference/hunt.txt`). It had missed {} of them: next to none for H and E, {} %"
        " for Q on small polygons (by up to {} %), {} % for A on stars and squares with many holes"
        " (by up to {} %).",
        hunted,
    ),
]

THEOREMS = (
    r"(?s)^.*?## How an optimum is proven",
    r"(?s)\*\*Potentials make exclusions.*?\*\*Large polygons",
    r"\d(?=\. [A-Z])|1960|19\d\d|2014|step \d|edges? \d",
    r"one hole and up to 64 vertices",
    r"250 lines|eight million|100,000 corners",
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
    of_scenes = sum(int(line.split()[-3].replace(",", "")) for line in scenes)
    (large,) = {line.split()[-3] for line in lines if line.startswith("large rings")}
    generated = sum(line.startswith("footprints, seed") for line in lines)
    (footprints,) = matched(EQUALITY, r"footprints on the device: ([\d,]+)")
    return [footprints, str(generated), f"{of_scenes:,}", str(2 * int(large))]


GPU: list[Held] = [
    Sentence(
        "{} footprints of {} generated cities, {} rings of all scenes (three views each, the"
        " optimum and the worst) and {} rings of 65 to 2,048 corners",
        _on_device,
    ),
]

GPU_DESIGN = (
    r"(?s)^.*?## What was measured where",
    r"(?s)published for this recurrence.*?TITAN X",
    r"65 to 2,048 corners",
)
"""What the algorithm is made for, what it costs on paper, and what others have published."""
