"""How well one column of figures predicts another, within polygons and over all of them.

Within a polygon, every triangulation has the same area and, without T-junctions, the same number
of triangles. So only the choice of diagonals makes a difference. Pooled over polygons, any two
columns agree, because large polygons have large values in both; this says nothing about a
criterion. Pooled figures are given to show this, plain and with the number of triangles partialled
out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.figures.correlation import Column, ranks, spearman
from harness.figures.intervals import UNKNOWN, mean_interval, median_over

FEWEST = 5
"""Different triangulations a polygon must have for a correlation within it."""


@dataclass(frozen=True)
class Estimate:
    """A statistic with its 95 % interval over polygons.

    low, high : NaN where there are too few polygons to tell
    polygons : how many it was estimated from; with 0 the value is NaN
    """

    statistic: str
    value: float
    low: float
    high: float
    polygons: int

    @property
    def verdict(self) -> str:
        """Of a difference: above or below 0, not shown, or too few polygons."""
        if np.isnan(self.low):
            return TOO_FEW
        return ABOVE if self.low > 0 else BELOW if self.high < 0 else NOT_SHOWN


ABOVE, BELOW, NOT_SHOWN, TOO_FEW = "better", "worse", "no difference shown", "too few"


def kendall(x: Column, y: Column) -> float:
    """Return Kendall's tau-b; NaN where either column is constant."""
    from scipy import stats

    return float(stats.kendalltau(x, y).statistic) if _vary(x, y) else float("nan")


def log_slope(x: Column, y: Column) -> float:
    """Return the slope of log y on log x: 1 where twice the prediction costs twice as much.

    The least-squares slope over all pairs' log ratios equals that over the logs themselves.
    """
    fits = (x > 0) & (y > 0)
    if not _vary(x[fits], y[fits]):
        return float("nan")
    from scipy import stats

    return float(stats.linregress(np.log(x[fits]), np.log(y[fits])).slope)


def partial_spearman(x: Column, y: Column, given: Column) -> float:
    """Return the rank correlation of x and y with `given` partialled out of both."""
    *own, held = (ranks(column) for column in (x, y, given))
    if np.ptp(held) == 0:
        return spearman(x, y)
    left = [rank - np.polyval(np.polyfit(held, rank, 1), held) for rank in own]
    if min(float(np.ptp(part)) for part in left) < 1e-9:
        return float("nan")
    return float(np.corrcoef(left[0], left[1])[0, 1])


WITHIN: dict[str, Callable[[Column, Column], float]] = {
    "spearman_within": spearman,
    "kendall_within": kendall,
    "slope_within": log_slope,
}


def within(columns: Sequence[tuple[Column, Column]], of: Sequence[str] = ()) -> list[Estimate]:
    """Summarise (predicted, measured) columns, one pair per polygon, by medians over polygons.

    of : the polygon of each pair, where polygons were seen in several views; each counts once, with
        the mean over its views
    """
    return [median_within(name, columns, of) for name in WITHIN]


def median_within(
    name: str, columns: Sequence[tuple[Column, Column]], of: Sequence[str] = ()
) -> Estimate:
    """Return one of `WITHIN`: the median over polygons, with its interval."""
    return median_estimate(name, by_polygon(name, columns, of))


def by_polygon(
    name: str, columns: Sequence[tuple[Column, Column]], of: Sequence[str] = ()
) -> Column:
    """Return one of `WITHIN` for each polygon, (p,); NaN where it is not defined."""
    values: dict[str, list[float]] = {}
    for polygon, (x, y) in zip(of or map(str, range(len(columns))), columns, strict=True):
        found = WITHIN[name](x, y) if len(x) >= FEWEST else float("nan")
        values.setdefault(polygon, []).append(found)
    return np.array([np.mean(each) for each in values.values()])


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


def median_estimate(name: str, values: Column) -> Estimate:
    """Return the median of one value per polygon, of those that are finite, with its interval."""
    known = values[np.isfinite(values)]
    value = float(np.median(known)) if len(known) else float("nan")
    return Estimate(name, value, *median_over(known), len(known))


def _vary(x: Column, y: Column) -> bool:
    return len(x) >= 3 and float(np.ptp(x)) > 0 and float(np.ptp(y)) > 0


def regret_ends(values: Column, chosen: int) -> tuple[float, float]:
    """Return the regret of the candidate `chosen` against the best, from below and from above.

    values : (k, b) costs of k candidates in b independent blocks of noisy measurements

    The best of noisy costs is too low, and what seems best in one block is not the best in another.
    So the plug-in figure, against the least mean over all blocks, is too high on average; the
    cross-fitted one, against the candidate that the other blocks call best, is too low, and may be
    below 0. The truth's expectation is between them: the minimum is concave (Jensen's inequality).
    """
    logs = np.log(values)
    means = logs.mean(axis=1)
    count = logs.shape[1]
    others = (means[:, None] * count - logs) / (count - 1)
    best = others.argmin(axis=0)
    crossed = (logs[chosen] - logs[best, np.arange(count)]).mean()
    plugged = means[chosen] - means.min()
    return float(np.expm1(crossed)), float(np.expm1(plugged))


def regret_interval(low: Column, high: Column) -> tuple[float, float]:
    """Return the 95 % interval of mean regret, of `regret_ends` of each polygon, (p,) each.

    No less than 0, for nothing is better than the best; NaN where the polygons do not tell it.
    """
    ends = mean_interval(low)[0], mean_interval(high)[1]
    return (max(0.0, ends[0]), ends[1]) if np.isfinite(ends).all() else UNKNOWN
