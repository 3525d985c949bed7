"""How well criteria rank the triangulations of single polygons of a run.

A run draws each polygon as a handful of triangulators do it, which differ little. To judge a
criterion within polygons more is needed: good triangulations, bad ones and random ones. So some
polygons of the run's first view are triangulated in some 25 more ways, and what each costs is
counted on the exact CPU reference, where they lie in the frame. Nothing of it is timed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from shapely import Polygon

from harness.figures.registry import predictions
from harness.frame import SUBPIXEL, View
from harness.measuring.worker import Worker
from harness.rasterisers.reference import Reference, predict
from harness.stored import atomic, drawings
from harness.stored.folder import Run
from harness.study.analysis import SAME
from harness.study.statistics import Estimate, median_within
from harness.study.subjects import evenly
from triangulators import Skipped, TriangulationError, criteria, triangulate, vertices

FILE = "spread.csv"

POLYGONS = 24
RANDOM = 20
FEWEST_VERTICES, MOST_VERTICES = 8, 60
"""Smaller polygons have too few triangulations to rank; of larger ones random ones take long."""

NAMED = (
    "ear-clipping",
    "delaunay",
    *(f"{end}:{name}" for name in ("half-perimeter", "overdraw") for end in ("optimal", "worst")),
)

MEASURES = Reference.counters
"""What can be judged: what the reference counts."""


def write(run: Run) -> Path | None:
    """Write `FILE` for the first view that the run kept drawings of; None where there is none."""
    for record in run.records:
        view = drawings.view_of(record)
        if record["status"] == "ok" and (kept := drawings.read(run, view)) is not None:
            with Worker("the criteria's judge") as worker:
                rows = worker.call(_rows, kept, view)
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
    return median_within("spearman_within", columns)


def ranks(table: pd.DataFrame, measure: str) -> dict[str, Estimate]:
    """Return `estimate` of each criterion that ranks anything."""
    found = {name: estimate(table, name, measure) for name in predictions() if name in table}
    return {name: each for name, each in found.items() if np.isfinite(each.value)}


def _rows(kept: drawings.Geometry, view: View) -> list[dict[str, Any]]:
    """Return each triangulation's criteria and counts; this needs compiled code."""
    rows = []
    for number, points in _chosen(kept):
        for name, triangles in _triangulations(Polygon(points / SUBPIXEL)):
            counts = predict(points, triangles)
            predicted = criteria.predict(points / SUBPIXEL, triangles)
            rows.append(
                {
                    "polygon": number,
                    "resolution": view.resolution,
                    "rotation": view.rotation,
                    "fit": view.fit,
                    "triangulator": name,
                    **{name: predicted[name] for name in (*predictions(), "area", "triangles")},
                    **{name: int(counts[name].sum()) for name in MEASURES},
                }
            )
    return rows


def _chosen(kept: drawings.Geometry) -> Iterator[tuple[int, NDArray[np.int32]]]:
    """Yield (number in the scene, vertices) of polygons without holes, at steps through sizes."""
    if kept.ring_ends is None:
        return
    sizes = np.diff(kept.offsets)
    rings = np.searchsorted(kept.ring_ends, kept.offsets[1:], side="right")
    simple = np.diff(np.concatenate([[0], rings])) == 1
    fit = np.flatnonzero(simple & (sizes >= FEWEST_VERTICES) & (sizes <= MOST_VERTICES))
    for k in evenly(fit[np.argsort(sizes[fit], kind="stable")].tolist(), POLYGONS):
        yield int(kept.source[k]), kept.points[kept.offsets[k] : kept.offsets[k + 1]]


def _triangulations(polygon: Polygon) -> Iterator[tuple[str, NDArray[np.int32]]]:
    """Yield (name, triangles) of each way that does the polygon without leaving a vertex out."""
    ways: list[tuple[str, str, dict[str, Any]]] = [(name, name, {}) for name in NAMED]
    ways += [(f"random#{seed}", "random", {"seed": seed}) for seed in range(RANDOM)]
    for name, triangulator, parameters in ways:
        try:
            triangles = triangulate(polygon, triangulator, **parameters)
        except (Skipped, TriangulationError):
            continue
        if len(triangles) == len(vertices(polygon)) - 2:
            yield name, triangles
