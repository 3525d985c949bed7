"""Rank correlations of criteria and measurements, from a study's records.

Within a polygon, every triangulation has the same area and, without T-junctions, the same number
of triangles. So only the choice of diagonals makes a difference. Pooled over polygons, any two
columns agree, because large polygons have large values in both; the pooled coefficient is only
reported to show this.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from harness.metrics.groups import IDENTIFYING_CRITERIA
from harness.metrics.registry import find_metric, list_costs, list_predictions
from harness.metrics.statistics import (
    MIN_VALUES,
    UNKNOWN,
    compute_median_interval,
    compute_spearman,
)
from harness.results.record import Record
from harness.style import (
    add_legend_below,
    draw_figure,
    draw_scatter_over_medians,
    make_panels,
    make_plain_table,
)
from triangulators.criteria import AUXILIARY_FEATURES

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike


EXACT_PREDICTORS = {  # exact counts by the CPU: rasteriser and counter
    "exact_quads": ("reference", "quads"),
    "exact_tiles_16": ("binning", "tiles_16"),
    "exact_tiles_32": ("binning", "tiles_32"),
    "exact_tiles_64": ("binning", "tiles_64"),
}

TIME = "time_work_"  # prefix of the columns of draw times; the work per fragment follows
VIEW = ("resolution", "rotation", "samples")
KEYS = ("polygon", *VIEW, "rasteriser", "device", "triangulator")

ENDS = ("ci_low", "ci_high", "polygons")  # columns that follow an estimate
MIN_TRIANGULATIONS = 5  # different ones, for a correlation within a polygon


class Estimate(NamedTuple):
    """A statistic with its 95 % interval over polygons, NaN if there are too few polygons."""

    value: float
    low: float
    high: float
    polygons: int

    @property
    def verdict(self) -> str:
        """Whether the value is significantly above or below 0."""
        if np.isnan(self.low):
            return TOO_FEW
        return ABOVE if self.low > 0 else BELOW if self.high < 0 else NOT_SIGNIFICANT


ABOVE, BELOW, NOT_SIGNIFICANT, TOO_FEW = "better", "worse", "not significant", "too few"


def estimate_median(values: ArrayLike) -> Estimate:
    """Return the median of the finite values, one per polygon, with its interval."""
    finite = np.asarray(values, np.float64)
    finite = finite[np.isfinite(finite)]
    value = float(np.median(finite)) if len(finite) else float("nan")
    ends = compute_median_interval(finite.tolist()) if len(finite) >= MIN_VALUES else UNKNOWN
    return Estimate(value, *ends, len(finite))


def correlate_within_polygons(
    table: pd.DataFrame, criterion: str, measure: str
) -> pd.Series[float]:
    """Return the rank correlation of two columns within each polygon, as a mean over views."""
    views = ["polygon", *(name for name in VIEW if name in table)]
    values: dict[str, list[float]] = {}
    for (polygon, *_), rows in table.dropna(subset=[criterion, measure]).groupby(views):
        x, y = (rows[name].to_numpy(float) for name in (criterion, measure))
        coefficient = compute_spearman(x, y) if len(rows) >= MIN_TRIANGULATIONS else float("nan")
        values.setdefault(str(polygon), []).append(coefficient)
    return pd.Series({polygon: np.mean(views) for polygon, views in values.items()}, dtype=float)


def list_predictors() -> dict[str, str]:
    """Return column -> title of all predictions: criteria, and exact counts by the CPU."""
    exact = {
        name: f"{find_metric(counter).label}, exactly"
        for name, (_, counter) in EXACT_PREDICTORS.items()
    }
    return {name: metric.title for name, metric in list_predictions().items()} | exact


def get_predictor_name(predictor: str) -> str:
    """Return the name of a predictor on the command line and in files."""
    return predictor.replace("_", "-")


def get_predictor_column(criterion: str) -> str:
    """Return the column of a predictor, given the name on the command line."""
    return criterion.replace("-", "_")


def get_measure_title(measure: str) -> str:
    """Return the title of a measure: a counter's name or a time's column."""
    if measure.startswith(TIME):
        return f"draw time, work {measure.removeprefix(TIME)}"
    return find_metric(measure).label


def make_measure_table(records: Sequence[Record]) -> pd.DataFrame:
    """Return one row per polygon, triangulation, rasteriser, device and view, measures as columns.

    Equal triangulations of several triangulators, recognised by the criteria, are one row.
    Triangulations with T-junctions are skipped: they have fewer triangles and cover other pixels.
    """
    rows = []
    criteria = (*list_predictors(), *AUXILIARY_FEATURES)
    for record in (r for r in records if r.is_ok and r.polygons and r.conforming):
        case, predicted, counted = record.id, record.predicted, record.counters
        view = (case.view.resolution, case.view.rotation, case.options.samples)
        values = (case.scene, *view, case.rasteriser, case.device_name, record.name)
        row: dict[str, Any] = dict(zip(KEYS, values, strict=True))
        row |= {name: predicted[name] for name in criteria if name in predicted}
        row |= {name: counted[name] for name in list_costs(counted)}
        if record.time is not None:
            row[f"{TIME}{case.options.work}"] = record.time.median_s
        rows.append(row)
    if not rows:
        return pd.DataFrame()
    # Drawings that differ in the work per fragment alone are one row, with a column for each time.
    table = pd.DataFrame(rows).groupby(list(KEYS), sort=False, as_index=False).first()
    shared = [name for name in KEYS if name != "triangulator"]
    identity = table[list(IDENTIFYING_CRITERIA)].round(6)
    is_duplicate = pd.concat([table[shared], identity], axis=1).duplicated()
    return _add_exact_counts(table[~is_duplicate])


def _add_exact_counts(table: pd.DataFrame) -> pd.DataFrame:
    keys = ["polygon", "resolution", "rotation", "triangulator"]
    for name, (rasteriser, counter) in EXACT_PREDICTORS.items():
        if counter not in table.columns:
            continue
        source = table[(table["rasteriser"] == rasteriser) & (table["samples"] == 1)]
        values = source[[*keys, counter]].rename(columns={counter: name})
        table = table.merge(values.drop_duplicates(keys), on=keys, how="left")
    return table


def _iterate_measures(table: pd.DataFrame) -> Iterator[tuple[tuple[Any, ...], pd.DataFrame, str]]:
    """Yield ((rasteriser, device), rows, measure): the main counter, other counters, then times."""
    columns = [str(name) for name in table.columns]
    times = [name for name in columns if name.startswith(TIME)]
    excluded = {*KEYS, *times, *list_predictors(), *AUXILIARY_FEATURES}
    counted = list_costs(name for name in columns if name not in excluded)
    for device, part in table.groupby(["rasteriser", "device"], sort=False):
        for measure in counted + times:
            if part[measure].notna().any():
                yield device, part, measure


def make_correlation_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return the content of correlations.csv, by device, criterion, measure and statistic."""
    names = ["rasteriser", "device", "criterion", "measure", "statistic", "value"]
    rows: list[tuple[Any, ...]] = []
    for device, part, measure in _iterate_measures(table):
        for criterion in [name for name in list_predictors() if name in table]:
            complete = part.dropna(subset=[criterion, measure])
            x, y = (complete[name].to_numpy(float) for name in (criterion, measure))
            views = complete.groupby(["polygon", *VIEW]).ngroups
            within = estimate_median(correlate_within_polygons(complete, criterion, measure))
            key = (*device, get_predictor_name(criterion), measure)
            rows.append((*key, "spearman_within", *within))
            rows.append((*key, "spearman_pooled", compute_spearman(x, y), *UNKNOWN, views))
    return pd.DataFrame(rows, columns=[*names, *ENDS])


