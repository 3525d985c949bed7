"""How well criteria rank the triangulations of single polygons of a run.

A run draws each polygon as a handful of triangulators do it, which differ little. To judge a
criterion within polygons more is needed: good triangulations, bad ones and random ones. So some
polygons of the run's first view are triangulated in some 25 more ways, and what each costs is
counted on the exact CPU reference, where they lie in the frame. Nothing of it is timed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from harness.figures.groups import SAME
from harness.figures.registry import predictions
from harness.frame import View
from harness.measuring.worker import Worker
from harness.stored import atomic, drawings
from harness.stored.folder import Run
from harness.study.correlations import Estimate, within
from harness.study.counted_ways import MEASURES, count_ways

FILE = "spread.csv"


def write(run: Run) -> Path | None:
    """Write `FILE` for the first view that the run kept drawings of; None where there is none."""
    for record in run.records:
        view = drawings.view_of(record)
        if record["status"] == "ok" and (kept := drawings.read(run, view)) is not None:
            with Worker("the criteria's judge") as worker:
                rows = worker.call(count_ways, kept, view)
            if not rows:
                return None
            # Two names for one triangulation must not count twice.
            table = pd.DataFrame(rows).drop_duplicates(["polygon", *SAME, *MEASURES])
            file = run.path / FILE
            atomic.write(file, table.to_csv(index=False, float_format="%.9g").encode())
            return file
    return None


def read(run: Run, view: View) -> pd.DataFrame | None:
    """Return what `write` wrote of `view`; None where there is nothing, or it is damaged."""
    file = run.path / FILE
    if not file.is_file():
        return None
    try:
        table = pd.read_csv(file)
        of_view = (table["resolution"] == view.resolution) & (table["rotation"] == view.rotation)
        table = table[of_view & (table["fit"] == view.fit)]
        table = table.astype(dict.fromkeys([*predictions(), *MEASURES], np.float64))
    except (KeyError, ValueError, OSError, pd.errors.ParserError):
        return None
    return None if table.empty else table


def estimate(table: pd.DataFrame, criterion: str, measure: str) -> Estimate:
    """Return the rank correlation within polygons: the median, with its interval over polygons."""
    columns = [
        (polygon[criterion].to_numpy(float), polygon[measure].to_numpy(float))
        for _, polygon in table.groupby("polygon")
    ]
    return within(columns)


def ranks(table: pd.DataFrame, measure: str) -> dict[str, Estimate]:
    """Return `estimate` of each criterion that ranks anything."""
    found = {name: estimate(table, name, measure) for name in predictions() if name in table}
    return {name: each for name, each in found.items() if np.isfinite(each.value)}
