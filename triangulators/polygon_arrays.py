"""Many polygons and their triangulations as arrays; shapely polygons are created on demand.

The layout is GeoArrow's:

    coords         (n, 2)  vertices, ring after ring; a ring's first vertex is not repeated
    ring_offsets   (r + 1,)  ring k has coords[ring_offsets[k]:ring_offsets[k + 1]]
    geom_offsets   (p + 1,)  polygon i has the rings geom_offsets[i] to geom_offsets[i + 1] - 1, the
                   exterior first

Two squares, the second with a hole: 12 coords, ring_offsets 0, 4, 8, 12 and geom_offsets 0, 1, 3.
The only difference: GeoArrow and shapely repeat the first vertex at the end of a ring.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, overload

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from triangulators.compute.kernels import njit


@dataclass(frozen=True, eq=False)
class PolygonArray(Sequence[shapely.Polygon]):
    """A read-only sequence of p polygons, stored as arrays.

    Parameters
    ----------
    coords : (n, 2) array
        Vertices: float64, or int32 in units of 1/256 px.
    ring_offsets : (r + 1,) int64 array
        Offsets of the rings in `coords`.
    geom_offsets : (p + 1,) int64 array
        Offsets of the polygons in `ring_offsets`.

    Examples
    --------
    >>> squares = PolygonArray.from_shapely([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)])
    >>> squares.ring_offsets.tolist(), squares.geom_offsets.tolist(), squares[1].area
    ([0, 4, 8], [0, 1, 2], 1.0)
    """

    coords: NDArray[Any]
    ring_offsets: NDArray[np.int64]
    geom_offsets: NDArray[np.int64]

    @classmethod
    def from_shapely(cls, polygons: Sequence[shapely.Polygon] | NDArray[Any]) -> PolygonArray:
        """Return the vertices (float64) and rings of shapely polygons."""
        geometries = np.asarray(polygons, dtype=object)
        rings, owners = shapely.get_rings(geometries, return_index=True)
        lengths = shapely.get_num_coordinates(rings)
        coords = shapely.get_coordinates(rings)
        closing = np.zeros(len(coords), dtype=np.bool_)
        closing[np.cumsum(lengths) - 1] = True
        counts = np.bincount(owners, minlength=len(geometries))
        return cls(coords[~closing], offsets_of(lengths - 1), offsets_of(counts))

    @classmethod
    def of_single_rings(cls, coords: NDArray[Any], vertices: int) -> PolygonArray:
        """Return polygons without holes, with `vertices` vertices each, from coords (n, 2)."""
        ring_offsets = np.arange(0, len(coords) + 1, vertices, dtype=np.int64)
        return cls(coords, ring_offsets, np.arange(len(ring_offsets), dtype=np.int64))

    @classmethod
    def concatenate(cls, parts: Sequence[PolygonArray]) -> PolygonArray:
        """Return the polygons of all `parts` as one array, in order."""
        return cls(
            np.concatenate([part.coords for part in parts]),
            offsets_of(np.concatenate([np.diff(part.ring_offsets) for part in parts])),
            offsets_of(np.concatenate([part.ring_counts for part in parts])),
        )

    @cached_property
    def vertex_offsets(self) -> NDArray[np.int64]:
        """(p + 1,) offsets of the polygons in `coords`."""
        return self.ring_offsets[self.geom_offsets]

    @property
    def vertex_counts(self) -> NDArray[np.int64]:
        """(p,) vertices of each polygon."""
        return np.diff(self.vertex_offsets)

    @property
    def ring_counts(self) -> NDArray[np.int64]:
        """(p,) rings of each polygon."""
        return np.diff(self.geom_offsets)

    @cached_property
    def geometries(self) -> NDArray[np.object_]:
        """(p,) shapely polygons, valid or not; converted once."""
        if len(self) == 0:
            return np.empty(0, dtype=object)
        first, last = self.ring_offsets[:-1], self.ring_offsets[1:]
        # shapely needs each ring's first vertex repeated at the end.
        closed = np.insert(self.coords, last, self.coords[first], axis=0)
        offsets = self.ring_offsets + np.arange(len(self.ring_offsets))
        kind = shapely.GeometryType.POLYGON
        geometries = shapely.from_ragged_array(kind, closed, (offsets, self.geom_offsets))
        return np.asarray(geometries, dtype=object)

    def rings_of(self, index: int) -> tuple[NDArray[Any], NDArray[np.int64]]:
        """Return polygon `index`: vertices (n, 2), and offsets of the rings in them, (h + 2,)."""
        first, last = self.geom_offsets[index : index + 2].tolist()
        offsets = self.ring_offsets[first : last + 1]
        return self.coords[offsets[0] : offsets[-1]], offsets - offsets[0]

    def bounds(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the lower left and the upper right corner of each polygon's box, (p, 2) each."""
        first = self.vertex_offsets[:-1]
        low, high = (reduce.reduceat(self.coords, first) for reduce in (np.minimum, np.maximum))
        return low, high

    def take(self, selection: ArrayLike) -> PolygonArray:
        """Return the polygons selected by (p,) flags, or by (k,) indices in order."""
        indices = np.asarray(selection)
        indices = np.flatnonzero(indices) if indices.dtype == np.bool_ else indices.astype(np.int64)
        ring_counts, vertex_counts = self.ring_counts[indices], self.vertex_counts[indices]
        rings = concatenate_ranges(self.geom_offsets[indices], ring_counts)
        return PolygonArray(
            self.coords[concatenate_ranges(self.vertex_offsets[indices], vertex_counts)],
            offsets_of(np.diff(self.ring_offsets)[rings]),
            offsets_of(ring_counts),
        )

    def __len__(self) -> int:
        return len(self.geom_offsets) - 1

    @overload
    def __getitem__(self, index: int) -> shapely.Polygon: ...
    @overload
    def __getitem__(self, index: slice) -> PolygonArray: ...
    def __getitem__(self, index: int | slice) -> shapely.Polygon | PolygonArray:
        if isinstance(index, slice):
            return self.take(np.arange(len(self))[index])
        if "geometries" in vars(self):
            return self.geometries[index]
        return polygon_of_rings(*self.rings_of(range(len(self))[index]))

    def __iter__(self) -> Iterator[shapely.Polygon]:
        return iter(self.geometries)

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickle, (self.coords, self.ring_offsets, self.geom_offsets)


