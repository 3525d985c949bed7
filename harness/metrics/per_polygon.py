"""Costs of single polygons, in ratio to what another triangulator makes of the same polygon.

Dividing takes the polygon's size out, which would otherwise make every criterion look good.
"""

import numpy as np
from numpy.typing import NDArray

from harness.metrics.registry import PREDICTED
from harness.rasterisers.counters import compute_estimates
from harness.results.record import Record
from harness.results.run_folder import Run, read_arrays

Column = NDArray[np.float64]
Columns = dict[str, Column]


def columns_of(run: Run, record: Record) -> Columns | None:
    """Return a case's columns, each (p,), or None where the run did not keep them."""
    arrays = read_arrays(run, record.key)
    if arrays is None or f"{PREDICTED}triangles" not in arrays:
        return None
    columns = {name: np.asarray(column, np.float64) for name, column in arrays.items()}
    return columns | compute_estimates(columns, PREDICTED)


def ratios(columns: Columns, base: Columns, name: str) -> NDArray[np.float64]:
    """Return (p,) column `name` over that of `base`; NaN where either did not do the polygon."""
    drawn = (columns[f"{PREDICTED}triangles"] > 0) & (base[f"{PREDICTED}triangles"] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = columns[name] / base[name]
    return np.where(drawn & np.isfinite(ratio) & (ratio > 0), ratio, np.nan)


TIE_TOLERANCE = 1e-9
"""Relative difference up to which neighbouring values share a rank. The sums of two equal
triangulations differ by about 1e-15, because their triangles are added in different orders."""


def ranks(values: Column) -> Column:
    """Return the rank of each value, counted from 1; values within `TIE_TOLERANCE` share the mean.

    Rounding to a number of digits would not do: two sums on either side of a rounding boundary
    differ in the last bit and would still be ranked apart.
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


def spearman(x: Column, y: Column) -> float:
    """Return Spearman's coefficient; NaN if either column is constant or shorter than 3."""
    # Importing `scipy.stats` takes longer than a short run.
    if len(x) < 3:
        return float("nan")
    of_x, of_y = ranks(x), ranks(y)
    if np.ptp(of_x) == 0 or np.ptp(of_y) == 0:
        return float("nan")
    return float(np.corrcoef(of_x, of_y)[0, 1])


def rank_correlation(x: NDArray[np.float64], y: NDArray[np.float64]) -> float | None:
    """Return Spearman's coefficient of the finite pairs, or None if it is undefined."""
    finite = np.isfinite(x) & np.isfinite(y)
    coefficient = spearman(x[finite], y[finite])
    return None if np.isnan(coefficient) else coefficient


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
