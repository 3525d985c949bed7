"""Many polygons, and their triangulations, as arrays."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

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


@dataclass(frozen=True)
class Triangulations(Sequence[np.ndarray]):
    """Triangulations of many polygons; `[i]` is that of polygon i, (m, 3) int32.

    triangles: (M, 3), each polygon's as indices into its own vertices; starts: (p + 1,), where
    each polygon's begin. `failed` says why, for each polygon that has none. compiled: (p,) those
    that compiled code or a device did; an optimum is exact there.
    """

    triangles: np.ndarray
    starts: np.ndarray
    failed: dict[int, str] = field(default_factory=dict)
    compiled: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.starts) - 1

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"polygon {index} of {len(self)}")
        index %= len(self)
        return self.triangles[self.starts[index] : self.starts[index + 1]]

    def __iter__(self) -> Iterator[np.ndarray]:
        return (self[index] for index in range(len(self)))


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
