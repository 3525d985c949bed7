"""Polygons of any extent on the pixel grid, each near the origin, as a batch."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from harness.frame import SUBPIXEL, snap

PERIOD_PX = 4
"""Moving a polygon by so many pixels changes no counter: blocks of 2x2 and 4x4 stay the same."""


def on_pixels(
    polygons: NDArray[Any], units_per_pixel: float, margin: int | None = None
) -> tuple[NDArray[Any], NDArray[np.int64], int]:
    """Scale polygons to pixels, move each near the origin, and snap it to 1/256 px.

    margin : pixels by which all are moved instead, where it matters at which pixel they lie

    Returns the pieces (p,), in px; for each the number of its polygon; and how many polygons vanish
    on the grid. The place on the grid of pixels, modulo `PERIOD_PX`, is that of the coordinates.
    """
    scaled = shapely.transform(polygons, lambda xy: xy / units_per_pixel)
    corner = shapely.bounds(scaled)[:, :2]
    shift = PERIOD_PX * np.floor(corner / PERIOD_PX)
    if margin is not None:
        shift[:] = -margin
    counts = shapely.get_num_coordinates(scaled)
    offsets = np.repeat(shift, counts, axis=0)
    near = shapely.set_coordinates(scaled, shapely.get_coordinates(scaled) - offsets)
    grid = shapely.transform(near, lambda xy: np.rint(xy * SUBPIXEL) / SUBPIXEL)
    good = shapely.is_valid(grid) & (shapely.area(grid) > 0) & ~_with_repeats(grid)
    pieces: list[Any] = []
    source: list[int] = []
    vanished = 0
    for number in np.flatnonzero(~good).tolist():
        found = snap(near[number]).pieces
        vanished += not found
        pieces += found
        source += [number] * len(found)
    made = np.array([*grid[good], *pieces], dtype=object)
    owners = np.r_[np.flatnonzero(good), np.array(source, dtype=np.int64)].astype(np.int64)
    order = np.argsort(owners, kind="stable")
    return shapely.orient_polygons(made[order]), owners[order], vanished


def _with_repeats(polygons: NDArray[Any]) -> NDArray[np.bool_]:
    """(p,) whether a vertex follows itself."""
    rings, owner = shapely.get_rings(polygons, return_index=True)
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    same = (xy[1:] == xy[:-1]).all(axis=1) & (ring[1:] == ring[:-1])
    found = np.zeros(len(polygons), dtype=bool)
    found[owner[ring[1:][same]]] = True
    return found
