"""The matrix of a report: how well each criterion predicts each measurement.

`study validate` leaves `correlations.csv` beside its run, with intervals; a plain run has the rank
correlation of its polygons' ratios. One sentence says which predicts the cost best.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness import atomic
from harness.errors import InputError
from harness.frame import View
from harness.metrics.groups import SAME
from harness.metrics.registry import find_metric, measures, predictions
from harness.results import drawings
from harness.results.run_folder import Run
from harness.study.correlations import (
    TIME,
    Estimate,
    column,
    label,
    median_estimate,
    predictors,
    ranks_within,
)
from harness.study.subjects import MEASURES, count_ways
from harness.workers.worker import Worker

FILE = "correlations.csv"
WHERE = ("rasteriser", "device", "measure")
COLUMNS = ("rasteriser", "device", "criterion", "measure", "statistic", "value")

STATISTICS = {
    "spearman_within": "rank correlation within a polygon",
    "spearman_pooled": "rank correlation over all polygons (misleads: size alone makes it high)",
    "spearman_of_ratios": "rank correlation of ratios to the base triangulator",
}

Matrix = dict[str, Any]
Cell = tuple[tuple[str, str, str], str, list[float | None]]
"""(rasteriser, device, measure), criterion, and the value with its interval."""


def from_study(folder: Path) -> list[Matrix]:
    """Return one matrix per statistic of the study in `folder`, [] where there is none.

    Raises
    ------
    InputError
        if `correlations.csv` lacks a column or holds something that is not a number
    """
    file = folder / FILE
    if not file.is_file():
        return []
    table = pd.read_csv(file)
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise InputError(f"{file} has no column {', '.join(missing)}; validate again")
    table = table.reindex(columns=[*COLUMNS, "ci_low", "ci_high"])
    told = table[["value", "ci_low", "ci_high"]]
    values = told.apply(pd.to_numeric, errors="coerce")
    wrong = (values.isna() & told.notna()).any(axis=1)
    if wrong.any():
        raise InputError(f"{file}, line {wrong.argmax() + 2}: not a number; validate again")
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


Correlations = Mapping[str, Mapping[str, float | None]]
"""measure -> criterion -> rank correlation of ratios."""


def criteria_of(
    measure: str | None,
    correlations: Correlations,
    spread: pd.DataFrame | None = None,
) -> str:
    """Return one sentence about which criterion to use, "" where none was judged.

    measure : the group's main counter, None if nothing was counted a polygon
    spread : what `read` gives of the group's view
    """
    within = {} if spread is None or measure is None else ranks(spread, measure)
    if within:
        values = {name: each.value for name, each in within.items()}
    else:
        told = correlations.get(measure or "", {}).items()
        values = {name: v for name, v in told if v is not None and name in predictions()}
    if not values:
        return ""
    best = max(values, key=values.__getitem__)
    words = "Within a polygon" if within else "Of the criteria"
    words += f", {find_metric(best).title} predicts {find_metric(measure or '').label} best "
    words += f"(rank correlation {values[best]:.2f}"
    if within:
        first = within[best]
        words += "" if math.isnan(first.low) else f", {first.low:.2f} to {first.high:.2f}"
        words += f", over {first.polygons} polygons"
    if best != "overdraw" and "overdraw" in values:
        words += f"; {find_metric('overdraw').title} {values['overdraw']:.2f}"
    return f"{words})."


def answer_of_study(matrices: Sequence[Mapping[str, Any]]) -> str | None:
    """Return one sentence about a study's first matrix, None where it has no figure to name.

    Helper lanes come first, then bounding-box tests, then whatever was measured.
    """
    if not matrices:
        return None
    matrix = matrices[0]
    columns = [each["measure"] for each in matrix["columns"]]
    wanted = [*measures(name for name in columns if not name.startswith(TIME)), *columns]
    place = columns.index(wanted[0])
    known = {
        row["title"]: cells[place]
        for row, cells in zip(matrix["rows"], matrix["cells"], strict=True)
        if column(row["name"]) in predictions() and cells[place] and cells[place][0] is not None
    }
    if not known:
        return None
    best = max(known, key=lambda title: known[title][0])
    value, low, high = known[best]
    interval = "" if low is None else f", 95 % interval {low:.2f} to {high:.2f}"
    of = matrix["columns"][place]
    where = f"{of['rasteriser']} on {of['device']}"
    words = f"{best} predicts the {of['title']} of {where} best "
    words += f"({matrix['title']} {value:.2f}{interval})"
    paper = find_metric("overdraw").title
    if best != paper and paper in known:
        words += f"; {paper} reaches {known[paper][0]:.2f}"
    return f"{words[0].upper()}{words[1:]}."


SPREAD = "spread.csv"


def write(run: Run) -> Path | None:
    """Write `SPREAD` for the first view that the run kept drawings of; None where there is none."""
    for record in run.records:
        view = record.id.view
        if record.is_ok and (kept := drawings.read(run, view)) is not None:
            with Worker("the criteria's judge") as worker:
                rows = worker.call(count_ways, kept, view)
            if not rows:
                return None
            # Two names for one triangulation must not count twice.
            table = pd.DataFrame(rows).drop_duplicates(["polygon", *SAME, *MEASURES])
            file = run.path / SPREAD
            atomic.write(file, table.to_csv(index=False, float_format="%.9g").encode())
            return file
    return None


def read(run: Run, view: View) -> pd.DataFrame | None:
    """Return what `write` wrote of `view`; None where there is nothing, or it is damaged."""
    file = run.path / SPREAD
    if not file.is_file():
        return None
    try:
        table = pd.read_csv(file)
        of_view = (table["resolution"] == view.resolution) & (table["rotation"] == view.rotation)
        table = table[of_view & (table["fit"] == view.fit)]
        table = table.astype(dict.fromkeys([*predictions(), *MEASURES], np.float64))
    except (KeyError, ValueError, OSError, pd.errors.ParserError):
        return None
    return None if table.empty else table


def ranks(table: pd.DataFrame, measure: str) -> dict[str, Estimate]:
    """Return the rank correlation within polygons of each criterion that ranks anything."""
    known = [name for name in predictions() if name in table]
    found = {name: median_estimate(ranks_within(table, name, measure)) for name in known}
    return {name: each for name, each in found.items() if np.isfinite(each.value)}
