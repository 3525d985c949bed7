"""Costs of single polygons, in ratio to what another triangulator makes of the same polygon.

Dividing takes the polygon's size out, which would otherwise make every criterion look good.
"""

import numpy as np
from numpy.typing import NDArray

from harness.metrics.registry import PREDICTED
from harness.rasterisers.counters import estimated
from harness.results.run_folder import Record, Run, read_arrays

Column = NDArray[np.float64]
Columns = dict[str, Column]


def columns_of(run: Run, record: Record) -> Columns | None:
    """Return a case's columns, each (p,), or None where the run did not keep them."""
    arrays = read_arrays(run, record["key"])
    if arrays is None or f"{PREDICTED}triangles" not in arrays:
        return None
    columns = {name: np.asarray(column, np.float64) for name, column in arrays.items()}
    return columns | estimated(columns, PREDICTED)


def ratios(columns: Columns, base: Columns, name: str) -> NDArray[np.float64]:
    """Return (p,) column `name` over that of `base`; NaN where either did not do the polygon."""
    drawn = (columns[f"{PREDICTED}triangles"] > 0) & (base[f"{PREDICTED}triangles"] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = columns[name] / base[name]
    return np.where(drawn & np.isfinite(ratio) & (ratio > 0), ratio, np.nan)


def ranks(values: Column) -> Column:
    """Return each value's rank from 1 on, the mean of theirs where values are equal."""
    _, which, times = np.unique(values, return_inverse=True, return_counts=True)
    mean: Column = (np.cumsum(times) - (times - 1) / 2)[which]
    return mean


def spearman(x: Column, y: Column) -> float:
    """Return Spearman's coefficient; NaN where either column is constant or shorter than 3."""
    # SciPy's, with all of `scipy.stats`, takes longer to import than a short run.
    if len(x) < 3 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return float("nan")
    return float(np.corrcoef(ranks(x), ranks(y))[0, 1])


def rank_correlation(x: NDArray[np.float64], y: NDArray[np.float64]) -> float | None:
    """Return Spearman's coefficient of the finite pairs, None where it is not defined."""
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    found = spearman(x, y)
    return None if np.isnan(found) else found


def error_of(x: NDArray[np.float64], y: NDArray[np.float64]) -> float | None:
    """Return the root of the mean square of log(x / y), which is the share that x is off by."""
    fits = np.isfinite(x) & np.isfinite(y) & (x > 0) & (y > 0)
    if not fits.any():
        return None
    return float(np.sqrt(np.mean(np.log(x[fits] / y[fits]) ** 2)))


def ratio_pairs(
    columns: dict[str, Columns], base: str, criterion: str, measure: str
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the ratios of predictions and of counters, one a polygon and triangulator.

    columns : triangulator -> its columns; those of `base` are what the others are divided by. Where
        one lacks the criterion, or the base the measure, there are no ratios
    """
    name = PREDICTED + criterion
    known = measure in columns[base] and all(name in each for each in columns.values())
    others = [each for other, each in columns.items() if other != base and known]
    if not others:
        return np.empty(0), np.empty(0)
    x, y = (
        np.concatenate([ratios(each, columns[base], which) for each in others])
        for which in (name, measure)
    )
    return x, y
