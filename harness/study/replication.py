"""Our findings, each as a claim that is checked on other data: holds, does not hold, or not told.

A claim is a sentence of docs/findings.md with the figure that was measured there. `judge` looks in
the tables of one data set's studies for the same figure, with its interval.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from harness.metrics.registry import find_metric
from harness.stats.intervals import FEWEST
from harness.study.correlations import TIME, TOO_FEW

BEST, USUAL, DELAUNAY = "optimal:half-perimeter", "ear-clipping", "delaunay"
TURNED = "@0"
CHOICE = (USUAL, DELAUNAY, "refined", "optimal:overdraw", BEST)
ONCE = tuple(f"{name}{TURNED}" for name in (USUAL, "optimal:overdraw", BEST))
"""Triangulators of the study of rotation: triangulated at 0 degrees, then turned."""

RANKED = ("overdraw", "half-perimeter", "expected-quads", "edge-length", "shape")
"""Criteria that differ between the triangulations of a polygon, and that findings.md compares."""

BOX_WALKER = "bounding-box"

# Figures of docs/findings.md for each claim, on our own scenes; tests/docs/test_figures.py compares
# them with the files under results/reference.
Q_RANKS_LANES = "0.996 (0.993 to 0.998)"
H_BEFORE_A_BY_LANES = "0.983 (0.961 to 0.993), A 0.869 (0.770 to 0.928)"
H_BEFORE_A_BY_TIME = "0.970 (0.925 to 0.985), A 0.901 (0.800 to 0.918)"
A_RANKS_TESTS = "1.000"
D_IS_LAST = "0.751 (0.521 to 0.794)"
H_AGAINST_EAR_CLIPPING = "0.839 of its time (city, 1024 px)"
H_AGAINST_DELAUNAY = "0.945 of its time (city, 1024 px)"
H_AGAINST_DELAUNAY_WALKED = "0.933 of its time (Helsinki, 1024 px); 1.000 on letters"
REGRET_OF_Q = "0.01 % (0.00 to 0.02) (city, 1024 px)"
H_TURNED = "0.92 at the worst angle (city, 512 px)"
A_TURNED = "0.99 at the worst angle (city, 512 px)"


Evidence = dict[str, pd.DataFrame]
"""Tables of one data set's studies, by their names in `TABLES`; left out where there is none."""

TABLES = {
    "correlations": "validate/correlations.csv",
    "compared": "validate/criteria_compared.csv",
    "regret": "validate/regret.csv",
    "choice": "choice/gains.csv",
    "walked": "walked/gains.csv",
    "turned": "turned/gains.csv",
}
"""Where a study keeps them: `gains` of triangles as they are given, in walk order, and turned."""


@dataclass(frozen=True)
class Figure:
    """A figure with its interval, and whether it bears the claim out.

    beside : what it is set against, in words
    few : whether it is of too few polygons to judge a claim by
    """

    value: float
    low: float
    high: float
    holds: bool = True
    percent: bool = False
    beside: str = ""
    few: bool = False

    @property
    def verdict(self) -> str:
        """What it says of the claim."""
        return TOO_FEW if self.few else "holds" if self.holds else "does not hold"

    @property
    def written(self) -> str:
        """The figure and its interval."""
        form = "{:.2%}" if self.percent else "{:.3f}"
        value, low, high = (form.format(each) for each in (self.value, self.low, self.high))
        point = np.isnan(self.low) or self.low == self.high
        return (value if point else f"{value} ({low} to {high})") + self.beside


class Claim(NamedTuple):
    """One sentence of our findings.

    ours : the figure that docs/findings.md gives; check : evidence -> the same figure here, and
        whether it bears the claim out; None where the studies do not tell
    """

    sentence: str
    ours: str
    check: Callable[[Evidence], Figure | None]


