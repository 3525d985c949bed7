"""Binary PLY and STL."""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from harness.export.indexed_mesh import Mesh, with_z
from harness.export.writer import About, AttributeTable, append
from harness.stored.output import Output

_PLY_FACE = np.dtype([("count", "u1"), ("indices", "<i4", 3), ("feature", "<i4")])
_STL_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])


class PlyWriter:
    """Double-precision vertices; each face has its polygon's number as property `feature`.

    Attributes go to a CSV file beside.
    """

    def __init__(self, output: Output, about: About) -> None:
        self._output = output
        self._about = about
        self._vertices, self._faces = output.spool("vertices"), output.spool("faces")
        self._table = AttributeTable(output)
        self._counts = np.zeros(3, np.int64)  # vertices, faces, features

    def add(self, mesh: Mesh) -> None:
        """Write one more batch."""
        vertices, _, features = self._counts
        self._vertices.write(with_z(mesh.vertices).astype("<f8").tobytes())
        records = np.empty(len(mesh.triangles), _PLY_FACE)
        records["count"] = 3
        records["indices"] = mesh.triangles + vertices
        records["feature"] = mesh.triangle_owners + features
        self._faces.write(records.tobytes())
        self._table.add(mesh.attributes)
        self._counts += np.array([len(mesh.vertices), len(mesh.triangles), mesh.polygons])

    def finish(self) -> None:
        """Write the header, which needs the counts, and the spooled parts after it."""
        credit = f"comment {self._about.credit}\n" if self._about.credit else ""
        header = (
            "ply\nformat binary_little_endian 1.0\n"
            f"comment raster-harness, {self._about.triangulator}, units: {self._about.units}\n"
            f"{credit}element vertex {self._counts[0]}\n"
            "property double x\nproperty double y\nproperty double z\n"
            f"element face {self._counts[1]}\n"
            "property list uchar int vertex_indices\nproperty int feature\nend_header\n"
        )
        stream = self._output.file()
        stream.write(header.encode("ascii", "replace"))
        append(stream, self._vertices)
        append(stream, self._faces)


class StlWriter:
    """Binary STL, single precision around the first batch's middle, which the header names.

    Attributes go to a CSV file beside it. STL cannot say which polygon a triangle belongs to.
    """

    def __init__(self, output: Output, about: About) -> None:  # noqa: ARG002 - STL has no room
        self._stream = output.file()
        self._stream.write(bytes(84))
        self._table = AttributeTable(output)
        self._count = 0
        self._origin: NDArray[np.float64] | None = None

    def add(self, mesh: Mesh) -> None:
        """Write one more batch."""
        if self._origin is None and len(mesh.vertices):
            low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
            self._origin = np.round((low + high)[:2] / 2)
        corners = mesh.corners()
        if self._origin is not None:
            corners = corners - [*self._origin, 0.0]
        records = np.zeros(len(corners), _STL_FACE)
        records["corners"] = corners
        records["normal"] = _normals(corners)
        self._stream.write(records.tobytes())
        self._table.add(mesh.attributes)
        self._count += len(records)

    def finish(self) -> None:
        """Put the origin and the count into the header."""
        x, y = (0.0, 0.0) if self._origin is None else self._origin
        self._stream.seek(0)
        # readers take a file that begins with "solid" for text
        text = f"raster-harness, origin {x:.17g} {y:.17g}".encode()[:80]
        self._stream.write(text.ljust(80) + struct.pack("<I", self._count))


def _normals(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m, 3) unit normals of (m, 3, 3) corners; zero where a triangle has no area."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
