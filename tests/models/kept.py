"""What of a model is other than before, but for index data and what refers to it.

This reads files in its own way, and shares no code with what writes them.
"""

from __future__ import annotations

import base64
import copy
import json
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

WIDTHS = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
Change = str


def lost(before: Path, after: Path) -> list[Change]:
    """Say what is not byte for byte as it was, beside indices of triangles; [] if all is."""
    if before.suffix in (".glb", ".gltf"):
        return list(_gltf(before, after))
    return _lines(before.read_bytes(), after.read_bytes(), rb"f ")


def closed(path: Path) -> bool:
    """Whether each edge has two triangles, where those are left out that a strip is joined by."""
    mesh = trimesh.load(path, force="mesh", process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=6)
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    return bool(mesh.is_watertight)


def parsed(path: Path) -> tuple[dict[str, Any], list[bytes]]:
    """Return the JSON of a glTF file and the bytes of its buffers."""
    data, binary = path.read_bytes(), b""
    if data[:4] == b"glTF":
        size = struct.unpack_from("<I", data, 12)[0]
        text = data[20 : 20 + size]
        binary = data[28 + size :]
    else:
        text = data
    told = json.loads(text)
    buffers = []
    for each in told["buffers"]:
        uri = each.get("uri", "")
        content = binary
        if uri.startswith("data:"):
            content = base64.b64decode(uri.partition(",")[2])
        elif uri:
            content = (path.parent / uri).read_bytes()
        buffers.append(content[: each["byteLength"]])
    return told, buffers


def _gltf(before: Path, after: Path) -> Any:
    (one, old), (two, new) = parsed(before), parsed(after)
    used = {
        primitive["indices"]
        for told in (one,)
        for mesh in told["meshes"]
        for primitive in mesh["primitives"]
        if "indices" in primitive
    }
    free = [np.zeros(len(each), bool) for each in old]
    for number in used:
        accessor = one["accessors"][number]
        if "bufferView" in accessor:
            view = one["bufferViews"][accessor["bufferView"]]
            first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
            size = np.dtype(WIDTHS[accessor["componentType"]]).itemsize * accessor["count"]
            free[view["buffer"]][first : first + size] = True
    for number, (content, other) in enumerate(zip(old, new, strict=True)):
        same = np.frombuffer(content, "u1") == np.frombuffer(other[: len(content)], "u1")
        if len(other) < len(content) or not (same | free[number]).all():
            yield f"bytes of buffer {number}"
    if json.dumps(_plain(one)) != json.dumps(_plain(two, like=one)):
        yield "JSON"
    for mesh, again in zip(one["meshes"], two["meshes"], strict=True):
        for primitive, other in zip(mesh["primitives"], again["primitives"], strict=True):
            if count(one, primitive) != count(two, other):
                yield f"{count(one, primitive)} triangles, {count(two, other)} now"


def count(told: dict[str, Any], primitive: dict[str, Any]) -> int:
    """Return how many triangles a primitive draws."""
    number = primitive.get("indices", primitive["attributes"]["POSITION"])
    corners = told["accessors"][number]["count"]
    return corners // 3 if primitive.get("mode", 4) == 4 else corners - 2


def _plain(told: dict[str, Any], like: dict[str, Any] | None = None) -> dict[str, Any]:
    """JSON without what refers to indices; what was added at the end of a list is left out."""
    told = copy.deepcopy(told)
    for mesh in told["meshes"]:
        for primitive in mesh["primitives"]:
            primitive.pop("indices", None)
            primitive.pop("mode", None)
    for name in ("accessors", "bufferViews"):
        told[name] = told[name][: len((like or told)[name])]
    for each in told["buffers"]:
        each.pop("byteLength")
        each.pop("uri", None)
    return told


def _lines(one: bytes, other: bytes, face: bytes) -> list[Change]:
    rows = [data.splitlines(keepends=True) for data in (one, other)]
    if len(rows[0]) != len(rows[1]):
        return ["lines"]
    for a, b in zip(*rows, strict=True):
        if a == b:
            continue
        words = [re.split(rb"\s+(?=#)|\s+", line.partition(b"#")[0].strip()) for line in (a, b)]
        ends = [line[len(line.partition(b"#")[0].rstrip()) :] for line in (a, b)]
        if not a.startswith(face) or len(words[0]) != len(words[1]) or ends[0] != ends[1]:
            return [f"line {a!r}"]
    return []
