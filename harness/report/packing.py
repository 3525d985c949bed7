"""Polygons and triangulations of a report: what its heatmaps are drawn from, in little space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.stored.drawings import Geometry
from harness.webpages.single_file import encoded

MOST_TRIANGLES = 1_500_000
"""Triangles that one report carries for its heatmaps, over all triangulators and views."""


def choose(polygons: int, most: int) -> NDArray[np.int64]:
    """Return the numbers, in order, of at most `most` polygons: all, or a fixed random sample."""
    if polygons <= most:
        return np.arange(polygons, dtype=np.int64)
    chosen = np.random.default_rng(0).choice(polygons, size=most, replace=False)
    return np.sort(chosen).astype(np.int64)


def pack(geometry: Geometry, chosen: NDArray[np.int64]) -> dict[str, Any]:
    """Return the `chosen` polygons' points and triangles, JSON-ready.

    points : base64 of int32 x, y in 1/256 px, y up, polygon by polygon; `sizes` vertices each
    triangles : triangulator -> {"counts", "rows"}: triangles of each polygon, and base64 of
        uint32 indices into that polygon's own points
    """
    starts, stops = geometry.offsets[:-1][chosen], geometry.offsets[1:][chosen]
    sizes = stops - starts
    take = _spans(starts, sizes)
    packed = {
        "points": encoded(geometry.points[take].astype("<i4")),
        "sizes": sizes.tolist(),
        "source": geometry.source[chosen].tolist(),
        "triangles": {},
    }
    for name, triangles in geometry.triangles.items():
        owner = np.searchsorted(geometry.offsets, triangles[:, 0], side="right") - 1
        first = np.searchsorted(owner, chosen, side="left")
        counts = np.searchsorted(owner, chosen, side="right") - first
        rows = triangles[_spans(first, counts)] - np.repeat(starts, counts)[:, None]
        packed["triangles"][name] = {
            "counts": counts.tolist(),
            "rows": encoded(rows.astype("<u4")),
        }
    return packed


def _spans(starts: NDArray[np.int64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return starts[0], starts[0] + 1, ..., then from starts[1], for `lengths` numbers each."""
    before = np.cumsum(lengths) - lengths
    return np.arange(int(lengths.sum())) + np.repeat(starts - before, lengths)
