"""How well each criterion predicts each measurement: from a study's records to correlations.

Within a polygon, every triangulation has the same area and, without T-junctions, the same number
of triangles. So only the choice of diagonals makes a difference. Pooled over polygons, any two
columns agree, because large polygons have large values in both; this says nothing about a
criterion. The pooled figure is given to show this.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from harness.figures.groups import SAME
from harness.figures.intervals import median_over
from harness.figures.polygons import Column, spearman
from harness.figures.registry import find, measures, predictions
from harness.stored.folder import Record
from harness.style import draw, legend_below, panels, plain_table, scatter_over_medians
from triangulators.criteria import FEATURES_KEPT

if TYPE_CHECKING:
    from matplotlib.figure import Figure


EXACT = {
    "exact_quads": ("reference", "quads"),
    "exact_tiles_16": ("binning", "tiles_16"),
    "exact_tiles_32": ("binning", "tiles_32"),
    "exact_tiles_64": ("binning", "tiles_64"),
}
"""What the CPU counts exactly before anything is drawn, as predictions: rasteriser and counter."""

TIME = "time_work_"
"""Prefix of the columns of times, by the work a fragment does."""

KEYS = ("polygon", "resolution", "rotation", "samples", "rasteriser", "device", "triangulator")


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


def within(columns: Sequence[tuple[Column, Column]], of: Sequence[str] = ()) -> Estimate:
    """Return the rank correlation within a polygon: the median over polygons, with its interval.

    columns : (predicted, measured), one pair per polygon and view
    of : the polygon of each pair, where polygons were seen in several views; each counts once, with
        the mean over its views
    """
    return median_estimate("spearman_within", by_polygon(columns, of))


def by_polygon(columns: Sequence[tuple[Column, Column]], of: Sequence[str] = ()) -> Column:
    """Return the rank correlation within each polygon, (p,); NaN where it is not defined."""
    values: dict[str, list[float]] = {}
    for polygon, (x, y) in zip(of or map(str, range(len(columns))), columns, strict=True):
        found = spearman(x, y) if len(x) >= FEWEST else float("nan")
        values.setdefault(polygon, []).append(found)
    return np.array([np.mean(each) for each in values.values()])


def median_estimate(name: str, values: Column) -> Estimate:
    """Return the median of one value per polygon, of those that are finite, with its interval."""
    known = values[np.isfinite(values)]
    value = float(np.median(known)) if len(known) else float("nan")
    return Estimate(name, value, *median_over(known), len(known))


def predictors() -> dict[str, str]:
    """Return what predicts, column -> title: the criteria, and what the CPU counts exactly."""
    exact = {name: f"{find(counter).label}, exactly" for name, (_, counter) in EXACT.items()}
    return {name: figure.title for name, figure in predictions().items()} | exact


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
    return find(measure).label


def measures_of(table: pd.DataFrame) -> list[str]:
    """Return the columns of `table` that were measured: counters, the main one first, and times."""
    others = {*KEYS, *predictors(), *FEATURES_KEPT}
    counted = measures(name for name in table.columns if name not in others)
    counted = [name for name in counted if not name.startswith(TIME)]
    return counted + [name for name in table.columns if name.startswith(TIME)]


def measure_table(records: Sequence[Record]) -> pd.DataFrame:
    """Return one row per polygon, triangulation, rasteriser, device and view, measures as columns.

    Triangulators that give a polygon the same triangulation, as their criteria show, stand for
    one row: a triangulation must not count twice for having two names. Those with T-junctions
    are left out: they have fewer triangles and cover other pixels.
    """
    good = [r for r in records if r["status"] == "ok" and r["polygons"] and r["conforming"]]
    rows: dict[tuple[object, ...], dict[str, object]] = {}
    for record in good:
        options = record["options"]
        told = {**record, "polygon": record["scene"], "samples": options["samples"]}
        key = tuple(told[name] for name in KEYS)
        predicted = record["predicted"]
        known = [name for name in (*predictors(), *FEATURES_KEPT) if name in predicted]
        row = rows.setdefault(key, {name: predicted[name] for name in known})
        counted = record["counters"]
        row |= {name: counted[name] for name in measures(counted)}
        if "median_s" in (record.get("time") or {}):
            row[f"{TIME}{options['work']}"] = record["time"]["median_s"]
    table = pd.DataFrame(
        [{**dict(zip(KEYS, key, strict=True)), **row} for key, row in rows.items()]
    )
    if table.empty:
        return table
    same = [name for name in KEYS if name != "triangulator"]
    twins = pd.concat([table[same], table[list(SAME)].round(6)], axis=1).duplicated()
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


def _each_measure(table: pd.DataFrame) -> Iterator[tuple[dict[str, object], pd.DataFrame, str]]:
    """Yield (columns that say where, rows of a rasteriser and device, measure that was taken)."""
    for (rasteriser, device), part in table.groupby(["rasteriser", "device"], sort=False):
        for measure in measures_of(part):
            if part[measure].notna().any():
                where = {"rasteriser": rasteriser, "device": device, "measure": measure}
                yield where, part, measure


def _ends(estimate: Estimate) -> dict[str, object]:
    return {"ci_low": estimate.low, "ci_high": estimate.high, "polygons": estimate.polygons}


def correlate(table: pd.DataFrame) -> pd.DataFrame:
    """Return the contents of correlations.csv: every criterion against every measure."""
    names = ["rasteriser", "device", "criterion", "measure", "statistic", "value"]
    rows = [
        where
        | {"criterion": written(criterion), "statistic": found.statistic, "value": found.value}
        | _ends(found)
        for where, part, measure in _each_measure(table)
        for criterion in predictors()
        if criterion in table.columns
        for found in _estimates(part, criterion, measure)
    ]
    return pd.DataFrame(rows, columns=[*names, "ci_low", "ci_high", "polygons"])


def _estimates(part: pd.DataFrame, criterion: str, measure: str) -> list[Estimate]:
    of, columns = _views(part, criterion, measure)
    if not columns:
        return [within(columns, of)]
    x, y = (np.concatenate(side) for side in zip(*columns, strict=True))
    nan = float("nan")
    return [
        within(columns, of),
        Estimate("spearman_pooled", spearman(x, y), nan, nan, len(columns)),
    ]


def _views(
    part: pd.DataFrame, criterion: str, measure: str
) -> tuple[list[str], list[tuple[Column, Column]]]:
    """Return of which polygon each view is, and its rows' two columns, where both are known."""
    known = part.dropna(subset=[criterion, measure])
    views = list(known.groupby(["polygon", "resolution", "rotation", "samples"]))
    columns = [
        (rows[criterion].to_numpy(float), rows[measure].to_numpy(float)) for _, rows in views
    ]
    return [str(polygon) for (polygon, *_), _ in views], columns


