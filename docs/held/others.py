"""The figures of the pages beside docs/findings.md."""

from __future__ import annotations

import math
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
    three,
    two,
    whole,
)
from harness.figures.ratios import NORMAL, RUN_SCATTER
from scripts.studies import states as studied

MODELS = "models.csv"
_KINDS = {"cad": "sheet metal", "helsinki": "footprints", "glyphs": "letters"}


def models() -> list[str]:
    """Return what other diagonals save on models."""
    lines = []
    for row in some(MODELS):
        if row["kind"] not in _KINDS:
            continue
        cells = [
            f"{two(row[f'{what}_median'])} {interval(row[f'{what}_low'], row[f'{what}_high'], two)}"
            for what in ("lanes", "quads")
        ]
        changed = f"{row['changed']} of {row['models']}"
        lines.append(table_row(_KINDS[row["kind"]], changed, row["pixels"], *cells))
    return lines


SHARES_FLAT = "models-share.csv"


def flat_shares() -> list[str]:
    """Return helper lanes after to before, by the share of a model's area that is flat."""
    lines = []
    for share in dict.fromkeys(row["kind"] for row in some(SHARES_FLAT)):
        rows = [one(SHARES_FLAT, kind=share, pixels=pixels) for pixels in (64, 256, 1024)]
        cells = [
            f"{three(row['lanes_median'])} {interval(row['lanes_low'], row['lanes_high'], three)}"
            for row in rows
        ]
        lines.append(table_row(share, *cells))
    return lines


def saved_by_share(share: str) -> list[str]:
    """Return the median percentages of helper lanes that are saved, by size."""
    rows = (one(SHARES_FLAT, kind=share, pixels=pixels) for pixels in (64, 256, 1024))
    return [percent(1.0 - float(row["lanes_median"]), 1) for row in rows]


def _saved(kind: str, what: str, pixels: int) -> float:
    """Return the median percentage of helper lanes or quads that a kind of model saves."""
    return 100.0 * (1.0 - float(one(MODELS, kind=kind, pixels=pixels)[f"{what}_median"]))


def model_savings() -> list[str]:
    """Return the least and most helper lanes saved over sizes, kind by kind; then the quads."""
    lanes = [[_saved(kind, "lanes", px) for px in (64, 256, 1024)] for kind in _KINDS]
    quads = [f"{_saved(kind, 'quads', 1024):.1f}" for kind in _KINDS]
    return [f"{end(found):.0f}" for found in lanes for end in (min, max)] + quads


KEPT = "models-kept.csv"


def models_kept() -> list[str]:
    """Return what stays as it was in models of many kinds."""
    rows = some(KEPT)
    gltf = [row for row in rows if row["errors"]]

    def total(column: str, among: list[Row] = rows) -> str:
        return f"{sum(int(row[column]) for row in among):,}"

    kept = sum(row["lost"] == "0" for row in rows)
    both = sum(row["closed"] == row["closed_after"] == "1" for row in rows)
    largest = max(int(row["largest"]) for row in rows)
    pictures = (total("differing"), total("pixels"), f"{largest}")
    checked = (total("errors", gltf), total("errors_after", gltf), f"{len(gltf)}")
    return [f"{len(rows)}", f"{kept}", total("closed"), f"{both}", *pictures, *checked]


KEPT_MODELS = Sentence(
    "Of {} models, {} keep every byte but index data and what refers to it, and of {} that are closed,"
    " {} stay so. In pictures from eight sides, with their textures, colours and light, {} of {} pixels"
    " differ by more than one of 255 levels, none by more than {}. Khronos' validator finds {} errors"
    " before and {} after in {} glTF models.",
    models_kept,
)

_TESTS = {"none": "none", "file": "the file's order", "front": "front to back"}
_HIDING = {"cad": "sheet metal", "block": "a block of houses"}


def models_hidden() -> list[str]:
    """Return what other diagonals save behind a depth test."""
    lines = []
    for row in some("models-hidden.csv"):
        cells = []
        for what in ("lanes", "quads"):
            within = interval(row[f"{what}_low"], row[f"{what}_high"], two)
            several = row["models"] != "1"
            cells.append(
                f"{two(row[f'{what}_median'])} {within}" if several else two(row[f"{what}_median"])
            )
        kind = _HIDING[row["kind"]]
        lines.append(table_row(kind, _TESTS[row["depth"]], row["pixels"], *cells))
    return lines


def most_ties() -> list[str]:
    """Return the largest share of depth tests that are ties, in percent: of the parts, the block."""
    found = [
        max(float(row["ties"]) for row in some("models-hidden.csv", kind=kind)) for kind in _HIDING
    ]
    return [f"{100 * share:.4f}" if share < 1e-4 else f"{100 * share:.1f}" for share in found]


def models_reordered() -> list[str]:
    """Return what a vertex cache shades before and after other diagonals, in each order."""
    return [
        table_row(_KINDS[row["kind"]], row["order"], two(row["before"]), two(row["after"]))
        for row in some("models-reordered.csv")
    ]


STUDY_OF_MODELS: list[Held] = [
    Table("| flat | 64 px | 256 px | 1024 px |", flat_shares),
    Sentence(
        "With half of the area flat, {}, {} and {} % are saved, with a tenth {}, {} and {} %, with a"
        " hundredth {}, {} and {} %.",
        lambda: [each for share in ("0.5", "0.1", "0.01") for each in saved_by_share(share)],
    ),
    Sentence(
        "there the most that is saved is {} % of the helper lanes",
        lambda: [max(saved_by_share("0.05"), key=float)],
    ),
    Table("| models | depth test | px | helper lanes | shaded quads |", models_hidden),
    Sentence("At most {} % of the parts' depth tests are ties, and {} % of the block's", most_ties),
    Table("| models | order | before | after |", models_reordered),
    Table("| models | changed | px | helper lanes | shaded quads |", models),
    Sentence(
        "In three sentences: sheet metal with cut-outs saves {} to {} % of its helper lanes,"
        " extruded footprints {} to {} % and letters {} to {} %; at 1024 px that is {}, {} and {} % of the"
        " shaded quads.",
        model_savings,
    ),
    KEPT_MODELS,
]
FOUND_ON_MODELS = Sentence(
    "sheet metal with cut-outs saves {} to {} % of its helper lanes, extruded footprints {} to"
    " {} %.",
    lambda: model_savings()[:4],
)
MODELS_PLAN = (
    r"(?s)^.*?\n---\n",
    r"Run on 2026-11-23",
    r"at (1024|64) px",
    r"the 10 % that were expected|255 levels|cache of 16",
    r"(?s)## Registered on 2026-11-23, before it was measured.*?\*\*Result\.\*\*",
    r"a tie of 0\.02|more than 0\.02|\| flat \| 64 px \| 256 px \| 1024 px \|",
)

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
    held = NORMAL * RUN_SCATTER
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


def views_expected() -> list[str]:
    """Return what is expected of the helper lanes saved in many views, in ratio to those counted."""
    return [
        table_row(
            f"{row['pixels']} px",
            whole(row["saved"]),
            *(two(row[f"by_{what}"]) for what in ("e", "h", "q")),
        )
        for row in some("models-views.csv")
    ]


THEORY: list[Held] = [
    Table(
        "| size on the screen | saved a view | expected from E | from H of each view | from Q of each"
        " view |",
        views_expected,
    ),
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
