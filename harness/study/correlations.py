"""How well each criterion predicts each measurement: from a study's records to correlations.

Within a polygon, every triangulation has the same area and, without T-junctions, the same number
of triangles. So only the choice of diagonals makes a difference. Pooled over polygons, any two
columns agree, because large polygons have large values in both; this says nothing about a
criterion. The pooled figure is given to show this.
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

from harness.metrics.groups import IDENTIFYING
from harness.metrics.per_polygon import spearman
from harness.metrics.registry import find_metric, list_costs, list_predictions
from harness.results.record import Record
from harness.stats.intervals import UNKNOWN, median_over
from harness.style import draw, legend_below, panels, plain_table, scatter_over_medians
from triangulators.criteria import AUXILIARY_FEATURES

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike


EXACT = {
    "exact_quads": ("reference", "quads"),
    "exact_tiles_16": ("binning", "tiles_16"),
    "exact_tiles_32": ("binning", "tiles_32"),
    "exact_tiles_64": ("binning", "tiles_64"),
}
"""What the CPU counts exactly before anything is drawn, as predictions: rasteriser and counter."""

TIME = "time_work_"
"""Prefix of the columns of times, by the work a fragment does."""

VIEW = ("resolution", "rotation", "samples")
KEYS = ("polygon", *VIEW, "rasteriser", "device", "triangulator")

ENDS = ("ci_low", "ci_high", "polygons")

FEWEST = 5
"""Different triangulations a polygon must have for a correlation within it."""


class Estimate(NamedTuple):
    """A statistic with its 95 % interval over polygons.

    low, high : NaN where there are too few polygons to tell
    polygons : how many it was estimated from; with 0 the value is NaN
    """

    value: float
    low: float
    high: float
    polygons: int

    @property
    def verdict(self) -> str:
        """Of a difference: above or below 0, not shown, or too few polygons."""
        if np.isnan(self.low):
            return TOO_FEW
        return ABOVE if self.low > 0 else BELOW if self.high < 0 else NOT_SIGNIFICANT


ABOVE, BELOW, NOT_SIGNIFICANT, TOO_FEW = "better", "worse", "not significant", "too few"


def median_estimate(values: ArrayLike) -> Estimate:
    """Return the median of one value per polygon, of those that are finite, with its interval."""
    known = np.asarray(values, np.float64)
    known = known[np.isfinite(known)]
    value = float(np.median(known)) if len(known) else float("nan")
    return Estimate(value, *median_over(known), len(known))


def ranks_within(table: pd.DataFrame, criterion: str, measure: str) -> pd.Series[float]:
    """Return by polygon how well a criterion ranks a measure, both columns of `table`.

    A polygon that was seen in several views counts once, with the mean over these; it is NaN where
    a view has no rank correlation.
    """
    views = ["polygon", *(name for name in VIEW if name in table)]
    values: dict[str, list[float]] = {}
    for (polygon, *_), rows in table.dropna(subset=[criterion, measure]).groupby(views):
        x, y = (rows[name].to_numpy(float) for name in (criterion, measure))
        found = spearman(x, y) if len(rows) >= FEWEST else float("nan")
        values.setdefault(str(polygon), []).append(found)
    return pd.Series({polygon: np.mean(each) for polygon, each in values.items()}, dtype=float)


def predictors() -> dict[str, str]:
    """Return what predicts, column -> title: the criteria, and what the CPU counts exactly."""
    exact = {name: f"{find_metric(counter).label}, exactly" for name, (_, counter) in EXACT.items()}
    return {name: figure.title for name, figure in list_predictions().items()} | exact


def written(predictor: str) -> str:
    """Return a predictor's name as on the command line, which is how files have it."""
    return predictor.replace("_", "-")


def column(criterion: str) -> str:
    """Return the column of a predictor as files have it, or had it: with underscores."""
    return criterion.replace("-", "_")


def label(measure: str) -> str:
    """Return the title of a measure: a counter's name or a time's column."""
    if measure.startswith(TIME):
        return f"draw time, work {measure.removeprefix(TIME)}"
    return find_metric(measure).label


