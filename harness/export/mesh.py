"""A batch of triangulated polygons as one indexed mesh, flat or extruded."""

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from triangulators.batch import Triangulations
from triangulators.polygon_arrays import PolygonArray, offsets_of

_NUMBER = re.compile(r"\s*([-+]?\d*[.,]?\d+(?:[eE][-+]?\d+)?)")


@dataclass(frozen=True)
class Mesh:
    """Triangles of a batch of polygons.

    vertices : (n, 2) or (n, 3) float64; triangles : (m, 3) int64 indices into them;
    vertex_offsets, triangle_offsets : (p + 1,), where each polygon's begin;
    attributes : one row per polygon (no columns if the source has no attributes).
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    vertex_offsets: NDArray[np.int64]
    triangle_offsets: NDArray[np.int64]
    attributes: pd.DataFrame

    @property
    def polygons(self) -> int:
        """How many polygons the mesh holds."""
        return len(self.vertex_offsets) - 1

    @property
    def triangle_owners(self) -> NDArray[np.int64]:
        """(m,), the polygon of each triangle."""
        return np.repeat(np.arange(self.polygons), np.diff(self.triangle_offsets))

    @property
    def vertex_owners(self) -> NDArray[np.int64]:
        """(n,), the polygon of each vertex."""
        return np.repeat(np.arange(self.polygons), np.diff(self.vertex_offsets))


def with_z(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) coordinates; flat ones lie at z = 0."""
    if vertices.shape[1] == 3:
        return vertices
    return np.column_stack([vertices, np.zeros(len(vertices))])


def flat(polygons: PolygonArray, done: Triangulations, attributes: pd.DataFrame | None) -> Mesh:
    """The mesh of a batch of polygons; those that failed have vertices but no triangles."""
    shift = np.repeat(polygons.vertex_offsets[:-1], np.diff(done.triangle_offsets))
    table = pd.DataFrame(index=range(len(done))) if attributes is None else attributes
    return Mesh(
        np.ascontiguousarray(polygons.coords, dtype=np.float64),
        done.triangles.astype(np.int64) + shift[:, None],
        polygons.vertex_offsets,
        np.asarray(done.triangle_offsets, dtype=np.int64),
        table.reset_index(drop=True),
    )


def heights(attributes: pd.DataFrame, source: str | float) -> tuple[NDArray[np.float64], int]:
    """(p,) heights by a number or an attribute, and how many rows have no usable one.

    Text such as "12.5 m" counts as 12.5; what is missing, negative or no number counts as 0.
    Raises KeyError if there is no such attribute.
    """
    if not isinstance(source, str):
        return np.full(len(attributes), float(source)), 0
    column = attributes[source]
    if not pd.api.types.is_numeric_dtype(column):
        column = column.map(_leading_number)
    values = column.to_numpy(dtype=float, na_value=np.nan)
    usable = np.isfinite(values) & (values >= 0)
    return np.where(usable, values, 0.0), int((~usable).sum())


def _leading_number(value: Any) -> float:
    match = _NUMBER.match(str(value))
    return float(match[1].replace(",", ".")) if match else np.nan


def extruded(mesh: Mesh, ring_offsets: NDArray[np.int64], tops: NDArray[np.float64]) -> Mesh:
    """Prisms from z = 0 to each polygon's height: closed, with normals outwards.

    A polygon of height 0 stays flat, one layer of triangles at z = 0.
    """
    if not tops.any():
        return replace(mesh, vertices=with_z(mesh.vertices))
    n = len(mesh.vertices)
    z = tops[mesh.vertex_owners]
    floor, roof = with_z(mesh.vertices), np.column_stack([mesh.vertices, z])
    solid = tops > 0
    triangles, owners = mesh.triangles, mesh.triangle_owners
    below = solid[owners]
    walls, wall_owners = _walls(mesh, ring_offsets, n)
    # a polygon that could not be triangulated gets no walls either
    whole = (solid & (np.diff(mesh.triangle_offsets) > 0))[wall_owners]
    every = np.concatenate([triangles + n, triangles[below][:, ::-1], walls[whole]])
    owner = np.concatenate([owners, owners[below], wall_owners[whole]])
    order = np.argsort(owner, kind="stable")
    # vertices are ordered by polygon, too: its floor, then its roof
    place = np.argsort(np.r_[mesh.vertex_owners, mesh.vertex_owners], kind="stable")
    moved = np.empty_like(place)
    moved[place] = np.arange(2 * n)
    counts = np.bincount(owner, minlength=mesh.polygons)
    return Mesh(
        np.concatenate([floor, roof])[place],
        moved[every[order]],
        2 * mesh.vertex_offsets,
        offsets_of(counts),
        mesh.attributes,
    )


def _walls(
    mesh: Mesh, ring_offsets: NDArray[np.int64], n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Two triangles for each edge, floor vertex i to roof vertex n + i, and their polygons.

    Rings have the polygon on their left, so these face outwards.
    """
    a = np.arange(n)
    b = a + 1
    b[ring_offsets[1:] - 1] = ring_offsets[:-1]
    walls = np.stack([np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n])], axis=1)
    return walls.reshape(-1, 3), np.repeat(mesh.vertex_owners, 2)


def without(mesh: Mesh, gone: NDArray[np.bool_]) -> Mesh:
    """The mesh without some polygons, (p,) flags, their vertices and their attributes."""
    keep_vertex = ~gone[mesh.vertex_owners]
    renumbered = np.cumsum(keep_vertex) - 1
    keep_triangle = ~gone[mesh.triangle_owners]
    return Mesh(
        mesh.vertices[keep_vertex],
        renumbered[mesh.triangles[keep_triangle]],
        offsets_of(np.diff(mesh.vertex_offsets)[~gone]),
        offsets_of(np.diff(mesh.triangle_offsets)[~gone]),
        mesh.attributes[~gone].reset_index(drop=True),
    )
