"""Models of many kinds: nothing but index data changes, and what was closed stays closed."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
import trimesh

from harness.models.in_place import retriangulate
from tests.models.kept import closed, lost, parsed
from tests.models.various import MODELS

UNCHANGED = {"no-indices.glb", "sheet.glb"}
"""Models in which no two triangles share vertices, and whose sides would hang together."""

OPEN = {"fan.glb", "sheet.glb"}


@pytest.mark.parametrize("name", MODELS)
def test_nothing_but_index_data_changes(tmp_path, name):
    source = MODELS[name](tmp_path / name)
    target = tmp_path / f"better-{name}"
    done = retriangulate(source, target)
    assert lost(source, target) == []
    assert (done.changed > 0) is (name not in UNCHANGED)
    assert (source.read_bytes() != target.read_bytes()) is (name not in UNCHANGED)
    assert closed(source) is closed(target) is (name not in OPEN)
    again = retriangulate(target, tmp_path / f"again-{name}")
    assert again.changed == 0
    if name != "fan.glb":  # which trimesh does not read
        before, after = (trimesh.load(path, force="mesh") for path in (source, target))
        assert after.area == pytest.approx(before.area, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "spoil", "told"),
    [
        ("textured.glb", lambda json, data: data.__setitem__(3, data[3] ^ 1), "bytes of buffer 0"),
        ("variants.glb", lambda json, _: json["extras"].update(by=["them"]), "JSON"),
        (
            "several.glb",
            lambda json, _: json["meshes"][0]["primitives"][0].update(material=1),
            "JSON",
        ),
        ("animated.glb", lambda json, _: json["nodes"][0].update(mesh=0, name="x"), "JSON"),
    ],
)
def test_what_is_lost_would_be_found(tmp_path, name, spoil, told):
    source = MODELS[name](tmp_path / name)
    changed, buffers = parsed(source)
    data = bytearray(buffers[0])
    spoil(changed, data)
    text = json.dumps(changed).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + bytes(data)
    other = tmp_path / "other.glb"
    other.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    assert lost(source, other) == [told]


def test_a_changed_place_would_be_found(tmp_path):
    source = MODELS["textured.obj"](tmp_path / "textured.obj")
    data = bytearray(source.read_bytes())
    place = data.index(b"v ") + 3
    data[place] = data[place] + 1 if data[place] != ord("9") else ord("1")
    other = tmp_path / "other.obj"
    other.write_bytes(bytes(data))
    assert lost(source, other) != []


def test_closed_is_not_said_of_what_is_open(tmp_path):
    source = MODELS["plain.glb"](tmp_path / "plain.glb")
    mesh = trimesh.load(source, force="mesh")
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(tmp_path / "open.glb")
    assert not closed(tmp_path / "open.glb")
