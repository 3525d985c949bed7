"""From a study's records to the matrix of criteria against measurements."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from harness.stored.folder import Record
from harness.study.statistics import Estimate, pooled, within

CRITERIA = {
    "overdraw": "A, bounding-box overdraw",
    "shape": "D, shape deviation",
    "complexity": "C, complexity",
    "half_perimeter": "H, half-perimeter",
    "expected_quads": "Q, expected quads",
    "expected_blocks": "P, expected 4x4 blocks",
    "edge_length": "E, edge length",
    "rotation_averaged_overdraw": "A averaged over rotation",
    "exact_quads": "quads, exactly",
    "exact_tiles_16": "tiles of 16 px, exactly",
    "exact_tiles_32": "tiles of 32 px, exactly",
    "exact_tiles_64": "tiles of 64 px, exactly",
}
"""Predictions: the criteria, and what the CPU counts exactly before anything is drawn."""

EXACT = {
    "exact_quads": ("reference", "quads"),
    "exact_tiles_16": ("binning", "tiles_16"),
    "exact_tiles_32": ("binning", "tiles_32"),
    "exact_tiles_64": ("binning", "tiles_64"),
}
"""Predictions that are counters of a rasteriser without a device."""

SAME = ("overdraw", "half_perimeter", "edge_length", "shape")
"""Criteria that, when they are all equal, show two names for one triangulation."""

MEASURES = ("helper_lanes", "quads", "bbox_tests", "rows", "tiles_16", "tiles_32", "tiles_64")
"""Counters worth predicting; times are added to them as time_work_<N>."""


def tabulate(records: Sequence[Record]) -> pd.DataFrame:
    """Return one row per polygon, triangulation, rasteriser, device and view, measures as columns.

    Triangulators that give a polygon the same triangulation, as their criteria show, stand for
    one row: a triangulation must not count twice for having two names. Those with T-junctions
    are left out: they have fewer triangles and cover other pixels.
    """
    good = [r for r in records if r["status"] == "ok" and r["polygons"] and r["conforming"]]
    rows: dict[tuple[object, ...], dict[str, object]] = {}
    for record in good:
        options = record["options"]
        key = (
            record["scene"],
            record["resolution"],
            record["rotation"],
            options["samples"],
            record["rasteriser"],
            record["device"],
            record["triangulator"],
        )
        row = rows.setdefault(key, _predictions(record))
        row |= {name: record["counters"].get(name, np.nan) for name in MEASURES}
        if record.get("time"):
            row[f"time_work_{options['work']}"] = record["time"]["median_s"]
    names = ["polygon", "resolution", "rotation", "samples", "rasteriser", "device", "triangulator"]
    table = pd.DataFrame(
        [{**dict(zip(names, key, strict=True)), **row} for key, row in rows.items()]
    )
    if table.empty:
        return table
    return _with_exact(_without_twins(table, names))


def _predictions(record: Record) -> dict[str, object]:
    predicted = record["predicted"]
    names = [*CRITERIA, "triangles", "area", "bbox_area"]
    return {name: predicted[name] for name in names if name in predicted}


def _without_twins(table: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    same = [name for name in names if name != "triangulator"]
    rounded = table[list(SAME)].round(6)
    return table[~pd.concat([table[same], rounded], axis=1).duplicated()].reset_index(drop=True)


def _with_exact(table: pd.DataFrame) -> pd.DataFrame:
    """Add what the CPU predicts exactly, from the rows of the rasterisers that count it."""
    where = ["polygon", "resolution", "rotation", "triangulator"]
    for name, (rasteriser, counter) in EXACT.items():
        source = table[(table["rasteriser"] == rasteriser) & (table["samples"] == 1)]
        values = source[[*where, counter]].rename(columns={counter: name})
        table = table.merge(values.drop_duplicates(where), on=where, how="left")
    return table


def without_twins(records: Sequence[Record]) -> list[Record]:
    """Return the records of one polygon and view, the first of each triangulation."""
    seen: dict[tuple[float, ...], Record] = {}
    for record in records:
        seen.setdefault(tuple(round(record["predicted"][name], 6) for name in SAME), record)
    return list(seen.values())


def correlate(table: pd.DataFrame) -> pd.DataFrame:
    """Return the contents of correlations.csv: every criterion against every measure."""
    rows = []
    for (rasteriser, device), part in table.groupby(["rasteriser", "device"], sort=False):
        times = [name for name in part.columns if name.startswith("time_work_")]
        for measure in [*MEASURES, *times]:
            if part[measure].notna().sum() == 0:
                continue
            for criterion in CRITERIA:
                estimates = _estimates(part, criterion, measure)
                rows += [
                    {
                        "rasteriser": rasteriser,
                        "device": device,
                        "criterion": criterion,
                        "measure": measure,
                        "statistic": estimate.statistic,
                        "value": estimate.value,
                        "ci_low": estimate.low,
                        "ci_high": estimate.high,
                        "polygons": estimate.polygons,
                    }
                    for estimate in estimates
                ]
    return pd.DataFrame(rows)


def _estimates(part: pd.DataFrame, criterion: str, measure: str) -> list[Estimate]:
    known = part[[criterion, measure]].notna().all(axis=1)
    columns, triangles = [], []
    for _, polygon in part[known].groupby(["polygon", "resolution", "rotation", "samples"]):
        columns.append((polygon[criterion].to_numpy(float), polygon[measure].to_numpy(float)))
        triangles.append(polygon["triangles"].to_numpy(float))
    return [*within(columns), *pooled(columns, triangles)]


def write(table: pd.DataFrame, folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Write what `tabulate` gave, and what `correlate` and `by_resolution` make of it.

    Returns the latter two; correlations_by_resolution.csv is written where there are several.
    """
    table.to_csv(folder / "measured.csv", index=False, float_format="%.6g")
    correlations = correlate(table)
    correlations.to_csv(folder / "correlations.csv", index=False, float_format="%.6g")
    sizes = by_resolution(table)
    if not sizes.empty:
        sizes.to_csv(folder / "correlations_by_resolution.csv", index=False, float_format="%.6g")
    return correlations, sizes


def by_resolution(table: pd.DataFrame) -> pd.DataFrame:
    """Return `correlate` of each resolution by itself, with the resolution; empty for one alone."""
    if table.empty or table["resolution"].nunique() < 2:
        return pd.DataFrame()
    parts = [
        correlate(part).assign(resolution=size)
        for size, part in table.groupby("resolution", sort=True)
    ]
    return pd.concat(parts, ignore_index=True)
