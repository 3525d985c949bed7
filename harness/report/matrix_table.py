"""The matrix of a report: how well each criterion predicts each measurement.

A study (`harness validate`) leaves `correlations.csv` beside its run, with intervals; a plain run
has the rank correlation of its polygons' ratios.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from harness.errors import UsageError
from harness.study.analysis import column, label, predictors

FILE = "correlations.csv"
COLUMNS = ("rasteriser", "device", "criterion", "measure", "statistic", "value")

STATISTICS = {
    "spearman_within": "rank correlation within a polygon",
    "kendall_within": "Kendall's tau within a polygon",
    "slope_within": "slope within a polygon (log against log)",
    "spearman_pooled": "rank correlation over all polygons (misleads: size alone makes it high)",
    "spearman_partial": "rank correlation, triangle count held fixed",
    "spearman_of_ratios": "rank correlation of ratios to the base triangulator",
}

Matrix = dict[str, Any]


def from_study(folder: Path) -> list[Matrix]:
    """Return one matrix per statistic of the study in `folder`, [] where there is none.

    Raises
    ------
    UsageError
        if `correlations.csv` lacks a column or holds something that is not a number
    """
    file = folder / FILE
    if not file.is_file():
        return []
    with file.open(newline="", encoding="utf-8") as lines:
        reader = csv.DictReader(lines)
        missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
        if missing:
            raise UsageError(f"{file} has no column {', '.join(missing)}; run validate again")
        rows = list(reader)
    cells: dict[str, list[tuple[tuple[str, str, str], str, list[float | None]]]] = {}
    for number, row in enumerate(rows, start=2):
        where = (row["rasteriser"], row["device"], row["measure"])
        try:
            values = [_number(row.get(name)) for name in ("value", "ci_low", "ci_high")]
        except ValueError:
            raise UsageError(f"{file}, line {number}: not a number; run validate again") from None
        cells.setdefault(row["statistic"], []).append((where, row["criterion"], values))
    known = [name for name in STATISTICS if name in cells]
    ordered = known + [name for name in cells if name not in STATISTICS]
    return [_matrix(name, cells[name]) for name in ordered]


def from_run(
    found: Iterable[tuple[tuple[str, str, str], Mapping[str, float | None]]],
) -> list[Matrix]:
    """Return the matrix of a run's ((rasteriser, device, measure), criterion -> value) pairs."""
    cells = [
        (where, criterion, [value, None, None])
        for where, values in found
        for criterion, value in values.items()
    ]
    return [_matrix("spearman_of_ratios", cells)] if cells else []


def _matrix(
    statistic: str, cells: Iterable[tuple[tuple[str, str, str], str, list[float | None]]]
) -> Matrix:
    table = {(where, criterion): values for where, criterion, values in cells}
    columns = list(dict.fromkeys(where for where, _ in table))
    rows = sorted({criterion for _, criterion in table}, key=_place)
    return {
        "statistic": statistic,
        "title": STATISTICS.get(statistic, statistic.replace("_", " ")),
        "rows": [{"name": name, "title": _title(name)} for name in rows],
        "columns": [
            {
                "rasteriser": rasteriser,
                "device": device,
                "measure": measure,
                "title": label(measure),
            }
            for rasteriser, device, measure in columns
        ],
        "cells": [[table.get((where, name)) for where in columns] for name in rows],
    }


def _place(criterion: str) -> tuple[int, str]:
    names = list(predictors())
    name = column(criterion)
    return (names.index(name) if name in names else len(names), criterion)


def _title(criterion: str) -> str:
    return predictors().get(column(criterion), criterion.replace("_", " "))


def _number(text: str | None) -> float | None:
    if not text:
        return None
    value = float(text)
    return value if math.isfinite(value) else None
