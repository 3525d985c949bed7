"""What triangulators make of a batch of polygons, counted by the CPU reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.export.apart import triangulate_many
from harness.frame import SUBPIXEL, WHOLE
from harness.rasterisers.reference import predict
from harness.scaling.sums import BINS, GAINED, MEASURES, Sums
from triangulators.batch.triangulate_many import Ragged, ragged


def measured(
    pieces: NDArray[Any],
    owners: NDArray[np.int64],
    count: int,
    names: Sequence[str],
    window: NDArray[np.int64] = WHOLE,
    threads: int | None = 1,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Triangulate polygons by each of t triangulators, and count them.

    pieces, owners : (p,) polygons on the grid of pixels, and which of `count` ones each is of
    window : what is drawn, as `Frame.window` is

    Returns (t, count, len(MEASURES)) sums, and (t, count) which could not be done.
    """
    arrays = ragged(pieces)
    found = [_measured(arrays, owners, count, name, window, threads) for name in names]
    return np.stack([table for table, _ in found]), np.stack([failed for _, failed in found])


def sums_of(
    table: NDArray[np.float64], polygons: NDArray[Any], times: NDArray[np.int64] | None = None
) -> Sums:
    """Add up what was measured (t, p, len(MEASURES)) of p polygons.

    times : (p,) how often each is there; once by default
    """
    each = np.ones(len(polygons), np.int64) if times is None else times
    corners = shapely.get_num_coordinates(polygons) - 1 - shapely.get_num_interior_rings(polygons)
    sums = Sums.empty(len(table))
    sums.footprints, sums.vertices = int(each.sum()), int((each * corners).sum())
    sums.totals = (table * each[:, None]).sum(axis=1)
    for measure, name in enumerate(GAINED):
        column = MEASURES.index(name)
        for triangulator in range(len(table)):
            gained = gains(table[0, :, column], table[triangulator, :, column])
            places = np.clip(np.floor((gained + 1.0) * BINS / 2), 0, BINS - 1).astype(int)
            bins = np.bincount(places, weights=each, minlength=BINS)
            sums.bins[triangulator, measure] = bins.astype(np.int64)
    return sums


def gains(base: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (p,) how much less `other` is than `base`, relative to it; 0 where both are 0."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(base == other, 0.0, 1.0 - other / base)


def _measured(
    arrays: Ragged,
    owners: NDArray[np.int64],
    count: int,
    name: str,
    window: NDArray[np.int64],
    threads: int | None,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(count, len(MEASURES)) sums of each footprint, and (count,) which could not be done."""
    found = triangulate_many(arrays, name, check=False, threads=threads)
    rings = np.r_[0, arrays.ring_ends].astype(np.int64)
    begins = rings[np.r_[0, arrays.polygon_ends].astype(np.int64)]
    sizes = np.diff(found.starts)
    triangles = found.triangles + np.repeat(begins[:-1], sizes)[:, None].astype(np.int32)
    points = np.rint(arrays.coordinates * SUBPIXEL).astype(np.int32)
    each = predict(points, np.ascontiguousarray(triangles, np.int32), window)
    columns: dict[str, NDArray[Any]] = {**each, "triangles": np.ones(len(triangles))}
    columns |= _predictions(arrays.coordinates[triangles])
    owner = np.repeat(owners, sizes)
    table = np.column_stack(
        [np.bincount(owner, weights=columns[measure], minlength=count) for measure in MEASURES]
    ).astype(np.float64)
    failed = np.zeros(count, dtype=bool)
    failed[owners[list(found.failed)]] = True
    return table, failed


def _predictions(corners: NDArray[np.float64]) -> Mapping[str, NDArray[np.float64]]:
    """What the criteria say of triangles (m, 3, 2): H in px, A in px^2."""
    width, height = np.ptp(corners, axis=1).T
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    u, v = b - a, c - a
    area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2
    return {"half_perimeter": width + height, "overdraw": width * height - area}
