"""A batch of triangulated polygons as one indexed mesh."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from triangulators.batch import Triangulations
from triangulators.polygon_arrays import PolygonArray, offsets_of


@dataclass(frozen=True)
class ExportMesh:
    """Triangles of a batch of polygons.

    vertices : (n, 2) float64; triangles : (m, 3) int64 indices into them;
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
        """Number of polygons."""
        return len(self.vertex_offsets) - 1

    @property
    def triangle_owners(self) -> NDArray[np.int64]:
        """(m,), the polygon of each triangle."""
        return np.repeat(np.arange(self.polygons), np.diff(self.triangle_offsets))

    @property
    def vertex_owners(self) -> NDArray[np.int64]:
        """(n,), the polygon of each vertex."""
        return np.repeat(np.arange(self.polygons), np.diff(self.vertex_offsets))


def mesh_of(
    polygons: PolygonArray, done: Triangulations, attributes: pd.DataFrame | None
) -> ExportMesh:
    """Return the mesh of a batch of polygons; failed ones have vertices but no triangles."""
    shift = np.repeat(polygons.vertex_offsets[:-1], np.diff(done.triangle_offsets))
    table = pd.DataFrame(index=range(len(done))) if attributes is None else attributes
    return ExportMesh(
        np.ascontiguousarray(polygons.coords, dtype=np.float64),
        done.triangles.astype(np.int64) + shift[:, None],
        polygons.vertex_offsets,
        np.asarray(done.triangle_offsets, dtype=np.int64),
        table.reset_index(drop=True),
    )


def without(mesh: ExportMesh, gone: NDArray[np.bool_]) -> ExportMesh:
    """Return the mesh without the polygons flagged in `gone` (p,)."""
    keep_vertex = ~gone[mesh.vertex_owners]
    renumbered = np.cumsum(keep_vertex) - 1
    keep_triangle = ~gone[mesh.triangle_owners]
    return ExportMesh(
        mesh.vertices[keep_vertex],
        renumbered[mesh.triangles[keep_triangle]],
        offsets_of(np.diff(mesh.vertex_offsets)[~gone]),
        offsets_of(np.diff(mesh.triangle_offsets)[~gone]),
        mesh.attributes[~gone].reset_index(drop=True),
    )