_unpickled: PolygonArray | None = None  # a worker receives the same polygons for each triangulator


def _unpickle(*arrays: NDArray[Any]) -> PolygonArray:
    """Return the most recently unpickled array if equal, otherwise a new array."""
    global _unpickled
    before = _unpickled
    if before is None or not (
        before.coords.dtype == arrays[0].dtype
        and np.array_equal(before.coords, arrays[0])
        and np.array_equal(before.ring_offsets, arrays[1])
        and np.array_equal(before.geom_offsets, arrays[2])
    ):
        _unpickled = before = PolygonArray(*arrays)
    return before


def offsets_of(lengths: ArrayLike) -> NDArray[np.int64]:
    """Return the offsets (k + 1,) of k consecutive groups of rows, given their lengths (k,)."""
    return np.concatenate(([0], np.cumsum(lengths, dtype=np.int64)), dtype=np.int64)


def concatenate_ranges(starts: NDArray[np.int64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the concatenated ranges of integers starts[i], ..., starts[i] + lengths[i] - 1."""
    before = offsets_of(lengths)
    return np.arange(before[-1]) + np.repeat(starts - before[:-1], lengths)


def polygon_of_rings(points: NDArray[Any], ring_offsets: NDArray[np.int64]) -> shapely.Polygon:
    """Return the polygon of vertices (n, 2) whose rings begin at `ring_offsets` (h + 2,)."""
    rings = np.split(points, ring_offsets[1:-1])
    # Close rings here: shapely would not close a ring whose last vertex equals the first.
    closed = [np.concatenate((ring, ring[:1])) for ring in rings]
    return shapely.Polygon(closed[0], closed[1:])


@dataclass(frozen=True)
class Triangulations(Sequence[np.ndarray]):
    """Triangulations of p polygons; `[i]` has the triangles of polygon i, (m, 3) int32.

    Attributes
    ----------
    triangles : (M, 3) int32 array
        Polygon by polygon, as indices into the vertices of each polygon.
    triangle_offsets : (p + 1,) int64 array
        Offsets of the polygons in `triangles`.
    failed : dict
        The reason for each polygon without a triangulation, by index.
    compiled : (p,) bool array
        True for polygons triangulated by compiled code or a device, False for those triangulated
        one by one. An optimum by compiled code or a device is exact.
    """

    triangles: np.ndarray
    triangle_offsets: np.ndarray
    failed: dict[int, str] = field(default_factory=dict)
    compiled: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=np.bool_))

    def __len__(self) -> int:
        return len(self.triangle_offsets) - 1

    def __getitem__(self, index: Any) -> Any:
        rows = range(len(self))[index]
        if isinstance(rows, range):
            return [self[row] for row in rows]
        return self.triangles[self.triangle_offsets[rows] : self.triangle_offsets[rows + 1]]


class Batch(NamedTuple):
    """The arrays of a `PolygonArray` with space for triangles, for compiled code."""

    coords: np.ndarray
    ring_offsets: np.ndarray
    geom_offsets: np.ndarray
    vertex_offsets: np.ndarray
    triangle_offsets: np.ndarray  # (p + 1,): offsets of the rows of `triangles` for each polygon
    triangles: np.ndarray  # (m, 3)
    done: np.ndarray  # (p,): True for polygons whose triangles are written


def allocate_batch(polygons: PolygonArray) -> Batch:
    """Return a `Batch` for polygons, with uninitialised triangles; `done` is False for all."""
    max_triangles = polygons.vertex_counts - 2 + 2 * (polygons.ring_counts - 1)
    triangle_offsets = offsets_of(np.maximum(max_triangles, 0))
    return Batch(
        np.ascontiguousarray(polygons.coords, dtype=np.float64),
        np.ascontiguousarray(polygons.ring_offsets, dtype=np.int64),
        np.ascontiguousarray(polygons.geom_offsets, dtype=np.int64),
        polygons.vertex_offsets,
        triangle_offsets,
        np.empty((triangle_offsets[-1], 3), dtype=np.int32),
        np.zeros(len(polygons), dtype=np.bool_),
    )


@njit(nogil=True)
def rings_at(
    index: int, coords: np.ndarray, ring_offsets: np.ndarray, geom_offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return polygon `index`: vertices (n, 2), and offsets of the rings in them, (h + 2,)."""
    offsets = ring_offsets[geom_offsets[index] : geom_offsets[index + 1] + 1]
    return coords[offsets[0] : offsets[-1]], offsets - offsets[0]
