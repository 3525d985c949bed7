"""Costs of single polygons relative to another triangulation of the same polygon.

Without this division the polygon's size would make every criterion look good.
"""

import numpy as np
from numpy.typing import NDArray

from harness.metrics.registry import PREDICTED
from harness.rasterisers.counters import compute_estimates
from harness.results.record import Record
from harness.results.run_folder import Run, read_arrays

Column = NDArray[np.float64]
Columns = dict[str, Column]  # criteria and counters of p polygons, (p,), by name


def read_columns(run: Run, record: Record) -> Columns | None:
    """Return the criteria and counters of each polygon in a case, or None if not stored."""
    arrays = read_arrays(run, record.key)
    if arrays is None or f"{PREDICTED}triangles" not in arrays:
        return None
    columns = {name: np.asarray(column, np.float64) for name, column in arrays.items()}
    return columns | compute_estimates(columns, PREDICTED)


def compute_ratios(columns: Columns, base: Columns, name: str) -> Column:
    """Return each polygon's ratio in the column `name` to the base's, (p,), NaN if missing or 0."""
    drawn = (columns[f"{PREDICTED}triangles"] > 0) & (base[f"{PREDICTED}triangles"] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = columns[name] / base[name]
    return np.where(drawn & np.isfinite(ratio) & (ratio > 0), ratio, np.nan)


TIE_TOLERANCE = 1e-9  # relative; the sums of two equal triangulations differ by about 1e-15


def compute_ranks(values: Column) -> Column:
    """Return the rank of each value, counted from 1; values within `TIE_TOLERANCE` share the mean.

    Rounding would give two equal sums on either side of a rounding boundary different ranks.
    """
    order = np.argsort(values, kind="stable")
    ascending = values[order]
    tolerance = TIE_TOLERANCE * np.maximum(np.abs(ascending[1:]), np.abs(ascending[:-1]))
    is_new = np.diff(ascending) > tolerance
    group = np.concatenate(([0], np.cumsum(is_new)))[: len(values)]
    sizes = np.bincount(group)
    result = np.empty(len(values))
    result[order] = (np.cumsum(sizes) - (sizes - 1) / 2)[group]
    return result


def compute_spearman(x: Column, y: Column) -> float:
    """Return Spearman's coefficient; NaN if either column is constant or shorter than 3."""
    # Computed here, because importing `scipy.stats` takes longer than a short run.
    if len(x) < 3:
        return float("nan")
    x_ranks, y_ranks = compute_ranks(x), compute_ranks(y)
    if np.ptp(x_ranks) == 0 or np.ptp(y_ranks) == 0:
        return float("nan")
    return float(np.corrcoef(x_ranks, y_ranks)[0, 1])


def compute_rank_correlation(x: Column, y: Column) -> float | None:
    """Return Spearman's coefficient of the finite pairs, or None if it is undefined."""
    finite = np.isfinite(x) & np.isfinite(y)
    coefficient = compute_spearman(x[finite], y[finite])
    return None if np.isnan(coefficient) else coefficient


def compute_rms_error(x: Column, y: Column) -> float | None:
    """Return the root mean square of log(x / y), about x's relative error, or None."""
    valid = np.isfinite(x) & np.isfinite(y) & (x > 0) & (y > 0)
    if not valid.any():
        return None
    return float(np.sqrt(np.mean(np.log(x[valid] / y[valid]) ** 2)))


def pair_ratios(
    columns: dict[str, Columns], base: str, criterion: str, measure: str
) -> tuple[Column, Column]:
    """Return the ratios to the base of a criterion and of a counter, one per polygon and method.

    columns : by triangulator; without the criterion or the measure, the results are empty
    """
    name, base_columns = PREDICTED + criterion, columns[base]
    complete = measure in base_columns and all(name in column for column in columns.values())
    compared = [
        column for triangulator, column in columns.items() if triangulator != base and complete
    ]
    if not compared:
        return np.empty(0), np.empty(0)
    x, y = (
        np.concatenate([compute_ratios(column, base_columns, field) for column in compared])
        for field in (name, measure)
    )
    return x, y
