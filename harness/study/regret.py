"""Regret: what is lost by trusting a criterion, or a triangulator, in place of knowing the best.

A rank correlation says how well a criterion sorts triangulations. Regret says what that is worth:
of each polygon, what the triangulation that the criterion calls best costs in ratio to the best
there is, less 1. The best there is, of quads and helper lanes, is known where `optimal:exact-quads`
was measured; of all else it is the best that was measured.

Times need care. The least of many noisy medians is lower than any true time, so that even the best
triangulation would show a regret; and what one part of the rounds calls best is not the best in
another part. So a regret of a time has two ends, between which the truth is on average: see
`regret_ends`. The parts are repeats or epochs, which share no buffers.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console

from harness.metrics.groups import group_records
from harness.metrics.per_polygon import Column
from harness.metrics.registry import list_costs, list_predictions
from harness.results.record import Record, Time
from harness.stats.intervals import FEWEST, UNKNOWN, blocks, mean_interval
from harness.study.correlations import TIME, by_criterion, column, label
from harness.study.subjects import LEAST
from harness.style import family_of

OF_QUADS = ("quads", "helper_lanes")

NOT_CHOSEN = ("worst", "listed")
"""Families of triangulators that nobody would trust: they are there for the spread."""

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
    others = logs.sum(axis=1, keepdims=True) - logs
    best = others.argmin(axis=0)
    crossed = (logs[chosen] - logs[best, np.arange(len(best))]).mean()
    plugged = means[chosen] - means.min()
    return float(np.expm1(crossed)), float(np.expm1(plugged))


def regret_interval(low: Column, high: Column) -> tuple[float, float]:
    """Return the 95 % interval of mean regret, of `regret_ends` of each polygon, (p,) each.

    No less than 0, for nothing is better than the best; NaN where the polygons do not tell it.
    """
    ends = mean_interval(low)[0], mean_interval(high)[1]
    return (max(0.0, ends[0]), ends[1]) if np.isfinite(ends).all() else UNKNOWN


def regret_table(records: Sequence[Record]) -> pd.DataFrame:
    """Return `COLUMNS`, one row for each polygon, measure, and criterion or triangulator.

    kind : "criterion" or "triangulator", called `name`; `triangulator` is what it chose
    best : the best there is, or of times the one that all rounds together call best
    least_known : whether no triangulation of any kind can be better
    regret : ratio to the best, less 1; of a time, the middle between its two ends
    regret_low, regret_high : the ends, cross-fitted and plugged in; equal for counters
    """
    rows = []
    counted: set[tuple[Any, ...]] = set()
    for group in group_records(records):
        case = group.id
        good = [record for record in group.measured if record.polygons and record.conforming]
        if len(good) < 2:
            continue
        view = (case.view.resolution, case.view.rotation, case.options.samples)
        where = (case.rasteriser, case.device_name, *view)
        regrets = {}
        # Counters do not depend on the work a fragment does: once for all of them.
        if (*where, case.scene) not in counted:
            counted.add((*where, case.scene))
            for measure in list_costs(good[0].counters):
                values = [record.counters[measure] for record in good if measure in record.counters]
                if len(values) == len(good):
                    regrets[measure] = _of_counter(values)
        times = [record.time for record in good if record.time is not None]
        if len(times) == len(good) and min(len(time.samples_s) for time in times) > 1:
            regrets[f"{TIME}{case.options.work}"] = _of_time(times)
        proven = any(r.name == LEAST and r.proven == r.polygons for r in good)
        for measure, (best, ends) in regrets.items():
            known = proven and measure in OF_QUADS and case.options.samples == 1
            for kind, name, index in _choices(good):
                low, high = ends[index]
                row = (case.scene, good[index].name, good[best].name, known)
                if not np.isnan(low):
                    rows.append((*where, measure, kind, name, *row, (low + high) / 2, low, high))
    return pd.DataFrame(rows, columns=COLUMNS)


def _choices(good: Sequence[Record]) -> Iterator[tuple[str, str, int]]:
    """Yield (kind, name, index in `good`) of what each criterion and triangulator chooses."""
    for criterion in list_predictions():
        known = [k for k, record in enumerate(good) if criterion in record.predicted]
        values = [good[k].predicted[criterion] for k in known]
        if known and min(values) < max(values):  # otherwise it chooses none
            yield "criterion", criterion.replace("_", "-"), known[int(np.argmin(values))]
    for index, record in enumerate(good):
        family = family_of(record.name)
        if family.partition(":")[0] not in NOT_CHOSEN:
            yield "triangulator", family, index


def _of_counter(values: Sequence[float]) -> tuple[int, list[tuple[float, float]]]:
    """Return the index of the best, and both ends of each regret; NaN if the best is 0."""
    best = min(values)
    regrets = [0.0 if each == best else each / best - 1.0 if best else np.nan for each in values]
    return values.index(best), [(each, each) for each in regrets]


def _of_time(times: Sequence[Time]) -> tuple[int, list[tuple[float, float]]]:
    """Return the index of the best of times of the same rounds, and both ends of each regret."""
    rounds, first = min(len(time.samples_s) for time in times), times[0]
    samples = np.array([time.samples_s[:rounds] for time in times])
    relative = samples / np.array(first.reference_s[:rounds])
    parts = blocks(first.processes, first.epochs, rounds)
    values = np.stack([np.median(relative[:, part], axis=1) for part in parts], 1)
    best = int(np.argmin(np.log(values).mean(axis=1)))
    return best, [regret_ends(values, index) for index in range(len(times))]


def summarise(table: pd.DataFrame) -> pd.DataFrame:
    """Return `SUMMARY`: regret over polygons, with the mean's 95 % interval over them.

    Several triangulations of one family, such as random ones, count once a polygon, by their mean.
    least_known : the share of polygons whose best is known to be the least
    ci_low, ci_high : of the lower ends and of the upper ones, and no less than 0, for nothing is
        better than the best; NaN where the polygons do not tell
    """
    rows = []
    told = ["regret", "regret_low", "regret_high", "least_known"]
    for key, part in table.groupby(list(KEYS), sort=False):
        values, lows, highs, known = (
            part.groupby("polygon", sort=False)[told].mean().to_numpy(float).T
        )
        spread = (np.median(values), np.percentile(values, 95), values.max())
        ends = regret_interval(lows, highs)
        rows.append((*key, len(values), known.mean(), max(0.0, values.mean()), *ends, *spread))
    return pd.DataFrame(rows, columns=SUMMARY)


def write(records: Sequence[Record], folder: Path) -> pd.DataFrame:
    """Write regret.csv and regret_by_polygon.csv into `folder`; returns the first."""
    table = regret_table(records)
    summary = summarise(table)
    table.to_csv(folder / "regret_by_polygon.csv", index=False, float_format="%.6g")
    summary.to_csv(folder / "regret.csv", index=False, float_format="%.6g")
    return summary


PAPER_TABLE = "criteria"
"""Stem of the files of the table for a paper."""


def write_paper_table(correlations: pd.DataFrame, regrets: pd.DataFrame, folder: Path) -> None:
    """Write criteria.md and criteria.tex (booktabs): a row for each measure and criterion.

    Cells are the median rank correlation within polygons and, at each resolution, the mean regret,
    both with their 95 % intervals; criteria are sorted by rank correlation.
    """
    ranks = correlations[correlations["statistic"] == "spearman_within"].dropna(subset=["value"])
    ranks = ranks[ranks["criterion"].map(column).isin(list_predictions())]
    chosen = regrets[regrets["kind"] == "criterion"]
    cells = {
        (row["rasteriser"], row["device"], row["measure"], row["name"], row["resolution"]): written(
            row
        )
        for row in chosen.to_dict("records")
    }
    sizes = sorted({key[-1] for key in cells})
    heading = ["device", "measure", "criterion", "rank correlation (95 % CI)"]
    heading += [f"mean regret at {size} px (95 % CI)" for size in sizes]
    rows = []
    for (rasteriser, device), part in ranks.groupby(["rasteriser", "device"], sort=False):
        for measure in main_measures(part["measure"]):
            of_measure = part[part["measure"] == measure].sort_values("value", ascending=False)
            for row in of_measure.to_dict("records"):
                ends = f" ({row['ci_low']:.2f} to {row['ci_high']:.2f})"
                rank = f"{row['value']:.2f}" + ("" if np.isnan(row["ci_low"]) else ends)
                key = (rasteriser, device, measure, row["criterion"])
                regret = [cells.get((*key, size), "") for size in sizes]
                where = f"{rasteriser} on {device}"
                rows.append([where, label(measure), row["criterion"], rank, *regret])
    lines = [heading, ["---"] * 3 + ["--:"] * (len(heading) - 3), *rows]
    markdown = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    first, *body = (" & ".join(map(_escape_latex, line)) + " \\\\\n" for line in (heading, *rows))
    columns = "lll" + "r" * (len(heading) - 3)
    latex = f"\\begin{{tabular}}{{{columns}}}\n\\toprule\n{first}\\midrule\n{''.join(body)}"
    latex += "\\bottomrule\n\\end{tabular}\n"
    for suffix, text in (("md", markdown), ("tex", latex)):
        (folder / f"{PAPER_TABLE}.{suffix}").write_text(text, encoding="utf-8")


def _escape_latex(text: str) -> str:
    """Return `text` with the special characters of LaTeX escaped."""
    return re.sub(r"([%_#&$])", r"\\\1", text)


def main_measures(measured: Iterable[str]) -> list[str]:
    """Return the measures to print: quad counters, or else the main counter; and all times."""
    names = list(dict.fromkeys(measured))
    times = [name for name in names if name.startswith(TIME)]
    counted = [name for name in names if name not in times]
    return ([name for name in counted if name in OF_QUADS] or counted[:1]) + times


def print_regret(summary: pd.DataFrame, console: Console) -> None:
    """Print what trusting each criterion costs, one table per device and view."""
    wanted = summary[summary["kind"] == "criterion"]
    for (rasteriser, device, resolution, *_), part in wanted.groupby(list(VIEW), sort=False):
        title = f"regret, by criterion: {rasteriser} on {device}, {resolution} px"
        cells = {(row["name"], row["measure"]): written(row) for row in part.to_dict("records")}
        console.print(by_criterion(title, cells, main_measures(part["measure"])))


def written(row: Any) -> str:
    """Return a row's mean with its interval, in per cent, or why there is none."""
    if np.isnan(row["ci_low"]):
        return f"{row['mean']:.2%} ({why_no_interval(row)})"
    return f"{row['mean']:.2%} ({row['ci_low']:.2%} to {row['ci_high']:.2%})"


def why_no_interval(row: Any) -> str:
    """Say why a row's polygons tell no interval of their mean."""
    if row["polygons"] < FEWEST:
        return "too few polygons"
    if math.isclose(row["worst"], row["mean"]):
        return "all equal"
    one = row["worst"] > row["mean"] * row["polygons"] / 2
    return "one decides" if one else "few decide"
