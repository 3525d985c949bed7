"""Regret: the extra cost of the triangulation that a criterion or a triangulator selects.

A rank correlation measures how well a criterion sorts triangulations. Regret measures the cost of
errors: for each polygon, the cost of the selected triangulation relative to the minimum, less 1.
The minimum of quads and helper lanes is exact if `optimal:exact-quads` was measured;
otherwise the minimum of the measured triangulations is used.

The minimum of many noisy medians is lower than any true time. So a regret of a time has a lower and
an upper estimate, from processes or epochs, which bracket the truth on average (`estimate_regret`).
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console

from harness.metrics.groups import group_records
from harness.metrics.registry import list_costs, list_predictions
from harness.metrics.statistics import (
    MIN_VALUES,
    UNKNOWN,
    Column,
    compute_mean_interval,
    split_rounds,
)
from harness.results.record import Record, Time
from harness.study.correlations import (
    TIME,
    get_measure_title,
    get_predictor_column,
    make_criterion_table,
)
from harness.study.subjects import MIN_QUADS
from harness.style import format_latex_table, format_markdown_table, get_family

QUAD_COUNTERS = ("quads", "helper_lanes")  # have their minimum together: fragments are equal
NOT_CHOSEN = ("worst", "listed")  # only widen the range of costs; no program would choose them

VIEW = ("rasteriser", "device", "resolution", "rotation", "samples")
KEYS = (*VIEW, "measure", "kind", "name")
COLUMNS = (
    *KEYS,
    *("polygon", "triangulator", "best", "least_known", "regret", "regret_low", "regret_high"),
)
SUMMARY = (
    *KEYS,
    *("polygons", "least_known", "mean", "ci_low", "ci_high", "median", "p95", "worst"),
)


def estimate_regret(values: Column, selected: int) -> tuple[float, float]:
    """Return a lower and an upper estimate of the regret of the candidate `selected`.

    values : (k, b) costs of k candidates in b independent blocks of noisy measurements. The plug-in
    estimate compares with the minimum of the means over all blocks, which is too low, so that the
    estimate is too high on average. The cross-fitted estimate compares with the best candidate of
    the other blocks; it is too low on average, and may be below 0. The true regret lies between the
    expectations of both estimates, as the minimum is concave (Jensen's inequality).
    """
    logs = np.log(values)
    means = logs.mean(axis=1)
    rest_sums = logs.sum(axis=1, keepdims=True) - logs
    best = rest_sums.argmin(axis=0)
    cross_fitted = (logs[selected] - logs[best, np.arange(len(best))]).mean()
    plug_in = means[selected] - means.min()
    return float(np.expm1(cross_fitted)), float(np.expm1(plug_in))


def compute_regret_interval(low: Column, high: Column) -> tuple[float, float]:
    """Return the 95 % interval of the mean regret from lower and upper estimates (p,)."""
    ends = compute_mean_interval(low)[0], compute_mean_interval(high)[1]
    return (max(0.0, ends[0]), ends[1]) if np.isfinite(ends).all() else UNKNOWN


def make_regret_table(records: Sequence[Record]) -> pd.DataFrame:
    """Return one row for each polygon, measure, and criterion or triangulator (`kind`, `name`).

    triangulator : the selected one; best : the one with the minimum, for times over all rounds;
    least_known : whether the minimum is proven over all triangulations; regret : ratio to the
    minimum, less 1, for a time the mean of `regret_low` (cross-fitted) and `regret_high` (plug-in)
    """
    rows = []
    counted: set[tuple[Any, ...]] = set()
    for group in group_records(records):
        case = group.id
        records_ok = [r for r in group.measured if r.polygons and r.conforming]
        if len(records_ok) < 2:
            continue
        view = (case.view.resolution, case.view.rotation, case.options.samples)
        conditions = (case.rasteriser, case.device_name, *view)
        regrets = {}
        # Counters are independent of the work per fragment and used once.
        if (*conditions, case.scene) not in counted:
            counted.add((*conditions, case.scene))
            for measure in list_costs(records_ok[0].counters):
                values = [r.counters[measure] for r in records_ok if measure in r.counters]
                if len(values) == len(records_ok):
                    regrets[measure] = _compare_counts(values)
        times = [record.time for record in records_ok if record.time is not None]
        if len(times) == len(records_ok) and min(len(time.samples_s) for time in times) > 1:
            regrets[f"{TIME}{case.options.work}"] = _compare_times(times)
        proven = any(r.name == MIN_QUADS and r.proven == r.polygons for r in records_ok)
        for measure, (best, estimates) in regrets.items():
            least_known = proven and measure in QUAD_COUNTERS and case.options.samples == 1
            for kind, name, index in _list_choices(records_ok):
                low, high = estimates[index]
                row = (case.scene, records_ok[index].name, records_ok[best].name, least_known)
                if not np.isnan(low):
                    rows.append(
                        (*conditions, measure, kind, name, *row, (low + high) / 2, low, high)
                    )
    return pd.DataFrame(rows, columns=COLUMNS)


def _list_choices(records: Sequence[Record]) -> Iterator[tuple[str, str, int]]:
    """Yield (kind, name, index in `records`) of the choice of each criterion and triangulator."""
    for criterion in list_predictions():
        indices = [k for k, record in enumerate(records) if criterion in record.predicted]
        values = [records[k].predicted[criterion] for k in indices]
        if indices and min(values) < max(values):  # otherwise the criterion has no preference
            yield "criterion", criterion.replace("_", "-"), indices[int(np.argmin(values))]
    for index, record in enumerate(records):
        family = get_family(record.name)
        if family.partition(":")[0] not in NOT_CHOSEN:
            yield "triangulator", family, index


def _compare_counts(values: Sequence[float]) -> tuple[int, list[tuple[float, float]]]:
    """Return the index of the minimum, and (low, high) of each regret; NaN above a minimum of 0."""
    best = min(values)
    regrets = [0.0 if v == best else v / best - 1.0 if best else np.nan for v in values]
    return values.index(best), [(regret, regret) for regret in regrets]


def _compare_times(times: Sequence[Time]) -> tuple[int, list[tuple[float, float]]]:
    """Return the index of the minimum time, and (low, high) of each regret, in the same rounds."""
    rounds, first = min(len(time.samples_s) for time in times), times[0]
    samples = np.array([time.samples_s[:rounds] for time in times])
    relative = samples / np.array([time.reference_s[:rounds] for time in times])
    parts = split_rounds(first.processes, first.epochs, rounds)
    values = np.stack([np.median(relative[:, part], axis=1) for part in parts], 1)
    best = int(np.argmin(np.log(values).mean(axis=1)))
    return best, [estimate_regret(values, index) for index in range(len(times))]


def summarise_regret(table: pd.DataFrame) -> pd.DataFrame:
    """Return columns `SUMMARY`: regret over polygons, with the 95 % interval of the mean.

    Triangulations of one family, such as random ones, count once per polygon, by their mean.
    `least_known` is the share of polygons whose minimum is proven over all triangulations.
    """
    rows = []
    columns = ["regret", "regret_low", "regret_high", "least_known"]
    for key, part in table.groupby(list(KEYS), sort=False):
        values, lows, highs, least_known = (
            part.groupby("polygon", sort=False)[columns].mean().to_numpy(float).T
        )
        spread = (np.median(values), np.percentile(values, 95), values.max())
        mean = (max(0.0, values.mean()), *compute_regret_interval(lows, highs))
        rows.append((*key, len(values), least_known.mean(), *mean, *spread))
    return pd.DataFrame(rows, columns=SUMMARY)


def write_regret(records: Sequence[Record], folder: Path) -> pd.DataFrame:
    """Write regret.csv and regret_by_polygon.csv into `folder`; return the former's content."""
    table = make_regret_table(records)
    summary = summarise_regret(table)
    table.to_csv(folder / "regret_by_polygon.csv", index=False, float_format="%.6g")
    summary.to_csv(folder / "regret.csv", index=False, float_format="%.6g")
    return summary


PAPER_TABLE = "criteria"  # stem of the files of the table for a paper


def write_paper_table(correlations: pd.DataFrame, regrets: pd.DataFrame, folder: Path) -> None:
    """Write criteria.md and criteria.tex (booktabs): a row for each measure and criterion.

    Cells are the median rank correlation within polygons and, at each resolution, the mean regret,
    both with 95 % intervals; criteria are sorted by rank correlation.
    """
    ranks = correlations[correlations["statistic"] == "spearman_within"].dropna(subset=["value"])
    ranks = ranks[ranks["criterion"].map(get_predictor_column).isin(list_predictions())]
    of_criteria = regrets[regrets["kind"] == "criterion"].to_dict("records")
    keys = ("rasteriser", "device", "measure", "name", "resolution")
    cells = {tuple(row[key] for key in keys): format_regret(row) for row in of_criteria}
    sizes = sorted({key[-1] for key in cells})
    heading = ["device", "measure", "criterion", "rank correlation (95 % CI)"]
    heading += [f"mean regret at {size} px (95 % CI)" for size in sizes]
    rows = []
    for (rasteriser, device), part in ranks.groupby(["rasteriser", "device"], sort=False):
        for measure in select_printed_measures(part["measure"]):
            of_measure = part[part["measure"] == measure].sort_values("value", ascending=False)
            for row in of_measure.to_dict("records"):
                ends = f" ({row['ci_low']:.2f} to {row['ci_high']:.2f})"
                rank = f"{row['value']:.2f}" + ("" if np.isnan(row["ci_low"]) else ends)
                name = row["criterion"]
                regret = [cells.get((rasteriser, device, measure, name, n), "") for n in sizes]
                title = get_measure_title(measure)
                rows.append([f"{rasteriser} on {device}", title, name, rank, *regret])
    for suffix, format_table in (("md", format_markdown_table), ("tex", format_latex_table)):
        text = format_table(heading, rows, 3)
        (folder / f"{PAPER_TABLE}.{suffix}").write_text(text, encoding="utf-8")


def select_printed_measures(measured: Iterable[str]) -> list[str]:
    """Return the measures to print: quad counters, or the main counter without these; all times."""
    names = list(dict.fromkeys(measured))
    times = [name for name in names if name.startswith(TIME)]
    counted = [name for name in names if name not in times]
    return ([name for name in counted if name in QUAD_COUNTERS] or counted[:1]) + times


def print_regret(summary: pd.DataFrame, console: Console) -> None:
    """Print the regret of each criterion, one table per device and view."""
    criteria = summary[summary["kind"] == "criterion"]
    for (rasteriser, device, resolution, *_), part in criteria.groupby(list(VIEW), sort=False):
        title = f"regret, by criterion: {rasteriser} on {device}, {resolution} px"
        rows = part.to_dict("records")
        cells = {(row["name"], row["measure"]): format_regret(row) for row in rows}
        measures = select_printed_measures(part["measure"])
        console.print(make_criterion_table(title, cells, measures))


def format_regret(row: Any) -> str:
    """Return a row's mean with its interval, in per cent, or why the interval is unknown."""
    if not np.isnan(row["ci_low"]):
        text = f"{row['ci_low']:.2%} to {row['ci_high']:.2%}"
    elif row["polygons"] < MIN_VALUES:
        text = "too few polygons"
    elif math.isclose(row["worst"], row["mean"]):
        text = "all equal"
    elif row["worst"] > row["mean"] * row["polygons"] / 2:
        text = "one polygon dominates"
    else:
        text = "few polygons dominate"
    return f"{row['mean']:.2%} ({text})"