def _row(
    table: pd.DataFrame | None, *, walker: bool = False, **where: str
) -> pd.Series[Any] | None:
    """Return the row with these values, of the largest view, on OpenGL or the walker of boxes.

    The CPU reference counts what OpenGL counts, and stands in where there is none.
    """
    if table is None:
        return None
    for name, value in where.items():
        table = table[table[name] == value]
    rows = table[(table["rasteriser"] == BOX_WALKER) == walker]
    if "resolution" in rows:
        rows = rows[rows["resolution"] == rows["resolution"].max()]
    rows = rows.sort_values("rasteriser", key=lambda n: n == "reference", kind="stable")
    return None if rows.empty else rows.iloc[0]


def _figure(row: pd.Series[Any] | None, *names: str, **more: Any) -> Figure | None:
    """Return a row's figure: value, low and high are its columns `names`."""
    if row is None:
        return None
    few = row.get("polygons", FEWEST) < FEWEST
    value, low, high = (float(row[name]) for name in names)
    return Figure(value, low, high, few=bool(few), **more)


def _correlation(
    evidence: Evidence, criterion: str, measure: str, least: float = -1.0, *, walker: bool = False
) -> Figure | None:
    """Check that a rank correlation within polygons is no less than `least`."""
    table = evidence.get("correlations")
    if table is not None:
        table = table[(table["statistic"] == "spearman_within") & table["value"].notna()]
    row = _row(table, walker=walker, criterion=criterion, measure=measure)
    found = _figure(row, "value", "ci_low", "ci_high")
    return found and replace(found, holds=found.value >= least)


def _h_ahead(evidence: Evidence, measure: str) -> Figure | None:
    """Check that H ranks better than A, by differences within each polygon."""
    h, a = "half-perimeter", "overdraw"
    one, two = (_correlation(evidence, name, measure) for name in (h, a))
    if one is None or two is None:
        return None
    beside = f", A {two.written}"
    # The table has what A is better by.
    row = _row(evidence.get("compared"), measure=measure, criterion=a, other=h)
    found = _figure(row, "difference", "ci_high", "ci_low")
    if found is None:
        return replace(one, beside=beside, few=True)
    found = replace(found, value=-found.value, low=-found.low, high=-found.high)
    beside += f", difference {found.written}"
    return replace(one, holds=found.low > 0, few=found.few, beside=beside)


def _shape_is_last(evidence: Evidence) -> Figure | None:
    told = (_correlation(evidence, name, "helper_lanes") for name in RANKED)
    found = [each for each in told if each is not None]
    if len(found) < len(RANKED):
        return None
    *others, shape = found
    return replace(shape, holds=shape.value < min(each.value for each in others))


def _faster(table: pd.DataFrame | None, base: str) -> Figure | None:
    """Check that the best for H takes less time than `base`, in the largest view."""
    row = _row(table, triangulator=BEST, base=base)
    found = _figure(row, *(f"time_ratio{end}" for end in ("", "_low", "_high")))
    return found and replace(found, holds=found.high < 1)


def _regret(evidence: Evidence, criterion: str, measure: str, most: float) -> Figure | None:
    """Check that trusting a criterion costs at most a share `most`, in the largest view."""
    row = _row(evidence.get("regret"), kind="criterion", name=criterion, measure=measure)
    if row is None:
        return None
    found = _figure(row, "mean", "ci_low", "ci_high", percent=True)
    # Where all lose the same, the most that any lost has to do.
    known = row["worst"] if np.isnan(row["ci_high"]) else row["ci_high"]
    return found and replace(found, holds=bool(known <= most))


def _kept(evidence: Evidence, triangulator: str, *, keeps: bool) -> Figure | None:
    """Check whether what is turned keeps helper lanes at 0.95 of ear clipping's at the worst."""
    table = evidence.get("turned")
    if table is None:
        return None
    rows = table[table["triangulator"] == f"{triangulator}{TURNED}"]
    rows = rows[(rows["base"] == f"{USUAL}{TURNED}") & (rows["rasteriser"] != BOX_WALKER)]
    ratio = "helper_lanes_ratio"
    worst = rows.nlargest(1, ratio)
    found = None if worst.empty else _figure(worst.iloc[0], ratio, ratio, ratio)
    return found and replace(found, holds=(found.value <= 0.95) == keeps)


