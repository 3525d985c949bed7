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
    kind = before.suffix
    if kind in (".glb", ".gltf"):
        return list(_gltf(before, after))
    one, other = before.read_bytes(), after.read_bytes()
    if kind == ".obj":
        return _lines(one, other, rb"f ")
    if kind == ".ply":
        return _ply(one, other)
    return _stl(one, other)


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


def _ply(one: bytes, other: bytes) -> list[Change]:
    head, mark, content = one.partition(b"end_header\n")
    if not other.startswith(head + mark):
        return ["header"]
    rest = other[len(head) + len(mark) :]
    counts = [int(each) for each in re.findall(rb"element \w+ (\d+)", head)]
    if b"ascii" in head:
        rows = [data.split(b"\n") for data in (content, rest)]
        if rows[0][: counts[0]] != rows[1][: counts[0]]:
            return ["vertices"]
        faces = [[row.split() for row in each[counts[0] :]] for each in rows]
        same = all(a[:1] == b[:1] and a[4:] == b[4:] for a, b in zip(*faces, strict=True))
        return [] if same else ["faces"]
    if len(content) != len(rest):
        return ["size"]
    size = (len(content) - _faces_size(head, counts[1])) // counts[0] * counts[0]
    if content[:size] != rest[:size]:
        return ["vertices"]
    rows = [np.frombuffer(data[size:], "u1").reshape(counts[1], -1) for data in (content, rest)]
    kept = np.r_[0, 13 : rows[0].shape[1]]
    return [] if (rows[0][:, kept] == rows[1][:, kept]).all() else ["faces"]


def _faces_size(head: bytes, count: int) -> int:
    tail = head.partition(b"element face")[2]
    return count * (13 + 2 * tail.count(b"property ushort"))


def _stl(one: bytes, other: bytes) -> list[Change]:
    if one.lstrip().startswith(b"solid") and b"facet" in one:
        both = [data.splitlines() for data in (one, other)]
        rows = [[line for line in lines if b"vertex" not in line] for lines in both]
        words = [sorted(set(data.split())) for data in (one, other)]
        return [] if rows[0] == rows[1] and words[0] == words[1] else ["text"]
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("attribute", "<u2")])
    rows = [np.frombuffer(data, kind, offset=84) for data in (one, other)]
    same = one[:84] == other[:84] and all(
        (rows[0][name] == rows[1][name]).all() for name in ("normal", "attribute")
    )
    places = [{tuple(place) for place in each["corners"].reshape(-1, 3).tolist()} for each in rows]
    return [] if same and places[0] == places[1] else ["normals, attributes or places"]
