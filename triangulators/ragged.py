"""Many polygons as arrays."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely


class Ragged(NamedTuple):
    """Polygons as arrays: coordinates (n, 2) float64, ring after ring and none closed.

    `ring_ends` (r,): where in `coordinates` each ring ends; `polygon_ends` (p,): where in
    `ring_ends` each polygon ends, its exterior first. Rings are taken to be valid.
    """

    coordinates: np.ndarray
    ring_ends: np.ndarray
    polygon_ends: np.ndarray


def ragged(polygons: Sequence[shapely.Polygon] | np.ndarray) -> Ragged:
    """Return shapely polygons as `Ragged` arrays."""
    array = np.asarray(polygons, dtype=object)
    rings, owner = shapely.get_rings(array, return_index=True)
    lengths = shapely.get_num_coordinates(rings)
    coordinates = shapely.get_coordinates(rings)
    keep = np.ones(len(coordinates), dtype=np.bool_)
    keep[np.cumsum(lengths) - 1] = False
    polygon_ends = np.cumsum(np.bincount(owner, minlength=len(array)))
    return Ragged(coordinates[keep], np.cumsum(lengths - 1), polygon_ends)


def polygon_at(arrays: Ragged, index: int) -> shapely.Polygon:
    """Return one polygon of `Ragged` arrays."""
    first = int(arrays.polygon_ends[index - 1]) if index else 0
    ends = arrays.ring_ends[first : int(arrays.polygon_ends[index])]
    start = int(arrays.ring_ends[first - 1]) if first else 0
    rings = np.split(arrays.coordinates[start : int(ends[-1])], ends[:-1] - start)
    return shapely.Polygon(rings[0], rings[1:])
