"""The figures of docs/findings-tables.md."""

import math
from collections.abc import Callable
from itertools import product
from typing import Any

from docs.held import Held, findings, flips, profiles, shown
from docs.held.findings import Q_H_A, SCENES, correlation, gain, ordered, regret
from docs.held.lookups import bold, crossed, ends, grid, matched, one, some, table_row, values
from docs.held.names import BEST_FOR_A, BEST_FOR_H, BEST_FOR_Q, CALLED, NAMES, REFINED
from harness.study.regret import why_no_interval

CALIBRATED = "optimal:calibrated"

PEERS = (
    *("delaunay", "earcut-refine", "greedy", "manifold", BEST_FOR_A, BEST_FOR_Q),
    *("flips:beauty", "flips:l1", REFINED, BEST_FOR_H, CALIBRATED),
)
"""Columns of the table of draw times."""
ON_DEVICES = (BEST_FOR_H, REFINED, BEST_FOR_Q, BEST_FOR_A, "delaunay")
ORDERED = (BEST_FOR_H, REFINED, "greedy", BEST_FOR_Q, BEST_FOR_A, "delaunay")
KEPT = 0.93
"""What an interval of 95 % is asked to hold the truth in."""


def device_view(device: str, scene: str) -> Any:
    """Return what a device measured of a scene at 1024 px."""
    views = values(f"devices/{device}.json")["views"]
    return next(v for v in views if v["scene"] == scene and v["resolution"] == 1024)


def _predicts() -> Callable[[], list[str]]:
    """Return what makes the table of rank correlations within a polygon."""

    def cell(criterion: str, of: tuple[str, str]) -> str:
        row = correlation(criterion, *of)
        best = row["value"] == max(correlation(each, *of)["value"] for each in CALLED["criteria"])
        interval = f" ({row['ci_low']:.3f}-{row['ci_high']:.3f})" * (of[1] == "opengl")
        return bold(f"{row['value']:.3f}", best) + interval

    columns = [
        *product(("helper_lanes", "partial_quads", "time_work_0", "time_work_8"), ("opengl",)),
        *product(("bbox_tests", "time_work_0"), ("bounding-box",)),
    ]
    return grid(CALLED["criteria"], columns, cell)


def _sizes() -> Callable[[], list[str]]:
    """Return what makes the table of rank correlations by the viewport's size."""

    def cell(px: int, of: tuple[str, str]) -> str:
        file = f"cpu/validate-{of[0]}-sizes/correlations_by_resolution.csv"
        where = {"resolution": px, "criterion": of[1], "measure": "helper_lanes"}
        value = one(file, statistic="spearman_within", **where)["value"]
        return bold(f"{value:.3f}", of[1] == "expected_quads")

    labels = {px: f"{px} px" for px in (64, 256, 1024)}
    return grid(labels, product(("city", "helsinki"), Q_H_A), cell)


def _regrets(*scenes: str) -> Callable[[], list[str]]:
    """Return what makes the table of helper lanes above the fewest there are."""

    def cell(who: str, of: tuple[str, int]) -> str:
        row = regret(*of, who)
        digits = "%" if row["mean"] >= 0.001 else ".2%"
        mean, low, high = (shown(row[name], digits) for name in ("mean", "ci_low", "ci_high"))
        why = why_no_interval(row) if math.isnan(row["ci_low"]) else f"{low}-{high}"
        return f"{mean} % ({why})"

    labels = {who: f"**{who}**" if who == "Q" else who for who in findings.TRUSTED}
    return grid(labels, product(scenes, (256, 1024)), cell)


def _states() -> list[str]:
    """Return a row for each state: its runs, what they are called, and what is said of them."""
    lines = []
    for state, what in CALLED["states"].items():
        runs = some("states/states.csv", state=state)
        planted = some("states/planted.csv", state=state)["compare"]
        best = some("states/ratios.csv", state=state, scene="city", triangulator=BEST_FOR_H)
        calls = [sum(runs["told"] == each) for each in ("quiet", "disturbed", "not to be trusted")]
        draws = "{:.2f} to {:.2f}".format(*ends(runs[runs["scene"] == "city"]["reference_ms"]))
        ratios = "{:.3f} to {:.3f}".format(*ends(best["ratio"]))
        # A quiet run is among those that a sentence is held against.
        wrong = "-" if state == "quiet" else sum(runs["wrong"])
        said = sum(runs["compare"] == 1), wrong
        cells = (len(runs), *calls, draws, ratios, *said, f"{sum(planted == 1)} of {len(planted)}")
        lines.append(table_row(what, *map(str, cells)))
    return lines