def compare_criteria(table: pd.DataFrame) -> pd.DataFrame:
    """Return the content of criteria_compared.csv: paired differences of every two criteria."""
    names = ["rasteriser", "device", "measure", "criterion", "other", "difference"]
    rows = []
    for device, part, measure in _iterate_measures(table):
        criteria = [name for name in list_predictions() if name in table]
        correlations = {name: correlate_within_polygons(part, name, measure) for name in criteria}
        for first, second in combinations(correlations, 2):
            estimate = estimate_median(correlations[first] - correlations[second])
            if estimate.polygons:
                key = (*device, measure, get_predictor_name(first), get_predictor_name(second))
                rows.append((*key, *estimate, estimate.verdict))
    return pd.DataFrame(rows, columns=[*names, *ENDS, "verdict"])


def correlate_by_resolution(table: pd.DataFrame) -> pd.DataFrame:
    """Return correlation tables of each resolution, as one; empty for a single resolution."""
    if table.empty or table["resolution"].nunique() < 2:
        return pd.DataFrame()
    parts = [
        make_correlation_table(part).assign(resolution=size)
        for size, part in table.groupby("resolution")
    ]
    return pd.concat(parts, ignore_index=True)


def write_correlations(table: pd.DataFrame, folder: Path) -> pd.DataFrame:
    """Write the tables of a study into `folder`; return the correlations."""
    tables = {
        "measured": table,
        "correlations": make_correlation_table(table),
        "criteria_compared": compare_criteria(table),
    }
    if len(by_size := correlate_by_resolution(table)):
        tables["correlations_by_resolution"] = by_size
    for name, content in tables.items():
        content.to_csv(folder / f"{name}.csv", index=False, float_format="%.6g")
    return tables["correlations"]


