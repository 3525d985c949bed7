"""Meshes of glTF 2.0 files (.glb, .gltf), and replacement of the triangles; all else is unchanged.

Bytes of indices are overwritten in place if no other accessor reads the bytes. Otherwise new
indices are appended to the buffer, and the primitive refers to the new accessor. Source: Khronos,
"glTF 2.0 Specification", sections 3.6 (buffers, accessors), 4.4 (GLB).
"""

import base64
import io
import json
import os
import shutil
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote, unquote

import numpy as np

from harness.atomic import Output
from harness.errors import UsageError
from harness.models.flat_faces import Floats, Ints, ModelMesh, ModelPart, compute_float32_tolerance
from scenes.readers.gltf import (
    BIN,
    DATA_URI,
    FAN,
    FULL_SCALE,
    JSON,
    MAGIC,
    STRIP,
    TRIANGLES,
    WIDTHS,
    GltfFile,
    check_index,
    find_component_type,
)
from scenes.scene import SceneError

ELEMENT_ARRAY_BUFFER = 34963
_SPARSE = ("indices", "values")

MAX_GLB_BYTES = 2**32 - 1  # a GLB file's header has 32 bits for the length
_COPIED_BYTES = 1 << 20

_VARIANTS = "KHR_materials_variants"
HARMLESS = (_VARIANTS, "EXT_mesh_features", "EXT_structural_metadata", "KHR_xmp_json_ld")
"""Extensions of a mesh or primitive that do not depend on the order of triangles."""

_MIN_TOLERANCES = {  # invisible deviations from an affine function on the face
    "NORMAL": 1e-4,
    "TANGENT": 1e-4,
    "COLOR": 1e-4,
    "TEXCOORD": 2.0**-18,
    "POSITION": 0.0,
}

_MAX_INTEGER_STEP = 1e-4  # maximum tolerance of integer coordinates, as a share of the extent


