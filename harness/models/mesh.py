"""Triangles of a model as they are drawn together, with all that a vertex carries."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEPS = 4.0
"""Steps of single precision, at the largest coordinate, by which a flat face may be bent."""


HALF = 32
"""Bits for a vertex in the number of an edge."""


@dataclass(frozen=True)
class Mesh:
    """Triangles that one draw shows, over vertices that only they use.

    positions : (n, 3)
    triangles : (m, 3) indices of vertices
    affine : (n, k) what is interpolated across a triangle (texture coordinates, normals, colours,
        displacements), each column in units of what may be off in it
    fixed : (n, j) what has to be one and the same all over a face (joints, identifiers)
    tolerance : by how much a flat face may be bent, in the units of positions
    uses : (n,) how many faces of the file have a corner there, where normals are to be made of
        these; 0 where normals are in the file, None where there is no such vertex
    """

    positions: NDArray[np.float64]
    triangles: NDArray[np.int64]
    affine: NDArray[np.float64]
    fixed: NDArray[np.float64]
    tolerance: float
    uses: NDArray[np.int64] | None = None

    @cached_property
    def normals(self) -> NDArray[np.float64]:
        """Return (m, 3) normals of the triangles, as long as twice their area."""
        sides = np.diff(self.positions[self.triangles], axis=1)
        return np.asarray(np.cross(sides[:, 0], sides[:, 1]))

    def with_triangles(self, triangles: NDArray[np.int64]) -> Mesh:
        """Return others of the same vertices."""
        return replace(self, triangles=triangles)


@dataclass(frozen=True)
class Part:
    """Triangles that one draw shows; other parts may touch them.

    source : what the model needs to find them again
    left : why they stay as they are, "" if they need not
    placements : (4, 4) matrices, one for each place where it is drawn
    """

    mesh: Mesh
    source: Any
    left: str = ""
    placements: tuple[NDArray[np.float64], ...] = (np.eye(4),)


def tolerance_of(values: NDArray[np.float64]) -> float:
    """Return what rounding to single precision explains, in the units of the values, (n, k)."""
    known = np.abs(values[np.isfinite(values)])
    return STEPS * float(np.spacing(np.float32(known.max(initial=0.0))))


def edge_numbers(ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (d,) a number for each edge (d, 2), the same in both directions."""
    one, other = ends.T
    return np.asarray((np.minimum(one, other) << HALF) + np.maximum(one, other))


def sides_of(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (3 m,) the numbers of the sides of triangles (m, 3)."""
    return edge_numbers(np.stack([triangles, triangles[:, [1, 2, 0]]], axis=2).reshape(-1, 2))
