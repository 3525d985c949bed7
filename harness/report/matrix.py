"""The matrix of a report: how well each criterion predicts each measurement.

A study's matrix is read from `correlations.csv` of `study validate`, with intervals. That of
another run has the rank correlation of polygons' ratios to the base.
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
from harness.metrics.groups import IDENTIFYING_CRITERIA
from harness.metrics.registry import find_metric, list_costs, list_predictions
from harness.results.run_folder import Run, read_geometry
from harness.study.correlations import (
    PAPER,
    TIME,
    Estimate,
    correlate_within_polygons,
    estimate_median,
    get_measure_title,
    get_predictor_column,
    list_predictors,
)
from harness.study.subjects import MEASURES, evaluate_triangulations
from harness.worker import Worker

FILE = "correlations.csv"
TARGET = ("rasteriser", "device", "measure")
COLUMNS = ("rasteriser", "device", "criterion", "measure", "statistic", "value")

STATISTICS = {
    "spearman_within": "rank correlation within a polygon",
    "spearman_pooled": "rank correlation over all polygons (misleading: dominated by size)",
    "spearman_of_ratios": "rank correlation of ratios to the base triangulator",
}

Matrix = dict[str, Any]
# (rasteriser, device, measure), criterion, and the value with interval.
Cell = tuple[tuple[str, str, str], str, list[float | None]]


def read_study_matrices(folder: Path) -> list[Matrix]:
    """Return the matrices of the study in `folder`, one per statistic; [] without a study."""
    file = folder / FILE
    if not file.is_file():
        return []
    table = pd.read_csv(file)
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise InputError(f"{file}: no column {', '.join(missing)}; run study validate again")
    table = table.reindex(columns=[*COLUMNS, "ci_low", "ci_high"])
    texts = table[["value", "ci_low", "ci_high"]]
    values = texts.apply(pd.to_numeric, errors="coerce")
    invalid = (values.isna() & texts.notna()).any(axis=1)
    if invalid.any():
        line = invalid.argmax() + 2
        raise InputError(f"{file}, line {line}: not a number; run study validate again")
    targets = table[list(TARGET)].itertuples(index=False, name=None)
    numbers = values.astype(object).where(np.isfinite(values), None).to_numpy().tolist()
    columns = (table["statistic"], targets, table["criterion"], numbers)
    cells: dict[str, list[Cell]] = {}
    for statistic, *cell in zip(*columns, strict=True):
        cells.setdefault(statistic, []).append(tuple(cell))
    first = [name for name in STATISTICS if name in cells]
    return [_make_matrix(name, cells[name]) for name in dict.fromkeys([*first, *cells])]


def make_run_matrices(groups: Sequence[Mapping[str, Any]]) -> list[Matrix]:
    """Return a list with the matrix of a run's first view, [] without correlations."""
    cells = [
        ((group["rasteriser"], group["device"], measure), criterion, [value, None, None])
        for group in groups
        if group["view"] == groups[0]["view"]
        for measure, values in group["correlations"].items()
        for criterion, value in values.items()
    ]
    return [_make_matrix("spearman_of_ratios", cells)] if cells else []


def _make_matrix(statistic: str, cells: Iterable[Cell]) -> Matrix:
    table = {(target, criterion): values for target, criterion, values in cells}
    columns = list(dict.fromkeys(target for target, _ in table))
    titles = list_predictors()
    order = list(titles)
    predictors = {name: get_predictor_column(name) for _, name in table}
    # Registered criteria in their order, then others by name.
    rows = sorted(
        predictors, key=lambda name: ([*order, predictors[name]].index(predictors[name]), name)
    )
    return {
        "statistic": statistic,
        "title": STATISTICS.get(statistic, statistic.replace("_", " ")),
        "rows": [
            {"name": name, "title": titles.get(predictors[name], name.replace("_", " "))}
            for name in rows
        ],
        "columns": [
            {**dict(zip(TARGET, target, strict=True)), "title": get_measure_title(target[2])}
            for target in columns
        ],
        "cells": [[table.get((target, name)) for target in columns] for name in rows],
    }


# measure -> criterion -> rank correlation of ratios.
Correlations = Mapping[str, Mapping[str, float | None]]


