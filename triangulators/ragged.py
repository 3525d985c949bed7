"""Many polygons, and their triangulations, as arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import shapely

from triangulators.compute.kernels import njit
from triangulators.geometry.half_edges import is_triangulation, link
from triangulators.polygon import polygon_of_rings


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
    compiled: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.bool_))

    def __len__(self) -> int:
        return len(self.starts) - 1

    def __getitem__(self, index: Any) -> Any:
        rows = range(len(self))[index]
        if isinstance(rows, range):
            return [self[row] for row in rows]
        return self.triangles[self.starts[rows] : self.starts[rows + 1]]


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
    return polygon_of_rings(arrays.coordinates[start : int(ends[-1])], ends - start)


class Batch(NamedTuple):
    """Arrays of p polygons.

    coordinates (n, 2); rings (r + 1,): bounds of rings in it; owners (p + 1,): bounds of polygons
    in `rings`; begins (p + 1,): bounds of polygons in `coordinates`; starts (p + 1,): bounds of
    polygons in `triangles` (m, 3), where there is room for each one's; done (p,): which succeeded.
    """

    coordinates: np.ndarray
    rings: np.ndarray
    owners: np.ndarray
    begins: np.ndarray
    starts: np.ndarray
    triangles: np.ndarray
    done: np.ndarray


@njit(nogil=True)
def polygon_of(
    index: int, coordinates: np.ndarray, rings: np.ndarray, owners: np.ndarray, begins: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (n, 2) of polygon `index` of a `Batch`, and where in them its rings end."""
    ends = rings[owners[index] + 1 : owners[index + 1] + 1] - begins[index]
    return coordinates[begins[index] : begins[index + 1]], ends


def batch_of(arrays: Ragged) -> Batch:
    """Return polygons with room for their triangles; none is done."""
    coordinates = np.ascontiguousarray(arrays.coordinates, dtype=np.float64)
    rings = np.r_[0, arrays.ring_ends].astype(np.int64)
    owners = np.r_[0, arrays.polygon_ends].astype(np.int64)
    begins = rings[owners]
    room = np.diff(begins) - 2 + 2 * (np.diff(owners) - 1)
    starts = np.r_[0, np.cumsum(np.maximum(room, 0))]
    triangles = np.empty((starts[-1], 3), dtype=np.int32)
    done = np.zeros(len(owners) - 1, dtype=np.bool_)
    return Batch(coordinates, rings, owners, begins, starts, triangles, done)


def doubtful(arrays: Ragged, known: Mapping[int, np.ndarray]) -> list[int]:
    """Return the polygons whose (m, 3) triangles are not seen at once to be sound and conforming.

    known : triangles by the number of their polygon in `arrays`

    Others may be right, too, such as those with T-junctions: they are to be verified one by one.
    """
    if not known:
        return []
    bounds = np.r_[0, np.cumsum([len(piece) for piece in known.values()])]
    triangles = np.concatenate(list(known.values())).astype(np.int32)
    return list(_doubted(batch_of(arrays), np.array(list(known)), triangles, bounds))


@njit(nogil=True)
def _doubted(
    batch: Batch, which: np.ndarray, triangles: np.ndarray, bounds: np.ndarray
) -> list[int]:
    """Return those of the polygons `which` (k,) of whose triangles `is_triangulation` is not true.

    Those of polygon which[i] are the rows from bounds[i] to bounds[i + 1].
    """
    coordinates, rings, owners, begins, _starts, _triangles, _done = batch
    found = [0 for _ in range(0)]
    for row in range(len(which)):
        points, ends = polygon_of(which[row], coordinates, rings, owners, begins)
        own = triangles[bounds[row] : bounds[row + 1]]
        corner = own.reshape(-1)
        sound = len(own) > 0 and own.min() >= 0 and own.max() < len(points)
        if not sound or not is_triangulation(points, ends, corner, link(corner)):
            found.append(which[row])
    return found
