"""What a report says of criteria, in one sentence: which predicts the cost best."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from harness.figures.registry import find, measures, predictions
from harness.study.analysis import TIME
from harness.study.analysis import column as column_of
from harness.study.statistics import Estimate

Correlations = Mapping[str, Mapping[str, float | None]]
"""measure -> criterion -> rank correlation of ratios."""


def criteria_of(
    measure: str | None,
    correlations: Correlations,
    within: Mapping[str, Estimate] | None = None,
) -> str:
    """Return one sentence about which criterion to use, "" where none was judged.

    measure : the group's main counter, None if nothing was counted a polygon
    within : criterion -> rank correlation with it within single polygons, where that is known
    """
    if within:
        values = {name: each.value for name, each in within.items()}
    else:
        told = correlations.get(measure or "", {}).items()
        values = {name: v for name, v in told if v is not None and name in predictions()}
    if not values:
        return ""
    best = max(values, key=values.__getitem__)
    words = "Within a polygon" if within else "Of the criteria"
    words += f", {find(best).title} predicts {find(measure or '').label} best "
    words += f"(rank correlation {values[best]:.2f}"
    if within:
        first = within[best]
        words += "" if math.isnan(first.low) else f", {first.low:.2f} to {first.high:.2f}"
        words += f", over {first.polygons} polygons"
    if best != "overdraw" and "overdraw" in values:
        words += f"; {find('overdraw').title} {values['overdraw']:.2f}"
    return f"{words})."


def answer_of_study(matrices: Sequence[Mapping[str, Any]]) -> str | None:
    """Return one sentence about a study's first matrix, None where it has no figure to name.

    Helper lanes come first, then bounding-box tests, then whatever was measured.
    """
    if not matrices:
        return None
    matrix = matrices[0]
    columns = [column["measure"] for column in matrix["columns"]]
    wanted = [*measures(name for name in columns if not name.startswith(TIME)), *columns]
    place = columns.index(wanted[0])
    known = {
        row["title"]: cells[place]
        for row, cells in zip(matrix["rows"], matrix["cells"], strict=True)
        if column_of(row["name"]) in predictions() and cells[place] and cells[place][0] is not None
    }
    if not known:
        return None
    best = max(known, key=lambda title: known[title][0])
    value, low, high = known[best]
    interval = "" if low is None else f", 95 % interval {low:.2f} to {high:.2f}"
    column = matrix["columns"][place]
    where = f"{column['rasteriser']} on {column['device']}"
    words = f"{best} predicts the {column['title']} of {where} best "
    words += f"({matrix['title']} {value:.2f}{interval})"
    paper = find("overdraw").title
    if best != paper and paper in known:
        words += f"; {paper} reaches {known[paper][0]:.2f}"
    return f"{words[0].upper()}{words[1:]}."