CLAIMS = (
    Claim(
        "Within a polygon, Q predicts helper lanes: rank correlation of 0.95 or more",
        Q_RANKS_LANES,
        lambda e: _correlation(e, "expected-quads", "helper_lanes", 0.95),
    ),
    Claim(
        "H predicts helper lanes better than the paper's A, polygon by polygon",
        H_BEFORE_A_BY_LANES,
        lambda e: _h_ahead(e, "helper_lanes"),
    ),
    Claim(
        "H predicts the draw time better than the paper's A, polygon by polygon",
        H_BEFORE_A_BY_TIME,
        lambda e: _h_ahead(e, f"{TIME}0"),
    ),
    Claim(
        "Where bounding boxes are walked, A predicts the tests: rank correlation of 0.999 or more",
        A_RANKS_TESTS,
        lambda e: _correlation(e, "overdraw", "bbox_tests", 0.999, walker=True),
    ),
    Claim(
        "D, the shape, predicts helper lanes worst of the criteria that can rank",
        D_IS_LAST,
        _shape_is_last,
    ),
    Claim(
        "The best for H is drawn faster than ear clipping's triangles",
        H_AGAINST_EAR_CLIPPING,
        lambda e: _faster(e.get("choice"), USUAL),
    ),
    Claim(
        "The best for H is drawn faster than Delaunay's triangles",
        H_AGAINST_DELAUNAY,
        lambda e: _faster(e.get("choice"), DELAUNAY),
    ),
    Claim(
        "It is so in the same order of triangles, too: the gain is one of diagonals",
        H_AGAINST_DELAUNAY_WALKED,
        lambda e: _faster(e.get("walked"), DELAUNAY),
    ),
    Claim(
        "Trusting Q costs at most 1 % more quads than the fewest there are",
        REGRET_OF_Q,
        lambda e: _regret(e, "expected-quads", "quads", 0.01),
    ),
    Claim(
        "Triangulated once and turned, the best for H keeps helper lanes at 0.95 of ear clipping's"
        " or less",
        H_TURNED,
        lambda e: _kept(e, BEST, keeps=True),
    ),
    Claim(
        "Triangulated once and turned, the best for A loses its advantage: 0.95 or more",
        A_TURNED,
        lambda e: _kept(e, "optimal:overdraw", keeps=False),
    ),
)


def judge(evidence: Evidence) -> list[tuple[Claim, Figure | None]]:
    """Return each claim with what the evidence says of it."""
    return [(claim, claim.check(evidence)) for claim in CLAIMS]


def read(folder: Path) -> Evidence:
    """Return the tables that a study left in its folder."""
    files = {name: folder / file for name, file in TABLES.items()}
    return {name: pd.read_csv(file) for name, file in files.items() if file.is_file()}


def page(named: Sequence[tuple[str, Evidence]], where: str) -> str:
    """Return a page of findings in Markdown, in the shape of docs/findings.md.

    named : (name of the data set, its evidence); where : the machine and device, in words
    """
    lines = ["# Findings on other data", "", where, ""]
    lines += ["| data | hold | do not hold | too few or not told |", "|---|---|---|---|"]
    judged = [(name, judge(evidence)) for name, evidence in named]
    for name, found in judged:
        told = [figure for _, figure in found if figure is not None and not figure.few]
        hold = sum(figure.holds for figure in told)
        lines.append(f"| {name} | {hold} | {len(told) - hold} | {len(found) - len(told)} |")
    for name, found in judged:
        lines += ["", f"## {name}", "", "| finding | ours | here | |", "|---|---|---|---|"]
        for claim, figure in found:
            here = "" if figure is None else figure.written
            verdict = "not told" if figure is None else figure.verdict
            lines.append(f"| {claim.sentence} | {claim.ours} | {here} | {verdict} |")
    letters = ", ".join(f"{find_metric(name).symbol}: {find_metric(name).label}" for name in RANKED)
    return "\n".join([*lines, "", f"{letters}.", ""])
