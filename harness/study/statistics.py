"""How well one column of figures predicts another, within polygons and over all of them.

Within a polygon, every triangulation has the same area and, without T-junctions, the same number
of triangles. So only the choice of diagonals makes a difference. Pooled over polygons, any two
columns agree, because large polygons have large values in both; this says nothing about a
criterion. Pooled figures are given to show this, plain and with the number of triangles partialled
out.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

FEWEST = 5
"""Different triangulations a polygon must have for a correlation within it."""

Column = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A statistic with its 95 % bootstrap interval over polygons.

    polygons : how many it was estimated from; with 0 the value is NaN
    """

    statistic: str
    value: float
    low: float
    high: float
    polygons: int


def spearman(x: Column, y: Column) -> float:
    """Return Spearman's rank correlation; NaN where either column is constant."""
    return float(stats.spearmanr(x, y).statistic) if _vary(x, y) else float("nan")


def kendall(x: Column, y: Column) -> float:
    """Return Kendall's tau-b; NaN where either column is constant."""
    return float(stats.kendalltau(x, y).statistic) if _vary(x, y) else float("nan")


def log_slope(x: Column, y: Column) -> float:
    """Return the slope of log y on log x: 1 where twice the prediction costs twice as much.

    The least-squares slope over all pairs' log ratios equals that over the logs themselves.
    """
    fits = (x > 0) & (y > 0)
    if not _vary(x[fits], y[fits]):
        return float("nan")
    return float(stats.linregress(np.log(x[fits]), np.log(y[fits])).slope)


def partial_spearman(x: Column, y: Column, given: Column) -> float:
    """Return the rank correlation of x and y with `given` partialled out of both."""
    ranks = [stats.rankdata(column) for column in (x, y, given)]
    if np.ptp(ranks[2]) == 0:
        return spearman(x, y)
    left = [rank - np.polyval(np.polyfit(ranks[2], rank, 1), ranks[2]) for rank in ranks[:2]]
    if min(float(np.ptp(part)) for part in left) < 1e-9:
        return float("nan")
    return float(np.corrcoef(left[0], left[1])[0, 1])


WITHIN: dict[str, Callable[[Column, Column], float]] = {
    "spearman_within": spearman,
    "kendall_within": kendall,
    "slope_within": log_slope,
}


def within(columns: Sequence[tuple[Column, Column]], seed: int = 0) -> list[Estimate]:
    """Summarise (predicted, measured) columns, one pair per polygon, by medians over polygons."""
    return [median_within(name, columns, seed) for name in WITHIN]


def median_within(name: str, columns: Sequence[tuple[Column, Column]], seed: int = 0) -> Estimate:
    """Return one of `WITHIN`: the median over polygons, with its interval."""
    values = np.array([WITHIN[name](x, y) for x, y in columns if len(x) >= FEWEST])
    return median_estimate(name, values[np.isfinite(values)], seed)


def pooled(columns: Sequence[tuple[Column, Column]], triangles: Sequence[Column]) -> list[Estimate]:
    """Return the correlation over all polygons at once, plain and given the triangle count."""
    if not columns:
        return []
    x = np.concatenate([column[0] for column in columns])
    y = np.concatenate([column[1] for column in columns])
    count = np.concatenate(triangles)
    nan = float("nan")
    return [
        Estimate("spearman_pooled", spearman(x, y), nan, nan, len(columns)),
        Estimate("spearman_partial", partial_spearman(x, y, count), nan, nan, len(columns)),
    ]


def median_estimate(name: str, values: Column, seed: int = 0) -> Estimate:
    """Return the median of one value per polygon, with its bootstrap interval over polygons."""
    nan = float("nan")
    if len(values) == 0:
        return Estimate(name, nan, nan, nan, 0)
    low, high = bootstrap_interval(values, np.median, seed)
    return Estimate(name, float(np.median(values)), low, high, len(values))


def bootstrap_interval(
    values: Column, statistic: Callable[..., Any], seed: int = 0
) -> tuple[float, float]:
    """Return the 95 % percentile interval of a statistic of one value per polygon.

    Of fewer than three values, or of equal ones, the range.
    """
    if len(values) < 3 or np.ptp(values) == 0:
        return float(values.min()), float(values.max())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)
        interval = stats.bootstrap(
            (values,), statistic, method="percentile", rng=np.random.default_rng(seed)
        ).confidence_interval
    return float(interval.low), float(interval.high)


def _vary(x: Column, y: Column) -> bool:
    return len(x) >= 3 and float(np.ptp(x)) > 0 and float(np.ptp(y)) > 0
