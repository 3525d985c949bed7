"""Small models, written byte by byte, so that a test shows all of their content."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}

KITE = np.array([(0, 0, 0), (2, -1, 0), (9, 0, 0), (2, 1, 0)], dtype="<f4")
"""The diagonal 0-2 is long, 1-3 is short."""

LONG = np.array([(0, 1, 2), (0, 2, 3)])
"""`KITE` cut along the long diagonal."""


def join_glb(document: Any, data: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def split_glb(content: bytes) -> tuple[Any, bytes]:
    size = struct.unpack_from("<I", content, 12)[0]
    return json.loads(content[20 : 20 + size]), content[28 + size :]


class Builder:
    """Collects accessors, each in a separate buffer view; starts with a primitive, if given."""

    def __init__(self, *positions_and_indices: Any, **more: Any) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "meshes": [{"primitives": []}],
            "accessors": [],
            "bufferViews": [],
        }
        self._data = b""
        if positions_and_indices:
            self.first = self.primitive(*positions_and_indices, **more)

    def view(self, data: bytes) -> int:
        self._data += b"\0" * (-len(self._data) % 4)
        view = {"buffer": 0, "byteOffset": len(self._data), "byteLength": len(data)}
        self.json["bufferViews"].append(view)
        self._data += data
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, normalized: bool = False) -> int:
        rows = np.ascontiguousarray(values).reshape(len(values), -1)
        about = {
            "bufferView": self.view(rows.tobytes()),
            "componentType": COMPONENTS[rows.dtype.str[1:]],
            "count": len(rows),
            "type": WIDTHS[rows.shape[1]],
        }
        if normalized:
            about["normalized"] = True
        self.json["accessors"].append(about)
        return len(self.json["accessors"]) - 1

    def primitive(
        self, positions: np.ndarray, indices: np.ndarray | None, **more: Any
    ) -> dict[str, Any]:
        primitive: dict[str, Any] = {"attributes": {"POSITION": self.accessor(positions)}, **more}
        if indices is not None:
            primitive["indices"] = self.accessor(np.asarray(indices, "<u2").reshape(-1))
        self.json["meshes"][0]["primitives"].append(primitive)
        return primitive

    def write(self, path: Path) -> Path:
        self.json["buffers"] = [{"byteLength": len(self._data)}]
        path.write_bytes(join_glb(self.json, self._data))
        return path
