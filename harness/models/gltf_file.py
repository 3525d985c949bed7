"""A glTF 2.0 file (.glb, .gltf) whose indices can be replaced, and nothing else changes.

Bytes of indices are overwritten where they lie if nothing else reads them. Otherwise new ones are
put behind the buffer, and the primitive refers to these.

Source: Khronos, "glTF 2.0 Specification", sections 3.6 (buffers, accessors), 3.7.2 (meshes), 4.4
(GLB).
"""

import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.stored.atomic import Output
from scenes.scene import SceneError

TRIANGLES, STRIP, FAN = 4, 5, 6
"""Modes of a primitive, of those that have triangles."""

ELEMENT_ARRAY_BUFFER = 34963
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_SPARSE = ("indices", "values")
_MAGIC, _JSON, _BIN = b"glTF", b"JSON", b"BIN\0"
_DATA = "base64,"

PACKED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
"""Extensions that hold vertices and triangles in a stream of their own."""


class GltfFile:
    """A model in memory: its JSON, and the bytes of its buffers.

    Raises SceneError for a file that holds its triangles packed, and whatever it meets in one that
    is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._text = self._read(path.read_bytes())
        self.json: dict[str, Any] = json.loads(self._text)
        used = self.json.get("extensionsUsed", [])
        packed = [name for name in PACKED if name in used]
        if packed:
            raise SceneError(
                f"{path}: {packed[0]} packs its triangles; unpack it first, for instance by "
                "`gltf-transform copy`"
            )
        self.buffers = [self._buffer(each) for each in self.json.get("buffers", [])]
        self._images = [each["uri"] for each in self.json.get("images", []) if "uri" in each]
        self._grown: set[int] = set()
        self._changed: set[int] = set()

    def _read(self, data: bytes) -> bytes:
        """Split a .glb into its chunks; returns the JSON."""
        self._chunks: list[tuple[bytes, bytes]] = []
        if data[:4] != _MAGIC:
            return data
        version, length = struct.unpack_from("<II", data, 4)
        if version != 2 or length != len(data):
            raise ValueError(f"version {version}, {len(data):,} of {length:,} bytes")
        place = 12
        while place < length:
            size, kind = struct.unpack_from("<I4s", data, place)
            if place + 8 + size > length:
                raise ValueError("a chunk is cut off")
            self._chunks.append((kind, data[place + 8 : place + 8 + size]))
            place += 8 + size
        if not self._chunks or self._chunks[0][0] != _JSON:
            raise ValueError("its first chunk is not JSON")
        return self._chunks[0][1]

    def _buffer(self, buffer: dict[str, Any]) -> bytearray:
        uri = buffer.get("uri")
        if uri is None:
            data = next(content for kind, content in self._chunks if kind == _BIN)
        elif uri.startswith("data:"):
            data = base64.b64decode(uri.partition(_DATA)[2], validate=True)
        else:
            data = self._beside(uri).read_bytes()
        if len(data) < buffer["byteLength"]:
            raise ValueError(f"a buffer has {len(data):,} of {buffer['byteLength']:,} bytes")
        return bytearray(data)

    def _beside(self, uri: str) -> Path:
        place = self.path.parent / unquote(uri)
        if not place.resolve().is_relative_to(self.path.parent.resolve()):
            raise SceneError(
                f"{self.path} names {uri}, which is not below its folder: copy it there"
            )
        if not place.is_file():
            raise SceneError(f"{self.path} needs {uri}, which is not there")
        return place

    def array(self, accessor: int) -> NDArray[Any]:
        """Return an accessor's values (n, width), of the type in which they are stored."""
        about = self.json["accessors"][index(accessor)]
        kind, width = _kind(about), _WIDTHS[about["type"]]
        if "bufferView" in about:
            values = self._view(about, kind, width, about["count"]).copy()
        else:
            values = np.zeros((about["count"], width), kind)
        if "sparse" in about:
            sparse = about["sparse"]
            at = sparse["indices"]
            places = self._view(at, _kind(at), 1, sparse["count"])
            values[places[:, 0]] = self._view(sparse["values"], kind, width, sparse["count"])
        return values

    def _view(
        self, about: dict[str, Any], kind: np.dtype[Any], width: int, count: int
    ) -> NDArray[Any]:
        view = self.json["bufferViews"][index(about["bufferView"])]
        first = view.get("byteOffset", 0) + about.get("byteOffset", 0)
        stride = view.get("byteStride", kind.itemsize * width)
        last = first + (count - 1) * stride + kind.itemsize * width
        if min(count, first, stride) < 0 or last > view.get("byteOffset", 0) + view["byteLength"]:
            raise ValueError("an accessor reaches beyond its buffer view")
        buffer = self.buffers[index(view["buffer"])]
        return np.ndarray((count, width), kind, buffer, first, (stride, kind.itemsize))

    def refer(self, primitives: list[dict[str, Any]], indices: NDArray[np.int64]) -> None:
        """Let primitives, which have one accessor of indices, draw triangles by others, (k,)."""
        number = primitives[0].get("indices")
        # a strip or fan may be of vertices in their order
        about = {"componentType": 5125 if int(indices.max()) > 0xFFFE else 5123}
        if number is not None:
            about = self.json["accessors"][number]
            every = [each for mesh in self.json["meshes"] for each in mesh["primitives"]]
            using = sum(1 for each in every if each.get("indices") == number)
            if (
                about["count"] == len(indices)
                and "sparse" not in about
                and primitives[0].get("mode", TRIANGLES) == TRIANGLES
                and using == len(primitives)
                and self._alone(number)
            ):
                self._view(about, _kind(about), 1, len(indices))[:, 0] = indices
                self._changed.add(self.json["bufferViews"][about["bufferView"]]["buffer"])
                return
        number = self._append(indices, about)
        for primitive in primitives:
            primitive["indices"] = number
            if primitive.get("mode", TRIANGLES) != TRIANGLES:
                primitive["mode"] = TRIANGLES

    def _alone(self, accessor: int) -> bool:
        """Whether nothing but this accessor reads the bytes of its values."""
        accessors, views = self.json["accessors"], self.json["bufferViews"]
        own = accessors[accessor]["bufferView"]
        first, last = self._span(accessors[accessor])
        sparse = [
            each["sparse"][part] for each in accessors if "sparse" in each for part in _SPARSE
        ]
        if any(each.get("bufferView") == own for each in (*self.json.get("images", []), *sparse)):
            return False
        spans = [
            self._span(each)
            for number, each in enumerate(accessors)
            if number != accessor and each.get("bufferView") == own
        ] + [
            (view.get("byteOffset", 0), view.get("byteOffset", 0) + view["byteLength"])
            for number, view in enumerate(views)
            if number != own and view["buffer"] == views[own]["buffer"]
        ]
        return all(end <= first or begin >= last for begin, end in spans)

    def _span(self, accessor: dict[str, Any]) -> tuple[int, int]:
        """Return where in its buffer an accessor's values begin and end."""
        view = self.json["bufferViews"][accessor["bufferView"]]
        size = _kind(accessor).itemsize * _WIDTHS[accessor["type"]]
        first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return first, first + (accessor["count"] - 1) * view.get("byteStride", size) + size

    def _append(self, indices: NDArray[np.int64], like: dict[str, Any]) -> int:
        """Put indices behind the first buffer; returns their accessor."""
        packed = indices.astype(_kind(like)).tobytes()
        buffer, views = self.buffers[0], self.json["bufferViews"]
        accessors = self.json["accessors"]
        buffer += b"\0" * (-len(buffer) % 4)
        place = {"buffer": 0, "byteOffset": len(buffer), "byteLength": len(packed)}
        buffer += packed
        self.json["buffers"][0]["byteLength"] = len(buffer)
        views.append(place | {"target": ELEMENT_ARRAY_BUFFER})
        about = {"bufferView": len(views) - 1, "componentType": like["componentType"]}
        accessors.append(about | {"count": len(indices), "type": "SCALAR"})
        self._changed.add(0)
        self._grown.add(0)
        return len(accessors) - 1

    def write(self, out: Path) -> list[Path]:
        """Write the model, as .glb or .gltf like the one that was read; returns the files."""
        binary = bool(self._chunks)
        self._require_beside(out)
        with Output(out) as output:
            beside = self._place_buffers(out, output)
            text = self._text
            if self._grown or beside:
                text = self._json_text()
            with output.file() as file:
                file.write(self._packed(text) if binary else text)
            return output.publish()

    def _json_text(self) -> bytes:
        """Write the JSON anew; half of a surrogate pair, which UTF-8 cannot write, is escaped."""
        try:
            return json.dumps(self.json, allow_nan=False, separators=(",", ":")).encode()
        except ValueError as error:
            raise SceneError(
                f"{self.path}: a number in its JSON is none, or too large for double precision: "
                "correct it first"
            ) from error

    def _require_beside(self, out: Path) -> None:
        """Refuse a folder in which files that the output names are not."""
        if out.parent.resolve() == self.path.parent.resolve():
            return
        buffers = enumerate(self.json.get("buffers", []))
        kept = [each["uri"] for n, each in buffers if "uri" in each and n not in self._changed]
        for uri in (*kept, *self._images):
            if not uri.startswith("data:") and not (out.parent / unquote(uri)).is_file():
                raise UsageError(f"-o {out}: the model names {uri}; copy that there first")

    def _place_buffers(self, out: Path, output: Output) -> bool:
        """Put changed buffers where JSON refers to them; whether that changes the JSON."""
        renamed = False
        for number, about in enumerate(self.json.get("buffers", [])):
            uri = about.get("uri")
            if uri is None or number not in self._changed:
                continue
            if uri.startswith("data:"):
                packed = base64.b64encode(self.buffers[number]).decode()
                about["uri"] = uri.partition(_DATA)[0] + _DATA + packed
            else:
                suffix = f".{number}.bin"
                with output.file(suffix) as file:
                    file.write(self.buffers[number])
                about["uri"] = quote(out.name + suffix)
            renamed = True
        return renamed

    def _packed(self, text: bytes) -> bytes:
        parts = []
        for kind, content in self._chunks:
            if kind == _JSON:
                content, fill = text, b" "
            elif kind == _BIN and self.json["buffers"] and "uri" not in self.json["buffers"][0]:
                content, fill = bytes(self.buffers[0]), b"\0"
            else:
                fill = b"\0"
            content += fill * (-len(content) % 4)
            parts.append(struct.pack("<I4s", len(content), kind) + content)
        whole = b"".join(parts)
        return struct.pack("<4sII", _MAGIC, 2, 12 + len(whole)) + whole


def index(number: Any) -> int:
    """What stands for a place in a list; ValueError for -1, which Python takes for the last."""
    if not isinstance(number, int) or isinstance(number, bool) or number < 0:
        raise ValueError(f"{number!r} is no index")
    return number


def _kind(about: dict[str, Any]) -> np.dtype[Any]:
    """Return the type in which an accessor's numbers are stored."""
    if about["componentType"] not in _TYPES:
        raise ValueError(f"component type {about['componentType']} is unknown")
    return np.dtype(_TYPES[about["componentType"]])
