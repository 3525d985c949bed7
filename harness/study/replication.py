"""Replication of the findings on other data: each holds, does not hold, or is undecided.

A claim is a sentence of docs/findings.md with the result there. `evaluate_claims` computes the same
result, with an interval, from the tables of the studies of a data set.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from harness.metrics.registry import find_metric
from harness.metrics.statistics import MIN_VALUES
from harness.study.correlations import TIME, TOO_FEW

H_OPTIMAL, EAR_CLIPPING, DELAUNAY = "optimal:half-perimeter", "ear-clipping", "delaunay"
UPRIGHT_SUFFIX = "@0"  # triangulated at 0 degrees, before the scene is rotated

TIMED_TRIANGULATORS = (EAR_CLIPPING, DELAUNAY, "refined", "optimal:overdraw", H_OPTIMAL)
"""Triangulators of the study of draw times, from which a user may choose."""

ROTATED_TRIANGULATORS = tuple(  # of the study of rotation
    f"{name}{UPRIGHT_SUFFIX}" for name in (EAR_CLIPPING, "optimal:overdraw", H_OPTIMAL)
)

RANKED = ("overdraw", "half-perimeter", "expected-quads", "edge-length", "shape")
"""Criteria that findings.md compares, and that differ between triangulations of a polygon."""

BOX_RASTERISER = "bounding-box"

Evidence = dict[str, pd.DataFrame]  # tables of a data set's studies, by name in `TABLES`

TABLES = {  # gains.csv: triangles in native order, in walk order, and rotated
    "correlations": "validate/correlations.csv",
    "compared": "validate/criteria_compared.csv",
    "regret": "validate/regret.csv",
    "choice": "choice/gains.csv",
    "walked": "walked/gains.csv",
    "turned": "turned/gains.csv",
}


@dataclass(frozen=True)
class Finding:
    """A result with an interval, and whether the result supports the claim."""

    value: float
    low: float
    high: float
    holds: bool = True
    percent: bool = False
    comparison: str = ""  # text about the compared value, which follows the result in `text`
    too_few: bool = False  # too few polygons to decide

    @property
    def verdict(self) -> str:
        """The verdict in words: holds, does not hold, or too few polygons."""
        return TOO_FEW if self.too_few else "holds" if self.holds else "does not hold"

    @property
    def text(self) -> str:
        """The result with the interval."""
        form = "{:.2%}" if self.percent else "{:.3f}"
        value, low, high = map(form.format, (self.value, self.low, self.high))
        is_point = np.isnan(self.low) or self.low == self.high
        return (value if is_point else f"{value} ({low} to {high})") + self.comparison


class Claim(NamedTuple):
    """A sentence of docs/findings.md, its result there, and the check of the result elsewhere."""

    sentence: str
    reference: str  # tests/docs/test_figures.py compares it with results/reference
    check: Callable[[Evidence], Finding | None]


def _find_row(
    table: pd.DataFrame | None, *, boxes: bool = False, **values: str
) -> pd.Series[Any] | None:
    """Return the row whose columns have `values`, in the largest viewport, or None.

    boxes : True for the rasteriser that scans bounding boxes; False for OpenGL, else the CPU
    reference
    """
    if table is None:
        return None
    for name, value in values.items():
        table = table[table[name] == value]
    rows = table[(table["rasteriser"] == BOX_RASTERISER) == boxes]
    if "resolution" in rows:
        rows = rows[rows["resolution"] == rows["resolution"].max()]
    rows = rows.sort_values("rasteriser", key=lambda n: n == "reference", kind="stable")
    return None if rows.empty else rows.iloc[0]


def _make_finding(row: pd.Series[Any] | None, *names: str, **fields: Any) -> Finding | None:
    """Return the finding in a row; `names` are columns of the value and its interval's ends."""
    if row is None:
        return None
    too_few = row.get("polygons", MIN_VALUES) < MIN_VALUES
    value, low, high = (float(row[name]) for name in names)
    return Finding(value, low, high, too_few=bool(too_few), **fields)


