"""Models of many kinds: only index data change, and closed models stay closed."""

import base64
import copy
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from harness.models.in_place import retriangulate
from tests.models.build import split_glb
from tests.models.various import MODELS, SHAPE


@pytest.mark.parametrize("name", MODELS)
def test_nothing_but_index_data_changes(tmp_path, name):
    source = MODELS[name](tmp_path / name)
    target = tmp_path / f"better-{name}"
    done = retriangulate(source, target)
    assert list_changes(source, target) == []
    assert (done.changed > 0) is (name != "no-indices.glb")  # no two triangles share vertices
    assert (source.read_bytes() != target.read_bytes()) is (done.changed > 0)
    assert is_closed(source) is is_closed(target) is (name != "fan.glb")
    if name in ("plain.glb", "textured.glb", "quantized.glb"):  # overwritten, not appended
        assert source.stat().st_size == target.stat().st_size
    repeated = retriangulate(target, tmp_path / f"again-{name}")
    assert repeated.changed == 0
    if name != "fan.glb":  # which trimesh cannot read
        before, after = (trimesh.load(path, force="mesh") for path in (source, target))
        assert after.area == pytest.approx(before.area, rel=1e-5)
    if name in ("plain.glb", "plain.obj"):
        assert (done.changed, done.unchanged) == (2, {})
        assert done.triangles == done.flat == len(after.faces) == len(before.faces)
        assert done.after < 0.8 * done.before
        assert after.volume == pytest.approx(before.volume, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("variants.glb", b'"us"', b'"me"'),
        ("variants.glb", SHAPE.points[0].tobytes(), SHAPE.points[1].tobytes()),
        ("plain.obj", b"\nv ", b"\nv 1"),
    ],
)
def test_changes_of_other_content_are_detected(tmp_path, name, old, new):
    source, other = MODELS[name](tmp_path / name), tmp_path / f"other-{name}"
    other.write_bytes(source.read_bytes().replace(old, new, 1))
    assert list_changes(source, other) != []


WIDTHS = {5121: "<u1", 5123: "<u2", 5125: "<u4"}


def list_changes(before: Path, after: Path) -> list[str]:
    """Return descriptions of changes outside the indices of triangles."""
    if before.suffix in (".glb", ".gltf"):
        return list(_gltf(before, after))
    return _lines(before.read_bytes(), after.read_bytes(), rb"f ")


def is_closed(path: Path) -> bool:
    """Return whether each edge has two triangles, except degenerate triangles that join strips."""
    mesh = trimesh.load(path, force="mesh", process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=6)
    a, b, c = mesh.faces.T
    mesh.update_faces((a != b) & (b != c) & (c != a))
    return bool(mesh.is_watertight)


def read_gltf(path: Path) -> tuple[dict[str, Any], list[bytes]]:
    data, binary = path.read_bytes(), b""
    if data[:4] == b"glTF":
        document, binary = split_glb(data)
    else:
        document = json.loads(data)
    buffers = []
    for buffer in document["buffers"]:
        uri = buffer.get("uri", "")
        content = binary
        if uri.startswith("data:"):
            content = base64.b64decode(uri.partition(",")[2])
        elif uri:
            content = (path.parent / uri).read_bytes()
        buffers.append(content[: buffer["byteLength"]])
    return document, buffers


def _gltf(before: Path, after: Path) -> Any:
    (one, old), (two, new) = read_gltf(before), read_gltf(after)
    primitives = [primitive for mesh in one["meshes"] for primitive in mesh["primitives"]]
    used = {primitive["indices"] for primitive in primitives if "indices" in primitive}
    free = [np.zeros(len(values), bool) for values in old]
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
    if json.dumps(_plain(one)) != json.dumps(_plain(two, template=one)):
        yield "JSON"
    for mesh, changed_mesh in zip(one["meshes"], two["meshes"], strict=True):
        for primitive, other in zip(mesh["primitives"], changed_mesh["primitives"], strict=True):
            if count(one, primitive) != count(two, other):
                yield f"{count(one, primitive)} triangles, {count(two, other)} now"


def count(document: dict[str, Any], primitive: dict[str, Any]) -> int:
    number = primitive.get("indices", primitive["attributes"]["POSITION"])
    corners = document["accessors"][number]["count"]
    return corners // 3 if primitive.get("mode", 4) == 4 else corners - 2


def _plain(document: dict[str, Any], template: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the JSON without references to indices; additions at the end of lists are skipped."""
    document = copy.deepcopy(document)
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            primitive.pop("indices", None)
            primitive.pop("mode", None)
    for name in ("accessors", "bufferViews"):
        document[name] = document[name][: len((template or document)[name])]
    for buffer in document["buffers"]:
        buffer.pop("byteLength")
        buffer.pop("uri", None)
    return document


def _lines(one: bytes, other: bytes, face: bytes) -> list[str]:
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
