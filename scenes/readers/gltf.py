"""Reader of glTF 2.0 files (.glb, .gltf): buffers, accessors, and the triangles of their meshes.

Source: Khronos, "glTF 2.0 Specification", sections 3.6 (buffers, accessors), 3.7.2 (meshes), 4.4
(GLB); the draft EXT_mesh_polygon is KhronosGroup/glTF pull request 2570.
"""

import base64
import json
import re
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from scenes.readers.guard import refuse_special
from scenes.scene import SceneError

# Modes of a primitive: rings (with EXT_mesh_polygon), and three layouts of triangles.
LINE_LOOP, TRIANGLES, STRIP, FAN = 2, 4, 5, 6
POLYGONS = "EXT_mesh_polygon"
RESTART = 2**32 - 1  # index that separates the rings of a polygon, if indices have 32 bits
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Number of components of an accessor's element, by type."""

# The stored integer that stands for 1.0 if an accessor is normalized, by component type.
FULL_SCALE = {"i1": 127.0, "u1": 255.0, "i2": 32767.0, "u2": 65535.0}
MAGIC, JSON, BIN = b"glTF", b"JSON", b"BIN\0"
DATA_URI = "base64,"  # text before the content of a data URI
# Extensions with compressed vertices and triangles.
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
_INSTANCING = "EXT_mesh_gpu_instancing"

HARMLESS = re.compile(
    rf"^(KHR_mesh_(quantization|primitive_restart)|{_INSTANCING}|{POLYGONS})$|material|texture|light"
)
"""Extensions that this module reads, or that do not affect triangles."""