def ranks(part: pd.DataFrame, criterion: str, measure: str) -> pd.Series[float]:
    """Return by polygon how well a criterion, a column of `part`, ranks a measure."""
    of, columns = _views(part, criterion, measure)
    return pd.Series(by_polygon(columns, of), list(dict.fromkeys(of)), float)


def difference(one: pd.Series[float], other: pd.Series[float]) -> Estimate:
    """Return how much better one of two criteria does, of `ranks` of both: the median difference.

    Both are judged on the same polygons, so their difference is known better than either of them.
    """
    return median_estimate("spearman_difference", np.asarray(one - other, np.float64))


def compare_all(table: pd.DataFrame) -> pd.DataFrame:
    """Return the contents of criteria_compared.csv: each two criteria, by paired differences."""
    rows = []
    known = [name for name in predictions() if name in table.columns]
    for where, part, measure in _each_measure(table):
        ranked = {name: ranks(part, name, measure) for name in known}
        for one, other in combinations(known, 2):
            found = difference(ranked[one], ranked[other])
            if found.polygons:
                names = {"criterion": written(one), "other": written(other)}
                value = {"difference": found.value}
                rows.append(where | names | value | _ends(found) | {"verdict": found.verdict})
    return pd.DataFrame(rows)


def write(table: pd.DataFrame, folder: Path) -> pd.DataFrame:
    """Write what `measure_table` gave, and what `correlate` and `by_resolution` make of it.

    Returns the correlations; correlations_by_resolution.csv is written where there are several, and
    criteria_compared.csv where polygons rank two criteria.
    """
    tables = {
        "measured": table,
        "correlations": correlate(table),
        "criteria_compared": compare_all(table),
        "correlations_by_resolution": by_resolution(table),
    }
    for name, content in tables.items():
        if name in ("measured", "correlations") or not content.empty:
            content.to_csv(folder / f"{name}.csv", index=False, float_format="%.6g")
    return tables["correlations"]


