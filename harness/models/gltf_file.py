"""Writes a glTF 2.0 file (.glb, .gltf) with other indices; everything else stays as it is.

Bytes of indices are overwritten in place if nothing else reads them. Otherwise new indices are
appended to the buffer, and the primitive refers to these.

Source: Khronos, "glTF 2.0 Specification", sections 3.6 (buffers, accessors), 4.4 (GLB).
"""

import base64
import io
import json
import os
import shutil
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote, unquote

import numpy as np
from numpy.typing import NDArray

from harness.atomic import Output
from harness.errors import UsageError
from scenes.readers.gltf import (
    BIN,
    DATA_URI,
    JSON,
    MAGIC,
    TRIANGLES,
    WIDTHS,
    GltfFile,
    component_type,
)
from scenes.scene import SceneError

ELEMENT_ARRAY_BUFFER = 34963
_SPARSE = ("indices", "values")

MAX_GLB_BYTES = 2**32 - 1
"""Largest GLB file: the header holds its length in 32 bits."""

_COPIED_BYTES = 1 << 20


class GltfEditor(GltfFile):
    """A model in memory whose indices can be replaced, and which can be written again."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._images = [each["uri"] for each in self.json.get("images", []) if "uri" in each]
        self._grown: set[int] = set()
        self._changed: set[int] = set()

    def refer(self, primitives: list[dict[str, Any]], indices: NDArray[np.int64]) -> None:
        """Replace the indices of primitives that share an accessor by `indices` (k,)."""
        number = primitives[0].get("indices")
        # a strip or fan may have no indices
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
                self._view(about, component_type(about), 1, len(indices))[:, 0] = indices
                self._changed.add(self.json["bufferViews"][about["bufferView"]]["buffer"])
                return
        number = self._append(indices, about)
        for primitive in primitives:
            primitive["indices"] = number
            if primitive.get("mode", TRIANGLES) != TRIANGLES:
                primitive["mode"] = TRIANGLES

    def _alone(self, accessor: int) -> bool:
        """Return whether no other accessor reads the bytes of this one."""
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
        """Return the byte range of an accessor in its buffer."""
        view = self.json["bufferViews"][accessor["bufferView"]]
        size = component_type(accessor).itemsize * WIDTHS[accessor["type"]]
        first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return first, first + (accessor["count"] - 1) * view.get("byteStride", size) + size

    def _append(self, indices: NDArray[np.int64], like: dict[str, Any]) -> int:
        """Append indices to the first buffer; return their accessor."""
        packed = indices.astype(component_type(like)).tobytes()
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
        """Write the model in the format of the source; return the files."""
        binary = bool(self._chunks)
        self._require_beside(out)
        with Output(out) as output:
            beside = self._place_buffers(out, output)
            text = self._text
            if self._grown or beside:
                text = self._json_text()
            with output.file() as file:
                if binary:
                    write_glb(file, self._new_chunks(text), out)
                else:
                    file.write(text)
            return output.publish()

    def _json_text(self) -> bytes:
        """Return the new JSON; lone surrogates, which UTF-8 cannot encode, are escaped."""
        try:
            return json.dumps(self.json, allow_nan=False, separators=(",", ":")).encode()
        except ValueError as error:
            raise SceneError(
                f"{self.path}: a number in its JSON is invalid or too large for double precision; "
                "correct it first"
            ) from error

    def _require_beside(self, out: Path) -> None:
        """Raise UsageError if the output's folder lacks files that the model refers to."""
        if out.parent.resolve() == self.path.parent.resolve():
            return
        buffers = enumerate(self.json.get("buffers", []))
        kept = [each["uri"] for n, each in buffers if "uri" in each and n not in self._changed]
        for uri in (*kept, *self._images):
            if not uri.startswith("data:") and not (out.parent / unquote(uri)).is_file():
                raise UsageError(
                    f"-o {out}: the model refers to {uri}, which is not there; copy it first"
                )

    def _place_buffers(self, out: Path, output: Output) -> bool:
        """Write changed buffers; return whether their addresses in the JSON change."""
        renamed = False
        for number, about in enumerate(self.json.get("buffers", [])):
            uri = about.get("uri")
            if uri is None or number not in self._changed:
                continue
            if uri.startswith("data:"):
                packed = base64.b64encode(self.buffers[number]).decode()
                about["uri"] = uri.partition(DATA_URI)[0] + DATA_URI + packed
            else:
                suffix = f".{number}.bin"
                with output.file(suffix) as file:
                    file.write(self.buffers[number])
                about["uri"] = quote(out.name + suffix)
            renamed = True
        return renamed

    def _new_chunks(self, text: bytes) -> list[tuple[bytes, IO[bytes]]]:
        """Return the chunks of the GLB file, with the new JSON and the first buffer."""
        new = {JSON: text}
        buffers = self.json.get("buffers")
        if buffers and "uri" not in buffers[0]:
            new[BIN] = bytes(self.buffers[0])
        return [(kind, io.BytesIO(new.get(kind, content))) for kind, content in self._chunks]


def write_glb(stream: IO[bytes], chunks: Sequence[tuple[bytes, IO[bytes]]], out: Path) -> None:
    """Write chunks, (type, content), to a GLB file; `out` is its name for messages."""
    lengths = [content.seek(0, os.SEEK_END) for _, content in chunks]
    total = 12 + sum(8 + length + -length % 4 for length in lengths)
    if total > MAX_GLB_BYTES:
        raise UsageError(
            f"{out} would be {total / 2**30:.1f} GiB, and GLB ends at 4 GiB: "
            "write .gltf, or fewer polygons with limit"
        )
    stream.write(struct.pack("<4sII", MAGIC, 2, total))
    for (kind, content), length in zip(chunks, lengths, strict=True):
        stream.write(struct.pack("<I4s", length + -length % 4, kind))
        content.seek(0)
        shutil.copyfileobj(content, stream, _COPIED_BYTES)
        stream.write((b" " if kind == JSON else b"\0") * (-length % 4))