PAPER = "overdraw"  # criterion that the paper proposes


def print_matrix(correlations: pd.DataFrame, console: Console) -> None:
    """Print Spearman's rank correlation within polygons, one table per device."""
    for (rasteriser, device), part in _group_within_polygons(correlations):
        columns = zip(part["criterion"], part["measure"], part["value"], strict=True)
        cells = {(c, m): "-" if np.isnan(value) else f"{value:.3f}" for c, m, value in columns}
        title = f"rank correlation within polygons: {rasteriser} on {device}"
        console.print(make_criterion_table(title, cells, list(dict.fromkeys(part["measure"]))))


def make_criterion_table(
    title: str, cells: Mapping[tuple[str, str], str], measures: Sequence[str]
) -> Table:
    """Return a table of (criterion, measure) -> cell with a column for each of `measures`."""
    table = make_plain_table(
        title, "criterion", *(f">{get_measure_title(measure)}" for measure in measures)
    )
    for name in dict.fromkeys(name for name, _ in cells):
        table.add_row(name, *(cells.get((name, measure), "-") for measure in measures))
    return table


def plot_study(correlations: pd.DataFrame, table: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw predictions against measurements into `folder`/plots, one figure per device."""
    files = []
    for (rasteriser, device), part in _group_within_polygons(correlations):
        rows = table[(table["rasteriser"] == rasteriser) & (table["device"] == device)]
        name, title = f"predicted-vs-measured-{rasteriser}-{device}", f"{rasteriser} on {device}"
        files += draw_figure(folder / "plots", name, _draw_scatter, rows, part, title)
    return files


def _group_within_polygons(correlations: pd.DataFrame) -> Iterable[tuple[Any, pd.DataFrame]]:
    within = correlations[correlations["statistic"] == "spearman_within"]
    return within.groupby(["rasteriser", "device"], sort=False)


def _draw_scatter(rows: pd.DataFrame, part: pd.DataFrame, title: str) -> Figure:
    """Draw measures against predictions, both divided by the polygon's median to remove its size.

    The main counter and the time with the least work have two panels each: for the paper's
    criterion, and for the criterion with the best rank correlation. Exact counts are not criteria.
    """
    values = part.set_index([part["criterion"].map(get_predictor_column), "measure"])["value"]
    measured = list(dict.fromkeys(part["measure"]))
    times = [name for name in measured if name.startswith(TIME)]
    pairs = []
    # One counter is enough: as fragments are equal, quads and helper lanes have the same ranks.
    for measure in [name for name in measured if name not in times][:1] + times[:1]:
        ranked = values.xs(measure, level="measure").dropna()
        best = ranked.drop([PAPER, *EXACT_PREDICTORS], errors="ignore").nlargest(1).index
        pairs += [(name, measure) for name in (PAPER, *best)]
    title_lines = (
        f"How well do the paper's A and the best criterion predict? {title}\n"
        "one mark per triangulation, over its polygon's median; dashed: least squares"
    )
    figure, axes = make_panels(len(pairs), (3.2, 3.1), title_lines, across=2)
    for panel, (criterion, measure) in zip(axes, pairs, strict=True):
        x, y = draw_scatter_over_medians(panel, rows, criterion, measure, ["polygon", "resolution"])
        drawn = np.isfinite(x) & np.isfinite(y)
        # Criteria do not predict a part of the cost (covered pixels): the slope is fitted, not 1.
        if np.ptp(x[drawn]) > 0:
            slope, height = np.polyfit(x[drawn] - 1, y[drawn], 1)
            panel.axline((1, height), slope=slope, color="black", linewidth=0.8, linestyle="--")
        coefficient = values.get((criterion, measure), np.nan)
        panel.set_title(f"rank correlation {coefficient:.3f}", fontsize=8)
        panel.set_xlabel(f"predicted by {list_predictors()[criterion]}, over median")
        panel.set_ylabel(f"measured {get_measure_title(measure)},\nover median")
    add_legend_below(figure, axes, columns=4)
    return figure