def _intervals() -> list[str]:
    """Return a row for each producer of intervals: how often they hold the truth, and where not."""
    lines = []
    for name, label in CALLED["intervals"].items():
        rows = some("coverage.csv", interval=name)
        lost = rows[rows["covered"] < KEPT]
        least = rows["covered"].drop(lost.index).min()
        before = rows["before"].drop(lost.index)
        simpler = f"{before.min():.3f}" if before.any() else ""
        told = (f"{row['data']}: {row['covered']:.3f}" for _, row in lost.iterrows())
        lines.append(table_row(label, str(len(rows)), f"{least:.3f}", simpler, "; ".join(told)))
    laws = some("law-coverage-profiles.csv")
    lost = laws[laws["within"] < KEPT]
    told = [
        f"as {row['profile']} misses it: {row['within']:.3f}, a false cost in"
        f" {shown(1 - row['nothing_shown'], '%')} % of devices"
        for _, row in lost.iterrows()
    ]
    told.insert(0, f"`draw` alone: {one('law-coverage.csv', term='draw')['within']:.3f}")
    kept = [one("law-coverage.csv", term="all")["within"], *laws["within"].drop(lost.index)]
    cells = (str(1 + len(laws)), f"{min(kept):.3f}", "", "; ".join(told))
    return [*lines, table_row("costs of a device's law (`profile`), pooled", *cells)]


TABLES: Held = {
    "| | helper lanes | partial quads | time, work 0 | time, work 8 | box tests"
    " | time, box walk |": _predicts(),
    "| helper lanes, viewport | city: Q | H | A | Helsinki: Q | H | A |": _sizes(),
    "correlation of {:.3f} with helper lanes, D of {:.3f}, A of {:.3f} and Q of {:.3f}.": lambda: [
        correlation(each, "helper_lanes", statistic="spearman_pooled")["value"]
        for each in ("half_perimeter", "shape", "overdraw", "expected_quads")
    ],
    "over {:.0f} polygons of the city ... {:.0f} ... {:.0f} letters and {:.0f} counties": lambda: [
        regret(scene, 1024, "H")["polygons"] for scene in SCENES
    ],
    "| chosen by | city, 256 px | city, 1024 px | Helsinki, 256 px | Helsinki, 1024 px |": _regrets(
        "city", "helsinki"
    ),
    "| chosen by | letters, 256 px | letters, 1024 px | counties, 256 px"
    " | counties, 1024 px |": _regrets("glyphs", "counties"),
    "at most {:.2%} % more than the fewest at 1024 px ... at most {:.2%} % more at 256 px. ... is"
    " {:.2%} % for H's choice and {:.2%} % for A's.": lambda: [
        max(regret(scene, px, who, "quads")["mean"] for scene in SCENES)
        for px, who in ((1024, "Q"), (256, "Q"), (1024, "H"), (1024, "A"))
    ],
    "| scene, px | Delaunay | `refine` | greedy | manifold | best for A | best for Q |"
    " `flips:beauty` | L1 flips | `refined` | best for H | **calibrated** |"
    " calibrated over Delaunay |": grid(
        crossed(SCENES, (256, 1024, 4096), ", "),
        PEERS,
        lambda of, name: gain(*of, name),
        ".3f",
        least="row",
        more=lambda of: [f"{gain(*of, CALIBRATED, 'delaunay'):.3f}"],
    ),
    "takes {:.2f} of ear clipping's time, the best for H ... {:.2f} and Delaunay {:.2f}": lambda: [
        gain("city", 1024, name, rasteriser="bounding-box")
        for name in (BEST_FOR_A, BEST_FOR_H, "delaunay")
    ],
    "| | city: own | cache | walk | Helsinki: own | cache | walk | letters: own | cache | walk"
    " | counties: own | cache | walk |": grid(
        {name: bold(NAMES[name], name == BEST_FOR_H) for name in ORDERED},
        product(SCENES, ("own", "vertex-cache", "walk")),
        lambda name, of: ordered(of[0], name)[of[1]],
        ".3f",
        least="column",
    ),
    **flips.PAID,
    "Of 11 findings, {}, {}, {} and {} hold on them.": lambda: [
        matched("llvmpipe/study/findings.md", rf"\| {name} \| (\d+) \|")[0]
        for name in ("poly2tri-testbed", "earcut-fixtures", "helsinki-areas", "cad")
    ],
    "| beside the run | runs | quiet | disturbed | not to be trusted | reference draw, ms"
    " | best for H | false regressions | wrong sentences | planted, found |": _states,
    **profiles.TABLES,
    "| interval of | kinds of data | holds, least | a simpler one | not kept |": _intervals,
}
