"""The matrix of a report: how well each criterion predicts each measurement.

A study (`harness validate`) leaves `correlations.csv` beside its run, with intervals; a plain run
has the rank correlation of its polygons' ratios.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.errors import UsageError
from harness.study.analysis import column, label, predictors

FILE = "correlations.csv"
WHERE = ("rasteriser", "device", "measure")
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
Cell = tuple[tuple[str, str, str], str, list[float | None]]
"""(rasteriser, device, measure), criterion, and the value with its interval."""


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
    table = pd.read_csv(file)
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise UsageError(f"{file} has no column {', '.join(missing)}; run validate again")
    table = table.reindex(columns=[*COLUMNS, "ci_low", "ci_high"])
    told = table[["value", "ci_low", "ci_high"]]
    values = told.apply(pd.to_numeric, errors="coerce")
    wrong = (values.isna() & told.notna()).any(axis=1)
    if wrong.any():
        raise UsageError(f"{file}, line {wrong.argmax() + 2}: not a number; run validate again")
    wheres = table[list(WHERE)].itertuples(index=False, name=None)
    kept = values.astype(object).where(np.isfinite(values), None).to_numpy().tolist()
    cells: dict[str, list[Cell]] = {}
    for statistic, *cell in zip(table["statistic"], wheres, table["criterion"], kept, strict=True):
        cells.setdefault(statistic, []).append(tuple(cell))
    known = [name for name in STATISTICS if name in cells]
    return [_matrix(name, cells[name]) for name in dict.fromkeys([*known, *cells])]


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


def _matrix(statistic: str, cells: Iterable[Cell]) -> Matrix:
    table = {(where, criterion): values for where, criterion, values in cells}
    columns = list(dict.fromkeys(where for where, _ in table))
    rows = sorted({criterion for _, criterion in table}, key=_place)
    return {
        "statistic": statistic,
        "title": STATISTICS.get(statistic, statistic.replace("_", " ")),
        "rows": [
            {"name": name, "title": predictors().get(column(name), name.replace("_", " "))}
            for name in rows
        ],
        "columns": [
            {**dict(zip(WHERE, where, strict=True)), "title": label(where[2])} for where in columns
        ],
        "cells": [[table.get((where, name)) for where in columns] for name in rows],
    }


def _place(criterion: str) -> tuple[int, str]:
    names = [*predictors(), column(criterion)]
    return names.index(column(criterion)), criterion
