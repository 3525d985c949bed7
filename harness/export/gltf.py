"""glTF 2.0, as .glb or as .gltf with its .bin: one mesh per batch."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.export.mesh import Mesh, with_z
from harness.export.writers import About, append, plain
from harness.stored.atomic import Output

_FLOAT, _UNSIGNED = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_STEPS = 2**24
"""Steps of the grid from a mesh's middle to its edge; single precision holds each of them."""

_UPRIGHT = [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1]
"""Column-major rotation that turns our z axis (up) into glTF's y axis."""


class GltfWriter:
    """Writes batches as meshes; attributes go to each mesh's `extras`, one list per column.

    glTF holds single precision only. So positions are whole numbers on a fine grid around the
    middle of each batch. The node's matrix maps them back; readers hold it in double precision.
    `_FEATURE_ID_0` is the polygon of each vertex,
    counted within its mesh, as in EXT_mesh_features.
    """

    def __init__(self, output: Output, about: About, *, binary: bool) -> None:
        self._output = output
        self._about = about
        self._binary = binary
        self._data = output.spool("data") if binary else output.file(".bin")
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._nodes: list[dict[str, Any]] = []
        self._meshes = output.spool("meshes", "w+")
        self._origin: NDArray[np.float64] | None = None

    def add(self, mesh: Mesh) -> None:
        """Write one more batch."""
        if len(mesh.triangles) == 0:
            return
        vertices = with_z(mesh.vertices)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle = np.round((low + high) / 2) * [1, 1, 0]
        if self._origin is None:
            # large map coordinates would make single-precision viewers shake
            self._origin = middle
        reach = np.abs(vertices - middle).max(axis=0)
        # one step for the plan, so that angles stay, and one for heights; that of the plan where it
        # is flat: single precision cannot invert a matrix with a far smaller one
        plan = max(reach[:2].max(), 1e-30)
        step = np.array([plan, plan, reach[2] or plan]) / _STEPS
        grid = np.rint((vertices - middle) / step)
        feature = mesh.vertex_owners.astype("<f4")
        attributes = {
            "POSITION": self._accessor(grid.astype("<f4"), "VEC3", _FLOAT, _VERTICES, True),
            "_FEATURE_ID_0": self._accessor(feature, "SCALAR", _FLOAT, _VERTICES, False),
        }
        indices = mesh.triangles.astype("<u4").ravel()
        primitive = {
            "attributes": attributes,
            "indices": self._accessor(indices, "SCALAR", _UNSIGNED, _INDICES, False),
        }
        matrix = np.diag([*step, 1.0])
        matrix[:3, 3] = middle - self._origin
        self._nodes.append({"mesh": len(self._nodes), "matrix": matrix.T.ravel().tolist()})
        made: dict[str, Any] = {"primitives": [primitive]}
        if mesh.attributes.shape[1]:
            columns = {str(c): plain(mesh.attributes[c].tolist()) for c in mesh.attributes}
            made["extras"] = {"attributes": columns}
        self._meshes.write(("," if len(self._nodes) > 1 else "") + json.dumps(made))

    def finish(self) -> None:
        """Write the JSON and, for .glb, put the parts together."""
        origin = [0.0, 0.0] if self._origin is None else self._origin[:2].tolist()
        length = self._data.tell()
        buffer: dict[str, Any] = {"byteLength": length}
        if not self._binary:
            buffer["uri"] = self._output.target.name + ".bin"
        children = list(range(1, len(self._nodes) + 1))
        # node 0 rotates the map upright; the nodes of the batches are its children
        document: dict[str, Any] = {
            "asset": {
                "version": "2.0",
                "generator": "raster-harness",
                "copyright": self._about.credit,
                "extras": {
                    "origin": origin,
                    "units": self._about.units,
                    "crs": self._about.crs if self._about.projection is None else None,
                    "triangulator": self._about.triangulator,
                },
            },
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"matrix": _UPRIGHT, **({"children": children} if children else {})}],
        }
        document["nodes"] += self._nodes
        if self._nodes:
            document |= {"buffers": [buffer], "bufferViews": self._views}
            document |= {"accessors": self._accessors}
        if not self._about.credit:
            del document["asset"]["copyright"]
        self._assemble(json.dumps(document, separators=(",", ":")), length)

    def _assemble(self, document: str, length: int) -> None:
        """Splice the spooled meshes into the JSON, and write it before the binary data."""
        self._meshes.seek(0)
        meshes = self._meshes.read()
        text = f'{document[:-1]},"meshes":[{meshes}]}}' if meshes else document
        payload = text.encode()
        stream = self._output.file()
        if not self._binary:
            stream.write(payload)
            return
        payload += b" " * (-len(payload) % 4)
        chunk = length + (8 if length else 0)
        total = 12 + 8 + len(payload) + chunk
        if total >= 2**32:
            raise UsageError(
                f"{self._output.target} would be {total / 2**30:.1f} GiB, and GLB ends at 4 GiB: "
                "write .gltf, or fewer polygons with limit"
            )
        stream.write(struct.pack("<4sII", b"glTF", 2, total))
        stream.write(struct.pack("<I4s", len(payload), b"JSON") + payload)
        if length:
            stream.write(struct.pack("<I4s", length, b"BIN\0"))
            append(stream, self._data)

    def _accessor(
        self, values: NDArray[Any], shape: str, kind: int, target: int, bounded: bool
    ) -> int:
        offset = self._data.tell()
        data = values.tobytes()
        self._data.write(data)
        self._views.append(
            {"buffer": 0, "byteOffset": offset, "byteLength": len(data), "target": target}
        )
        accessor: dict[str, Any] = {
            "bufferView": len(self._views) - 1,
            "componentType": kind,
            "count": len(values),
            "type": shape,
        }
        if bounded:  # glTF requires the bounds of positions
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self._accessors.append(accessor)
        return len(self._accessors) - 1