def format_best_criterion(
    measure: str | None,
    correlations: Correlations,
    spread: pd.DataFrame | None = None,
) -> str:
    """Return a sentence about the criterion that predicts the cost best, "" if unknown.

    measure : the group's main counter, or None without counters per polygon
    """
    within = (
        {}
        if spread is None or measure is None
        else correlate_predictions_within_polygons(spread, measure)
    )
    if within:
        values = {name: estimate.value for name, estimate in within.items()}
    else:
        pairs = correlations.get(measure or "", {}).items()
        values = {name: v for name, v in pairs if v is not None and name in list_predictions()}
    if not values:
        return ""
    best = max(values, key=values.__getitem__)
    text = "Within a polygon" if within else "Of the criteria"
    text += f", {find_metric(best).title} predicts {find_metric(measure or '').label} best "
    text += f"(rank correlation {values[best]:.2f}"
    if within:
        estimate = within[best]
        if not math.isnan(estimate.low):
            text += f", 95 % CI {estimate.low:.2f}-{estimate.high:.2f}"
        text += f", {estimate.polygons} polygons"
    if best != PAPER and PAPER in values:
        text += f"; {find_metric(PAPER).title} {values[PAPER]:.2f}"
    return f"{text})."


def format_best_criterion_of_study(matrices: Sequence[Mapping[str, Any]]) -> str | None:
    """Return a sentence about the criterion that predicts a measure best, or None if unknown.

    The first matrix is used, and of its columns helper lanes, else box tests, else the first.
    """
    if not matrices:
        return None
    matrix = matrices[0]
    columns = [column["measure"] for column in matrix["columns"]]
    counters = [name for name in columns if not name.startswith(TIME)]
    index = columns.index(next(iter([*list_costs(counters), *columns])))
    rows = {
        row["title"]: cells[index]
        for row, cells in zip(matrix["rows"], matrix["cells"], strict=True)
        if get_predictor_column(row["name"]) in list_predictions()
        and cells[index]
        and cells[index][0] is not None
    }
    if not rows:
        return None
    best = max(rows, key=lambda title: rows[title][0])
    value, low, high = rows[best]
    interval = "" if low is None else f", 95 % CI {low:.2f}-{high:.2f}"
    target = matrix["columns"][index]
    text = f"{best} predicts the {target['title']} of {target['rasteriser']} on {target['device']} "
    text += f"best ({matrix['title']} {value:.2f}{interval})"
    paper = find_metric(PAPER).title
    if best != paper and paper in rows:
        text += f"; {paper} reaches {rows[paper][0]:.2f}"
    return f"{text[0].upper()}{text[1:]}."


SPREAD = "spread.csv"  # file with criteria and counters of many triangulations per polygon


def write_spread(run: Run) -> Path | None:
    """Write criteria and counters of many triangulations of some polygons to `SPREAD`; return it.

    The first view with stored drawings is used; None if there is none.
    """
    for record in run.records:
        view = record.id.view
        if record.is_ok and (geometry := read_geometry(run, view)) is not None:
            with Worker("criteria evaluation worker") as worker:
                rows = worker.call(evaluate_triangulations, geometry, view)
            if not rows:
                return None
            # Equal triangulations under several names count once.
            table = pd.DataFrame(rows).drop_duplicates(
                ["polygon", *IDENTIFYING_CRITERIA, *MEASURES]
            )
            file = run.folder / SPREAD
            atomic.write(file, table.to_csv(index=False, float_format="%.9g").encode())
            return file
    return None


def read_spread(run: Run, view: View) -> pd.DataFrame | None:
    """Return the table of `write_spread` for `view`, or None if missing or invalid."""
    file = run.folder / SPREAD
    if not file.is_file():
        return None
    try:
        table = pd.read_csv(file)
        of_view = (table["resolution"] == view.resolution) & (table["rotation"] == view.rotation)
        table = table[of_view & (table["fit"] == view.fit)]
        table = table.astype(dict.fromkeys([*list_predictions(), *MEASURES], np.float64))
    except (KeyError, ValueError, OSError, pd.errors.ParserError):
        return None
    return None if table.empty else table


def correlate_predictions_within_polygons(table: pd.DataFrame, measure: str) -> dict[str, Estimate]:
    """Return each criterion's median rank correlation with `measure` within a polygon, if any."""
    estimates = {
        name: estimate_median(correlate_within_polygons(table, name, measure))
        for name in list_predictions()
        if name in table
    }
    return {name: e for name, e in estimates.items() if np.isfinite(e.value)}