def measure_table(records: Sequence[Record]) -> pd.DataFrame:
    """Return one row per polygon, triangulation, rasteriser, device and view, measures as columns.

    Triangulators that give a polygon the same triangulation, as their criteria show, stand for
    one row: a triangulation must not count twice for having two names. Those with T-junctions
    are left out: they have fewer triangles and cover other pixels.
    """
    rows = []
    for record in (each for each in records if each.is_ok and each.polygons and each.conforming):
        case, predicted, counted = record.id, record.predicted, record.counters
        view = (case.view.resolution, case.view.rotation, case.options.samples)
        values = (case.scene, *view, case.rasteriser, case.device_name, record.name)
        row: dict[str, Any] = dict(zip(KEYS, values, strict=True))
        row |= {n: predicted[n] for n in (*predictors(), *AUXILIARY_FEATURES) if n in predicted}
        row |= {name: counted[name] for name in list_costs(counted)}
        if record.time is not None:
            row[f"{TIME}{case.options.work}"] = record.time.median_s
        rows.append(row)
    if not rows:
        return pd.DataFrame()
    # Drawings that differ in their work alone are one row, with a time for each.
    table = pd.DataFrame(rows).groupby(list(KEYS), sort=False, as_index=False).first()
    same = [name for name in KEYS if name != "triangulator"]
    twins = pd.concat([table[same], table[list(IDENTIFYING)].round(6)], axis=1).duplicated()
    return _with_exact(table[~twins])


def _with_exact(table: pd.DataFrame) -> pd.DataFrame:
    """Add what the CPU predicts exactly, from the rows of the rasterisers that count it."""
    where = ["polygon", "resolution", "rotation", "triangulator"]
    for name, (rasteriser, counter) in EXACT.items():
        if counter not in table.columns:
            continue
        source = table[(table["rasteriser"] == rasteriser) & (table["samples"] == 1)]
        values = source[[*where, counter]].rename(columns={counter: name})
        table = table.merge(values.drop_duplicates(where), on=where, how="left")
    return table


def _each_measure(table: pd.DataFrame) -> Iterator[tuple[tuple[Any, ...], pd.DataFrame, str]]:
    """Yield (rasteriser and device, their rows, measure that was taken).

    Counters come before times, the main one first.
    """
    columns = [str(name) for name in table.columns]
    times = [name for name in columns if name.startswith(TIME)]
    others = {*KEYS, *times, *predictors(), *AUXILIARY_FEATURES}
    counted = list_costs(name for name in columns if name not in others)
    for where, part in table.groupby(["rasteriser", "device"], sort=False):
        for measure in counted + times:
            if part[measure].notna().any():
                yield where, part, measure


def correlate(table: pd.DataFrame) -> pd.DataFrame:
    """Return the contents of correlations.csv: every criterion against every measure."""
    names = ["rasteriser", "device", "criterion", "measure", "statistic", "value"]
    rows: list[tuple[Any, ...]] = []
    for where, part, measure in _each_measure(table):
        for criterion in [name for name in predictors() if name in table]:
            known = part.dropna(subset=[criterion, measure])
            x, y = (known[name].to_numpy(float) for name in (criterion, measure))
            views = known.groupby(["polygon", *VIEW]).ngroups
            within = median_estimate(ranks_within(known, criterion, measure))
            of = (*where, written(criterion), measure)
            rows.append((*of, "spearman_within", *within))
            rows.append((*of, "spearman_pooled", spearman(x, y), *UNKNOWN, views))
    return pd.DataFrame(rows, columns=[*names, *ENDS])


def compare_all(table: pd.DataFrame) -> pd.DataFrame:
    """Return the contents of criteria_compared.csv: each two criteria, by paired differences.

    Both are judged on the same polygons, so their difference is known better than either of them.
    """
    names = ["rasteriser", "device", "measure", "criterion", "other", "difference"]
    rows = []
    for where, part, measure in _each_measure(table):
        known = [name for name in list_predictions() if name in table]
        ranked = {name: ranks_within(part, name, measure) for name in known}
        for one, other in combinations(ranked, 2):
            found = median_estimate(ranked[one] - ranked[other])
            if found.polygons:
                of = (*where, measure, written(one), written(other))
                rows.append((*of, *found, found.verdict))
    return pd.DataFrame(rows, columns=[*names, *ENDS, "verdict"])


def by_resolution(table: pd.DataFrame) -> pd.DataFrame:
    """Return `correlate` of each resolution by itself, with the resolution; empty for one alone."""
    if table.empty or table["resolution"].nunique() < 2:
        return pd.DataFrame()
    parts = [correlate(part).assign(resolution=size) for size, part in table.groupby("resolution")]
    return pd.concat(parts, ignore_index=True)