def _check_correlation(
    evidence: Evidence, criterion: str, measure: str, minimum: float = -1.0, *, boxes: bool = False
) -> Finding | None:
    table = evidence.get("correlations")
    if table is not None:
        table = table[(table["statistic"] == "spearman_within") & table["value"].notna()]
    row = _find_row(table, boxes=boxes, criterion=criterion, measure=measure)
    finding = _make_finding(row, "value", "ci_low", "ci_high")
    return finding and replace(finding, holds=finding.value >= minimum)


def _check_h_against_a(evidence: Evidence, measure: str) -> Finding | None:
    """Check that H has a higher rank correlation than A, by differences within polygons."""
    h, a = "half-perimeter", "overdraw"
    of_h, of_a = (_check_correlation(evidence, name, measure) for name in (h, a))
    if of_h is None or of_a is None:
        return None
    comparison = f", A {of_a.text}"
    # The table has A - H, so the sign changes.
    row = _find_row(evidence.get("compared"), measure=measure, criterion=a, other=h)
    gap = _make_finding(row, "difference", "ci_high", "ci_low")
    if gap is None:
        return replace(of_h, comparison=comparison, too_few=True)
    gap = replace(gap, value=-gap.value, low=-gap.low, high=-gap.high)
    comparison += f", difference {gap.text}"
    return replace(of_h, holds=gap.low > 0, too_few=gap.too_few, comparison=comparison)


def _check_shape_is_last(evidence: Evidence) -> Finding | None:
    """Check that the shape D has the lowest rank correlation with helper lanes in `RANKED`."""
    checks = (_check_correlation(evidence, name, "helper_lanes") for name in RANKED)
    findings = [finding for finding in checks if finding is not None]
    if len(findings) < len(RANKED):
        return None
    *compared, shape = findings
    return replace(shape, holds=shape.value < min(finding.value for finding in compared))


def _check_faster(table: pd.DataFrame | None, base: str) -> Finding | None:
    """Check that triangulations with minimum half-perimeter (H) are drawn faster than `base`."""
    timed = None if table is None else table.dropna(subset="time_ratio")
    row = _find_row(timed, triangulator=H_OPTIMAL, base=base)
    finding = _make_finding(row, *(f"time_ratio{end}" for end in ("", "_low", "_high")))
    return finding and replace(finding, holds=finding.high < 1)


def _check_regret(evidence: Evidence, criterion: str, measure: str, limit: float) -> Finding | None:
    """Check that a criterion's regret is at most `limit`, in the largest view."""
    row = _find_row(evidence.get("regret"), kind="criterion", name=criterion, measure=measure)
    if row is None:
        return None
    finding = _make_finding(row, "mean", "ci_low", "ci_high", percent=True)
    # Without an interval, as when all regrets are equal, the maximum is used.
    upper = row["worst"] if np.isnan(row["ci_high"]) else row["ci_high"]
    return finding and replace(finding, holds=bool(upper <= limit))


def _check_rotation(evidence: Evidence, triangulator: str, *, below: bool) -> Finding | None:
    """Check helper lanes of rotated triangles relative to ear clipping's, at the worst angle."""
    table = evidence.get("turned")
    if table is None:
        return None
    rows = table[table["triangulator"] == f"{triangulator}{UPRIGHT_SUFFIX}"]
    rows = rows[
        (rows["base"] == f"{EAR_CLIPPING}{UPRIGHT_SUFFIX}") & (rows["rasteriser"] != BOX_RASTERISER)
    ]
    ratio = "helper_lanes_ratio"
    worst = rows.nlargest(1, ratio)
    finding = None if worst.empty else _make_finding(worst.iloc[0], ratio, ratio, ratio)
    return finding and replace(finding, holds=(finding.value <= 0.95) == below)


