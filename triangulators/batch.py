"""Triangulations of many polygons, and the arrays that compiled code fills with them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.polygon_arrays import PolygonArray, offsets_of


@dataclass(frozen=True)
class Triangulations(Sequence[np.ndarray]):
    """Triangulations of p polygons; `[i]` is that of polygon i, (m, 3) int32.

    Attributes
    ----------
    triangles : (M, 3) int32 array
        polygon by polygon, as indices into the vertices of each polygon
    triangle_offsets : (p + 1,) int64 array
        where in `triangles` those of each polygon begin, and the end
    failed : dict
        for each polygon without a triangulation the reason
    compiled : (p,) bool array
        polygons triangulated by compiled code or a device; an optimum is exact there
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
    """The arrays of a `PolygonArray` with room for triangles, for compiled code.

    vertex_offsets (p + 1,): see there; triangle_offsets (p + 1,): rows of `triangles` (m, 3) in
    which there is room for each polygon's; done (p,): polygons whose triangles are written.
    """

    coords: np.ndarray
    ring_offsets: np.ndarray
    geom_offsets: np.ndarray
    vertex_offsets: np.ndarray
    triangle_offsets: np.ndarray
    triangles: np.ndarray
    done: np.ndarray


def allocate_batch(polygons: PolygonArray) -> Batch:
    """Return polygons with room for the triangles of each; none is done.

    A triangulation of n vertices and h holes has at most n + 2 h - 2 triangles.
    """
    room = polygons.vertex_counts - 2 + 2 * (polygons.ring_counts - 1)
    triangle_offsets = offsets_of(np.maximum(room, 0))
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
    """Return the vertices (n, 2) of one polygon, and where in them each ring begins, (h + 2,)."""
    offsets = ring_offsets[geom_offsets[index] : geom_offsets[index + 1] + 1]
    return coords[offsets[0] : offsets[-1]], offsets - offsets[0]