def write(table: pd.DataFrame, folder: Path) -> pd.DataFrame:
    """Write what `measure_table` gave, and what is made of it; returns the correlations."""
    tables = {
        "measured": table,
        "correlations": correlate(table),
        "criteria_compared": compare_all(table),
    }
    if len(by_size := by_resolution(table)):
        tables["correlations_by_resolution"] = by_size
    for name, content in tables.items():
        content.to_csv(folder / f"{name}.csv", index=False, float_format="%.6g")
    return tables["correlations"]


PAPER = "overdraw"


def print_matrix(correlations: pd.DataFrame, console: Console) -> None:
    """Print Spearman's rank correlation within polygons, one table per device."""
    for (rasteriser, device), part in _within(correlations):
        told = zip(part["criterion"], part["measure"], part["value"], strict=True)
        cells = {(name, of): "-" if np.isnan(value) else f"{value:.3f}" for name, of, value in told}
        title = f"rank correlation within polygons: {rasteriser} on {device}"
        console.print(by_criterion(title, cells, list(dict.fromkeys(part["measure"]))))


def by_criterion(title: str, cells: Mapping[tuple[str, str], str], shown: Sequence[str]) -> Table:
    """Return a table of (criterion, measure) -> cell, a column for each measure that is shown."""
    table = plain_table(title, "criterion", *(f">{label(measure)}" for measure in shown))
    for name in dict.fromkeys(name for name, _ in cells):
        table.add_row(name, *(cells.get((name, measure), "-") for measure in shown))
    return table


def plot_study(correlations: pd.DataFrame, table: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw predicted against measured into `folder`/plots, one figure a device."""
    files = []
    for (rasteriser, device), part in _within(correlations):
        rows = table[(table["rasteriser"] == rasteriser) & (table["device"] == device)]
        name = f"predicted-vs-measured-{rasteriser}-{device}"
        files += draw(folder / "plots", name, _scatter, rows, part, f"{rasteriser} on {device}")
    return files


def _within(correlations: pd.DataFrame) -> Iterable[tuple[Any, pd.DataFrame]]:
    wanted = correlations[correlations["statistic"] == "spearman_within"]
    return wanted.groupby(["rasteriser", "device"], sort=False)


def _scatter(rows: pd.DataFrame, part: pd.DataFrame, title: str) -> Figure:
    """Draw measures against predictions, both over the polygon's median, to remove its size.

    For the main counter and the time of the least work, a panel for the paper's criterion and one
    for the criterion that ranks best; exact counts are not criteria.
    """
    values = part.set_index([part["criterion"].map(column), "measure"])["value"]
    measured = list(dict.fromkeys(part["measure"]))
    times = [name for name in measured if name.startswith(TIME)]
    chosen = []
    # Quads are ranked as helper lanes are: all triangulations have the same fragments.
    for measure in [name for name in measured if name not in times][:1] + times[:1]:
        ranked = values.xs(measure, level="measure").dropna()
        best = ranked.drop([PAPER, *EXACT], errors="ignore").nlargest(1).index
        chosen += [(name, measure) for name in (PAPER, *best)]
    words = (
        f"How well do the paper's A and the best criterion predict? {title}\n"
        "one mark per triangulation, over its polygon's median; dashed: least squares"
    )
    figure, places = panels(len(chosen), (3.2, 3.1), words, across=2)
    for panel, (criterion, measure) in zip(places, chosen, strict=True):
        x, y = scatter_over_medians(panel, rows, criterion, measure, ["polygon", "resolution"])
        drawn = np.isfinite(x) & np.isfinite(y)
        # A cost has a part that no criterion predicts (covered pixels), so its slope is not 1.
        if np.ptp(x[drawn]) > 0:
            slope, height = np.polyfit(x[drawn] - 1, y[drawn], 1)
            panel.axline((1, height), slope=slope, color="black", linewidth=0.8, linestyle="--")
        found = values.get((criterion, measure), np.nan)
        panel.set_title(f"rank correlation {found:.3f}", fontsize=8)
        panel.set_xlabel(f"predicted by {predictors()[criterion]}, over median")
        panel.set_ylabel(f"measured {label(measure)},\nover median")
    legend_below(figure, places, columns=4)
    return figure