class GltfFile:
    """A model in memory: JSON, and the bytes of the buffers.

    A file that violates the format may raise any exception: call within `raise_scene_errors`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._text = self._read_chunks(path.read_bytes())
        self.json: dict[str, Any] = json.loads(self._text)
        used = self.json.get("extensionsUsed", [])
        compressed = [name for name in COMPRESSED if name in used]
        if compressed:
            raise SceneError(
                f"{path}: {compressed[0]} is unsupported; unpack the model first, for example by "
                "`gltf-transform copy`"
            )
        required = [n for n in self.json.get("extensionsRequired", []) if not HARMLESS.search(n)]
        if required:
            raise SceneError(
                f"{path}: requires the extension {required[0]}, which is unsupported; export the "
                "model without it"
            )
        self.buffers = [self._read_buffer(buffer) for buffer in self.json.get("buffers", [])]

    def _read_chunks(self, data: bytes) -> bytes:
        """Return the JSON of a .gltf or .glb file; store the chunks of a .glb in `self._chunks`."""
        self._chunks: list[tuple[bytes, bytes]] = []
        if data[:4] != MAGIC:
            return data
        version, length = struct.unpack_from("<II", data, 4)
        if version != 2 or length > len(data):  # bytes after the model are ignored
            raise ValueError(f"GLB version {version} (not 2), or {len(data):,} of {length:,} bytes")
        start = 12
        while start < length:
            size, kind = struct.unpack_from("<I4s", data, start)
            if start + 8 + size > length:
                raise ValueError("a chunk is truncated")
            self._chunks.append((kind, data[start + 8 : start + 8 + size]))
            start += 8 + size
        if not self._chunks or self._chunks[0][0] != JSON:
            raise ValueError("the first chunk is not JSON")
        return self._chunks[0][1]

    def _read_buffer(self, buffer: dict[str, Any]) -> bytearray:
        uri = buffer.get("uri")
        if uri is None:
            data = next((content for kind, content in self._chunks if kind == BIN), None)
            if data is None:
                raise ValueError("a buffer has neither a URI nor a binary chunk")
        elif uri.startswith("data:"):
            data = base64.b64decode(uri.partition(DATA_URI)[2], validate=True)
        else:
            data = self._resolve_uri(uri).read_bytes()
        if len(data) < buffer["byteLength"]:
            raise ValueError(f"a buffer has {len(data):,} of {buffer['byteLength']:,} bytes")
        return bytearray(data)

    def _resolve_uri(self, uri: str) -> Path:
        """Return the file of a relative URI; raises SceneError if outside the model's folder."""
        file = self.path.parent / unquote(uri)
        if not file.resolve().is_relative_to(self.path.parent.resolve()):
            raise SceneError(
                f"{self.path} needs {uri}, which is outside the model's folder: copy it there"
            )
        refuse_special(file)
        if not file.is_file():
            raise SceneError(
                f"{self.path} needs {uri}, which was not found: copy it to the model's folder"
            )
        return file

    def read_array(self, accessor: int) -> NDArray[Any]:
        """Return the stored values (n, width) of an accessor, given its index."""
        description = self.json["accessors"][check_index(accessor)]
        kind, width = find_component_type(description), WIDTHS[description["type"]]
        if "bufferView" in description:
            values = self._read_view(description, kind, width, description["count"]).copy()
        else:
            values = np.zeros((description["count"], width), kind)
        if "sparse" in description:
            sparse = description["sparse"]
            indices = sparse["indices"]
            rows = self._read_view(indices, find_component_type(indices), 1, sparse["count"])
            values[rows[:, 0]] = self._read_view(sparse["values"], kind, width, sparse["count"])
        return values

    def read_values(self, accessor: int) -> tuple[NDArray[Any], bool]:
        """Return the stored values (n, width) of an accessor, and whether these are normalized."""
        description = self.json["accessors"][check_index(accessor)]
        return self.read_array(accessor), bool(description.get("normalized"))

    def _read_view(
        self, description: dict[str, Any], kind: np.dtype[Any], width: int, count: int
    ) -> NDArray[Any]:
        """Return elements (count, width) of the buffer view of an accessor or of a part of one."""
        view = self.json["bufferViews"][check_index(description["bufferView"])]
        first = view.get("byteOffset", 0) + description.get("byteOffset", 0)
        stride = view.get("byteStride", kind.itemsize * width)
        last = first + (count - 1) * stride + kind.itemsize * width
        if min(count, first, stride) < 0 or last > view.get("byteOffset", 0) + view["byteLength"]:
            raise ValueError("an accessor reaches beyond its buffer view")
        buffer = self.buffers[check_index(view["buffer"])]
        return np.ndarray((count, width), kind, buffer, first, (stride, kind.itemsize))

    def read_positions(
        self, primitive: dict[str, Any], placements: tuple[NDArray[np.float64], ...]
    ) -> tuple[NDArray[Any], tuple[NDArray[np.float64], ...]]:
        """Return a primitive's stored positions (n, 3), and the matrices (4, 4) of its placements.

        Normalized integers are returned as integers, with the scale factor in the returned
        matrices.
        """
        positions, normalized = self.read_values(primitive["attributes"]["POSITION"])
        if positions.shape[1] != 3:
            raise ValueError(f"POSITION has {positions.shape[1]} numbers per vertex, not 3")
        if normalized:
            if positions.dtype.kind == "i":  # the lowest integer and its successor stand for -1.0
                positions = np.maximum(positions, -np.iinfo(positions.dtype).max)
            units = np.diag([*3 * [1.0 / FULL_SCALE[positions.dtype.str[1:]]], 1.0])
            placements = tuple(matrix @ units for matrix in placements)
        return positions, placements

    def read_triangles(self, primitive: dict[str, Any], count: int) -> NDArray[np.int64]:
        """Return a primitive's triangles (m, 3), given the number of its vertices."""
        if "indices" in primitive:
            vertex = self.read_array(primitive["indices"])[:, 0].astype(np.int64)
        else:
            vertex = np.arange(count)
        if len(vertex) and not 0 <= vertex.min() <= vertex.max() < count:
            raise ValueError(
                f"vertex indices {vertex.min():,} to {vertex.max():,} are out of range: "
                f"the primitive has {count:,} vertices"
            )
        mode = primitive.get("mode", TRIANGLES)
        if mode == TRIANGLES:
            if len(vertex) % 3:
                raise ValueError(f"{len(vertex):,} indices are not a multiple of 3")
            return vertex.reshape(-1, 3)
        if mode == FAN:
            hub = np.full(max(len(vertex) - 2, 0), vertex[0] if len(vertex) else 0)
            return np.stack([vertex[1:-1], vertex[2:], hub], axis=1)
        odd = np.arange(max(len(vertex) - 2, 0)) % 2
        strip = np.stack([vertex[:-2], vertex[1:-1], vertex[2:]], axis=1)
        strip[odd == 1] = strip[odd == 1][:, [0, 2, 1]]
        return strip

    def read_loops(self, primitive: dict[str, Any], count: int) -> list[list[NDArray[np.int64]]]:
        """Return the rings of each polygon of a primitive by EXT_mesh_polygon, the exterior first.

        By version of the draft, rings are in the primitive (mode LINE_LOOP), or in the extension.
        """
        extension = primitive["extensions"][POLYGONS]
        if primitive.get("mode", TRIANGLES) == LINE_LOOP:
            names = (primitive["indices"], extension["indicesOffsets"])
        else:
            names = (extension["loopIndices"], extension["loopIndicesOffsets"])
        stored, offsets = (self.read_array(name)[:, 0] for name in names)
        if stored.dtype.kind != "u" or offsets.dtype.kind != "u":
            raise ValueError("indices of polygons are not unsigned integers")
        restart = np.iinfo(stored.dtype).max
        bounds = [*offsets.tolist(), len(stored)]
        if len(offsets) != extension["count"] or bounds != sorted(set(bounds)) or bounds[0] != 0:
            raise ValueError(f"the offsets of {len(offsets):,} polygons do not increase from 0")
        polygons = []
        for polygon in np.split(stored, bounds[1:-1]):
            rings = np.split(polygon, np.flatnonzero(polygon == restart))
            rings = [ring[ring != restart].astype(np.int64) for ring in rings]
            polygons.append([ring for ring in rings if len(ring)])
            if not polygons[-1] or max(map(np.max, polygons[-1])) >= count:
                raise ValueError(f"a polygon has no ring, or an index beyond {count:,} vertices")
        return polygons

    def list_placements(self) -> list[tuple[NDArray[np.float64], ...]]:
        """Return, for each mesh, the matrices (4, 4) with which the default scene places it."""
        count = len(self.json.get("meshes", []))
        scenes = self.json.get("scenes")
        if not scenes:
            return [(np.eye(4),)] * count
        nodes = self.json.get("nodes", [])
        placements: list[tuple[NDArray[np.float64], ...]] = [()] * count
        roots = scenes[check_index(self.json.get("scene", 0))].get("nodes", [])
        stack = [(number, np.eye(4)) for number in roots]
        for _ in range(len(nodes)):  # in a tree each node is visited once
            if not stack:
                break
            number, parent = stack.pop()
            node = nodes[check_index(number)]
            matrix = parent @ _read_node_matrix(node)
            if "mesh" in node:
                placements[check_index(node["mesh"])] += self._list_instances(node, matrix)
            stack += [(child, matrix) for child in node.get("children", [])]
        if stack:
            raise ValueError("the nodes are not a tree: a node is in itself or has two parents")
        return placements

    def _list_instances(
        self, node: dict[str, Any], matrix: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], ...]:
        """Return the matrix of each instance of a node's mesh; without instancing, `matrix`."""
        instancing = node.get("extensions", {}).get(_INSTANCING)
        if instancing is None:
            return (matrix,)
        columns = {}
        for name in ("TRANSLATION", "ROTATION", "SCALE"):
            if name in instancing["attributes"]:
                stored, normalized = self.read_values(instancing["attributes"][name])
                scale = FULL_SCALE[stored.dtype.str[1:]] if normalized else 1.0
                columns[name.lower()] = np.maximum(stored / scale, -1.0 if normalized else -np.inf)
        rows = zip(*columns.values(), strict=False)
        nodes = (dict(zip(columns, values, strict=True)) for values in rows)
        return tuple(matrix @ _read_node_matrix(instance) for instance in nodes)