class GltfModel(GltfFile):
    """A model in memory whose triangles can be replaced."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.unchanged = Counter[str]()
        self._images = [image["uri"] for image in self.json.get("images", []) if "uri" in image]
        self._has_appended = False
        self._changed: set[int] = set()  # numbers of buffers with any new bytes

    def iterate_groups(self) -> Iterator[list[ModelPart]]:
        """Yield the parts of each mesh; a part of several meshes is yielded with the first mesh."""
        meshes = self.json.get("meshes", [])
        primitives: dict[str, list[dict[str, Any]]] = {}
        placements: dict[str, tuple[Floats, ...]] = {}
        reasons: dict[str, str] = {}
        for mesh, matrices in zip(meshes, self.list_placements(), strict=True):
            for primitive in mesh["primitives"]:
                key = _make_key(primitive)
                primitives.setdefault(key, []).append(primitive)
                placements[key] = placements.get(key, ()) + matrices
                reasons[key] = reasons.get(key) or self._explain_unchanged(mesh, primitive)
        for mesh in meshes:
            parts = [
                self._make_part(primitives.pop(key), placements[key], reasons[key])
                for key in map(_make_key, mesh["primitives"])
                if key in primitives
            ]
            yield [part for part in parts if part is not None]

    def _explain_unchanged(self, mesh: dict[str, Any], primitive: dict[str, Any]) -> str:
        extensions = primitive.get("extensions", {})
        for name in (*mesh.get("extensions", {}), *extensions):
            if name not in HARMLESS:
                return f"extension {name}"
        materials = self.json.get("materials", [])
        for entry in (primitive, *extensions.get(_VARIANTS, {}).get("mappings", [])):
            if (
                "material" in entry
                and materials[check_index(entry["material"])].get("alphaMode") == "BLEND"
            ):
                return "with a blended material the order of triangles is visible"
        return ""

    def _make_part(
        self, primitives: list[dict[str, Any]], placements: tuple[Floats, ...], reason: str
    ) -> ModelPart | None:
        primitive = primitives[0]
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN) or "POSITION" not in primitive["attributes"]:
            return None
        positions, placements = self.read_positions(primitive, placements)
        triangles = self.read_triangles(primitive, len(positions))
        used_vertices = np.unique(triangles)
        attributes = self._read_attributes(primitive, len(positions), used_vertices)
        exact = positions.astype(np.float64)
        used = exact[used_vertices]
        if positions.dtype.kind == "f" or len(used) == 0:
            tolerance = compute_float32_tolerance(used)
        else:
            tolerance = min(1.0, _MAX_INTEGER_STEP * float(np.ptp(used, axis=0).max()))
        mesh = ModelMesh(exact, triangles, *attributes, tolerance)
        return ModelPart(mesh, primitives, reason, placements)

    def _read_attributes(
        self, primitive: dict[str, Any], count: int, used: Ints
    ) -> tuple[Floats, Floats]:
        """Return the affine and the fixed attributes of `ModelMesh`; `used` sets the tolerance.

        Joints and weights are fixed, because products of weights and position are not affine.
        """
        affine, fixed = [np.empty((count, 0))], [np.empty((count, 0))]
        attributes = primitive["attributes"].items()
        accessors = sorted(item for item in attributes if item[0] != "POSITION")
        for target in primitive.get("targets", []):
            accessors += sorted(target.items())
        for name, accessor in accessors:
            values, normalized = self.read_values(accessor)
            column = values.astype(np.float64)
            if len(column) != count:
                raise ValueError(f"{name}: {len(column):,} values for {count:,} vertices")
            tolerance = _MIN_TOLERANCES.get(name.partition("_")[0])
            if tolerance is None:
                fixed.append(column)
                continue
            if normalized:
                column = column / FULL_SCALE[values.dtype.str[1:]]
            affine.append(column / max(tolerance, compute_float32_tolerance(column[used])))
        return np.concatenate(affine, axis=1), np.concatenate(fixed, axis=1)

    def replace_triangles(self, part: ModelPart, triangles: Ints) -> None:
        """Replace the triangles of a part, whose primitives share an accessor, by (m, 3)."""
        primitives, indices = part.source, triangles.reshape(-1)
        number = primitives[0].get("indices")
        # A strip or fan may have no indices: new ones have 32 bits (5125) or 16 bits (5123).
        accessor = {"componentType": 5125 if int(indices.max()) > 0xFFFE else 5123}
        if number is not None:
            accessor = self.json["accessors"][number]
            users = sum(
                primitive.get("indices") == number
                for mesh in self.json["meshes"]
                for primitive in mesh["primitives"]
            )
            if (
                accessor["count"] == len(indices)
                and "sparse" not in accessor
                and primitives[0].get("mode", TRIANGLES) == TRIANGLES
                and users == len(primitives)
                and not self._shares_bytes(number)
            ):
                stored = self._read_view(accessor, find_component_type(accessor), 1, len(indices))
                stored[:, 0] = indices
                self._changed.add(self.json["bufferViews"][accessor["bufferView"]]["buffer"])
                return
        number = self._append_indices(indices, accessor)
        for primitive in primitives:
            primitive["indices"] = number
            if "mode" in primitive:
                primitive["mode"] = TRIANGLES

    def _shares_bytes(self, index: int) -> bool:
        """Return whether an image or another accessor reads the bytes of an accessor."""
        accessors, views = self.json["accessors"], self.json["bufferViews"]
        view_index = accessors[index]["bufferView"]
        first, last = self._get_span(accessors[index])
        readers = [*self.json.get("images", [])]
        readers += [a["sparse"][part] for a in accessors if "sparse" in a for part in _SPARSE]
        if any(reader.get("bufferView") == view_index for reader in readers):
            return True
        spans = [
            self._get_span(accessor)
            for number, accessor in enumerate(accessors)
            if number != index and accessor.get("bufferView") == view_index
        ] + [
            (view.get("byteOffset", 0), view.get("byteOffset", 0) + view["byteLength"])
            for number, view in enumerate(views)
            if number != view_index and view["buffer"] == views[view_index]["buffer"]
        ]
        return any(end > first and begin < last for begin, end in spans)

    def _get_span(self, accessor: dict[str, Any]) -> tuple[int, int]:
        """Return the byte range of an accessor in the buffer."""
        view = self.json["bufferViews"][accessor["bufferView"]]
        size = find_component_type(accessor).itemsize * WIDTHS[accessor["type"]]
        first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return first, first + (accessor["count"] - 1) * view.get("byteStride", size) + size

    def _append_indices(self, indices: Ints, source: dict[str, Any]) -> int:
        """Append indices to the first buffer; return an accessor of `source`'s component type."""
        packed = indices.astype(find_component_type(source)).tobytes()
        buffer, views = self.buffers[0], self.json["bufferViews"]
        accessors = self.json["accessors"]
        buffer += b"\0" * (-len(buffer) % 4)
        view = {"buffer": 0, "byteOffset": len(buffer), "byteLength": len(packed)}
        views.append(view | {"target": ELEMENT_ARRAY_BUFFER})
        buffer += packed
        self.json["buffers"][0]["byteLength"] = len(buffer)
        accessor = {"bufferView": len(views) - 1, "componentType": source["componentType"]}
        accessors.append(accessor | {"count": len(indices), "type": "SCALAR"})
        self._changed.add(0)
        self._has_appended = True
        return len(accessors) - 1

    def write(self, out: Path) -> list[Path]:
        """Write the model in the format of the source; return the files."""
        self._require_referenced_files(out)
        with Output(out) as output:
            renamed = self._write_buffers(out, output)
            text = self._format_json() if self._has_appended or renamed else self._text
            with output.open_published() as file:
                if self._chunks:
                    write_glb(file, self._make_chunks(text), out)
                else:
                    file.write(text)
            return output.publish()

    def _format_json(self) -> bytes:
        """Return the new JSON; lone surrogates, which UTF-8 cannot encode, are escaped."""
        try:
            return json.dumps(self.json, allow_nan=False, separators=(",", ":")).encode()
        except ValueError as error:
            raise SceneError(
                f"{self.path}: invalid number in the JSON (not finite, or too large for double "
                "precision); correct the file"
            ) from error

    def _require_referenced_files(self, out: Path) -> None:
        if out.parent.resolve() == self.path.parent.resolve():
            return
        buffers = enumerate(self.json.get("buffers", []))
        uris = [b["uri"] for number, b in buffers if "uri" in b and number not in self._changed]
        for uri in (*uris, *self._images):
            if not uri.startswith("data:") and not (out.parent / unquote(uri)).is_file():
                raise UsageError(
                    f"-o {out}: missing file {uri}, to which the model refers; copy the file first"
                )

    def _write_buffers(self, out: Path, output: Output) -> bool:
        """Write changed buffers; return whether URIs in the JSON change."""
        renamed = False
        for number, description in enumerate(self.json.get("buffers", [])):
            uri = description.get("uri")
            if uri is None or number not in self._changed:
                continue
            if uri.startswith("data:"):
                packed = base64.b64encode(self.buffers[number]).decode()
                description["uri"] = uri.partition(DATA_URI)[0] + DATA_URI + packed
            else:
                suffix = f".{number}.bin"
                with output.open_published(suffix) as file:
                    file.write(self.buffers[number])
                description["uri"] = quote(out.name + suffix)
            renamed = True
        return renamed

    def _make_chunks(self, text: bytes) -> list[tuple[bytes, IO[bytes]]]:
        new = {JSON: text}
        buffers = self.json.get("buffers")
        if buffers and "uri" not in buffers[0]:
            new[BIN] = bytes(self.buffers[0])
        return [(kind, io.BytesIO(new.get(kind, content))) for kind, content in self._chunks]


def write_glb(stream: IO[bytes], chunks: Sequence[tuple[bytes, IO[bytes]]], out: Path) -> None:
    """Write chunks, (type, content), to a GLB file; `out` is the file's name in messages."""
    lengths = [content.seek(0, os.SEEK_END) for _, content in chunks]
    total = 12 + sum(8 + length + -length % 4 for length in lengths)
    if total > MAX_GLB_BYTES:
        raise UsageError(
            f"{out}: too large for GLB ({total / 2**30:.1f} GiB, the maximum is 4 GiB); "
            "write .gltf, or fewer polygons with --limit"
        )
    stream.write(struct.pack("<4sII", MAGIC, 2, total))
    for (kind, content), length in zip(chunks, lengths, strict=True):
        stream.write(struct.pack("<I4s", length + -length % 4, kind))
        content.seek(0)
        shutil.copyfileobj(content, stream, _COPIED_BYTES)
        stream.write((b" " if kind == JSON else b"\0") * (-length % 4))


def _make_key(primitive: dict[str, Any]) -> str:
    """Return a text that is equal for primitives with the same vertices and triangles."""
    names = ("attributes", "indices", "mode", "targets", "extensions")
    return repr([primitive.get(name) for name in names])
