"""A run's polygons, triangulated in many ways and counted; see `polygon_ranking`.

By itself, since a worker process that does this needs no tables, which take long to import.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from harness.figures.registry import predictions
from harness.frame import SUBPIXEL, View
from harness.rasterisers.reference import Reference, predict
from harness.stored import drawings
from harness.study.subjects import evenly
from triangulators import Skipped, TriangulationError, criteria, triangulate, vertices

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


def count_ways(kept: drawings.Geometry, view: View) -> list[dict[str, Any]]:
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