def check_index(number: Any) -> int:
    """Return a number that is an index; raises ValueError otherwise, also for negative numbers."""
    if not isinstance(number, int) or isinstance(number, bool) or number < 0:
        raise ValueError(f"{number!r} is not an index")
    return number


def find_component_type(description: dict[str, Any]) -> np.dtype[Any]:
    """Return the NumPy type of an accessor's stored numbers; raises ValueError if unknown."""
    if description["componentType"] not in _TYPES:
        raise ValueError(f"component type {description['componentType']} is unknown")
    return np.dtype(_TYPES[description["componentType"]])


def _read_node_matrix(node: dict[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    from scipy.spatial.transform import Rotation  # slow to import, and rarely needed

    rotation = Rotation.from_quat(node.get("rotation", (0, 0, 0, 1))).as_matrix()
    result = np.eye(4)
    result[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    result[:3, 3] = node.get("translation", (0, 0, 0))
    return result


def _place_vertices(stored: NDArray[Any], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return positions (n, 3), with y up as in glTF, at a placement, with z up."""
    x, y, z = (stored @ matrix[:3, :3].T + matrix[:3, 3]).T
    return np.column_stack((x, -z, y))


def read_polygons(model: GltfFile) -> list[list[NDArray[np.float64]]] | None:
    """Return the rings (k, 3), z up, of each polygon; None unless all primitives are polygons."""
    primitives = [p for mesh in model.json.get("meshes", []) for p in mesh["primitives"]]
    if not primitives or not all(POLYGONS in p.get("extensions", {}) for p in primitives):
        return None
    polygons = []
    for mesh, placements in zip(model.json["meshes"], model.list_placements(), strict=True):
        for primitive in mesh["primitives"]:
            stored, matrices = model.read_positions(primitive, placements)
            loops = model.read_loops(primitive, len(stored))
            for matrix in matrices:
                vertices = _place_vertices(stored, matrix)
                polygons += [[vertices[ring] for ring in rings] for rings in loops]
    return polygons


def read_triangles(model: GltfFile) -> tuple[NDArray[np.float64], NDArray[np.int64], int]:
    """Return vertices (n, 3), z up, triangles (m, 3), and the number of skipped primitives."""
    vertices: list[NDArray[np.float64]] = [np.empty((0, 3))]
    triangles: list[NDArray[np.int64]] = [np.empty((0, 3), np.int64)]
    count = skipped = 0
    for mesh, placements in zip(model.json.get("meshes", []), model.list_placements(), strict=True):
        for primitive in mesh["primitives"]:
            mode = primitive.get("mode", TRIANGLES)
            if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in primitive["attributes"]:
                skipped += 1
                continue
            stored, matrices = model.read_positions(primitive, placements)
            local = model.read_triangles(primitive, len(stored))
            for matrix in matrices:
                vertices.append(_place_vertices(stored, matrix))
                triangles.append(local + count)
                count += len(stored)
    return np.concatenate(vertices), np.concatenate(triangles), skipped