CLAIMS = (
    Claim(
        "Within a polygon, Q predicts helper lanes: rank correlation of at least 0.95",
        "0.996 (0.993 to 0.998)",
        lambda e: _check_correlation(e, "expected-quads", "helper_lanes", 0.95),
    ),
    Claim(
        "H predicts helper lanes better than the paper's A, polygon by polygon",
        "0.983 (0.961 to 0.993), A 0.869 (0.770 to 0.928)",
        lambda e: _check_h_against_a(e, "helper_lanes"),
    ),
    Claim(
        "H predicts the draw time better than the paper's A, polygon by polygon",
        "0.947 (0.911 to 0.974), A 0.874 (0.733 to 0.920)",
        lambda e: _check_h_against_a(e, f"{TIME}0"),
    ),
    Claim(
        "A predicts the pixel tests of a rasteriser that scans bounding boxes: rank correlation of"
        " at least 0.999",
        "1.000",
        lambda e: _check_correlation(e, "overdraw", "bbox_tests", 0.999, boxes=True),
    ),
    Claim(
        "Of the criteria, D (shape) predicts helper lanes worst",
        "0.751 (0.521 to 0.794)",
        _check_shape_is_last,
    ),
    Claim(
        "H-optimal triangulations are drawn faster than ear clipping",
        "0.851 of its time (city, 1024 px)",
        lambda e: _check_faster(e.get("choice"), EAR_CLIPPING),
    ),
    Claim(
        "H-optimal triangulations are drawn faster than Delaunay",
        "0.950 of its time (city, 1024 px)",
        lambda e: _check_faster(e.get("choice"), DELAUNAY),
    ),
    Claim(
        "H-optimal triangulations are faster than Delaunay also if both are in the order of a walk,"
        " so the gain is due to the diagonals",
        "0.936 of its time (Helsinki, 1024 px); 1.001 on letters",
        lambda e: _check_faster(e.get("walked"), DELAUNAY),
    ),
    Claim(
        "The regret of Q is at most 1 % of the quads",
        "0.01 % (0.00 to 0.02) (city, 1024 px)",
        lambda e: _check_regret(e, "expected-quads", "quads", 0.01),
    ),
    Claim(
        "Rotated after triangulation, H-optimal triangulations have at most 0.95 of ear clipping's"
        " helper lanes",
        "0.92 at the worst angle (city, 512 px)",
        lambda e: _check_rotation(e, H_OPTIMAL, below=True),
    ),
    Claim(
        "Rotated after triangulation, A-optimal triangulations have more than 0.95 of ear"
        " clipping's helper lanes",
        "0.99 at the worst angle (city, 512 px)",
        lambda e: _check_rotation(e, "optimal:overdraw", below=False),
    ),
)


def evaluate_claims(evidence: Evidence) -> list[tuple[Claim, Finding | None]]:
    """Return each claim with the finding in the evidence."""
    return [(claim, claim.check(evidence)) for claim in CLAIMS]


def read_evidence(folder: Path) -> Evidence:
    """Return the tables of `TABLES` that exist in a study's folder."""
    files = {name: folder / file for name, file in TABLES.items()}
    return {name: pd.read_csv(file) for name, file in files.items() if file.is_file()}


def format_page(data_sets: Sequence[tuple[str, Evidence]], conditions: str) -> str:
    """Return a page in Markdown with the finding for each claim and (name, evidence)."""
    lines = ["# Findings on other data", "", conditions, ""]
    lines += ["| data | hold | do not hold | undecided |", "|---|---|---|---|"]
    results = [(name, evaluate_claims(evidence)) for name, evidence in data_sets]
    for name, pairs in results:
        decided = [finding for _, finding in pairs if finding is not None and not finding.too_few]
        hold = sum(finding.holds for finding in decided)
        lines.append(f"| {name} | {hold} | {len(decided) - hold} | {len(pairs) - len(decided)} |")
    for name, pairs in results:
        lines += ["", f"## {name}", "", "| finding | reference | here | |", "|---|---|---|---|"]
        for claim, finding in pairs:
            result = "" if finding is None else finding.text
            verdict = "not measured" if finding is None else finding.verdict
            lines.append(f"| {claim.sentence} | {claim.reference} | {result} | {verdict} |")
    letters = ", ".join(f"{find_metric(name).symbol}: {find_metric(name).label}" for name in RANKED)
    return "\n".join([*lines, "", f"{letters}.", ""])