def by_resolution(table: pd.DataFrame) -> pd.DataFrame:
    """Return `correlate` of each resolution by itself, with the resolution; empty for one alone."""
    if table.empty or table["resolution"].nunique() < 2:
        return pd.DataFrame()
    parts = [correlate(part).assign(resolution=size) for size, part in table.groupby("resolution")]
    return pd.concat(parts, ignore_index=True)


PAPER = "overdraw"


def print_matrix(correlations: pd.DataFrame, console: Console) -> None:
    """Print Spearman's rank correlation within polygons, one table per device."""
    for (rasteriser, device), part in _by_device(correlations):
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
    for (rasteriser, device), part in _by_device(correlations):
        rows = table[(table["rasteriser"] == rasteriser) & (table["device"] == device)]
        name = f"predicted-vs-measured-{rasteriser}-{device}"
        title = f"{rasteriser} on {device}"
        files += draw(folder / "plots", name, _scatter, rows, part, title)
    return files


def _by_device(correlations: pd.DataFrame) -> list[tuple[tuple[str, str], pd.DataFrame]]:
    wanted = correlations[correlations["statistic"] == "spearman_within"]
    parts = wanted.groupby(["rasteriser", "device"], sort=False)
    return [((str(rasteriser), str(device)), part) for (rasteriser, device), part in parts]


def _scatter(rows: pd.DataFrame, part: pd.DataFrame, title: str) -> Figure:
    """Draw measures against predictions, both over the polygon's median, to remove its size.

    For the main counter and the time of the least work, a panel for the paper's criterion and one
    for the criterion that ranks best.
    """
    measured = list(dict.fromkeys(part["measure"]))
    times = [name for name in measured if name.startswith(TIME)]
    # Quads are ranked as helper lanes are: all triangulations have the same fragments.
    measures = [name for name in measured if name not in times][:1] + times[:1]
    ranks = part.set_index([part["criterion"].map(column), "measure"])["value"]
    chosen = []
    for measure in measures:
        known = ranks.xs(measure, level="measure").dropna().drop(PAPER, errors="ignore")
        chosen += [(PAPER, measure), *([(str(known.idxmax()), measure)] if len(known) else [])]
    words = (
        f"How well do the paper's A and the best criterion predict? {title}\n"
        "one mark per triangulation, over its polygon's median; dashed: as predicted"
    )
    figure, places = panels(len(chosen), (3.2, 3.1), words, across=2)
    for panel, (criterion, measure) in zip(places, chosen, strict=True):
        scatter_over_medians(panel, rows, criterion, measure, ["polygon", "resolution"])
        panel.axline((1, 1), slope=1, color="black", linewidth=0.8, linestyle="--")
        panel.set_title(
            f"rank correlation {ranks.get((criterion, measure), np.nan):.3f}", fontsize=8
        )
        panel.set_xlabel(f"predicted by {predictors()[criterion]}, over median")
        panel.set_ylabel(f"measured {label(measure)},\nover median")
    legend_below(figure, places, columns=4)
    return figure
