"""Unusual but valid files are read; damaged files are refused with one line."""

import base64
import json
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.errors import UsageError
from harness.models.gltf import GltfModel
from harness.models.in_place import retriangulate
from harness.models.seen import read
from scenes import SceneError
from tests.models.build import KITE, LONG, Builder, split_glb

DATA = "data:application/octet-stream;base64,"


def kite_text(folder: Path, *, shared: bool = False, uri: str = "", **more: Any) -> Path:
    """Write a kite as .gltf; shared : the indices must move, so the JSON is written again."""
    builder = Builder()
    indices = builder.primitive(KITE, LONG)["indices"]
    if shared:
        builder.json["accessors"].append(dict(builder.json["accessors"][indices]))
    _, data = split_glb(builder.write(folder / "kite.glb").read_bytes())
    if uri:
        (folder / uri).write_bytes(data)
    about = {"byteLength": len(data), "uri": uri or DATA + base64.b64encode(data).decode()}
    for key, value in more.items():
        builder.json.setdefault(key, type(value)())
        builder.json[key] += value if isinstance(value, list) else [value]
    path = folder / "kite.gltf"
    path.write_text(json.dumps({**builder.json, "buffers": [about]}))
    return path


@pytest.mark.parametrize("more", [{"bufferViews": [{}]}, {"images": [None]}])
@pytest.mark.parametrize("folder", [".", "other"])
def test_damage_outside_the_mesh_is_refused(tmp_path, more, folder):
    source = kite_text(tmp_path, **more)
    with pytest.raises(SceneError, match=r"kite\.gltf cannot be read as a model"):
        retriangulate(source, tmp_path / folder / "out.gltf")


def rewritten(source: Path, extras: str) -> dict[str, Any]:
    source.write_text(source.read_text()[:-1] + f', "extras": {extras}}}')
    out = source.with_name("out.gltf")
    assert retriangulate(source, out).changed == 1
    return json.loads(out.read_text())


def test_a_lone_surrogate_is_preserved(tmp_path):
    document = rewritten(kite_text(tmp_path, shared=True), r'{"n": "\ud83d", "o": "\u00e9"}')
    assert document["extras"] == {"n": "\ud83d", "o": "é"}


@pytest.mark.parametrize("number", ["1e400", "NaN"])
def test_a_number_beyond_double_precision_is_refused(tmp_path, number):
    with pytest.raises(SceneError, match="invalid number in the JSON"):
        rewritten(kite_text(tmp_path), f'{{"a": {number}}}')
    assert not (tmp_path / "out.gltf").exists()


def test_the_name_of_a_new_buffer_is_escaped(tmp_path):
    source = kite_text(tmp_path, uri="buf.bin")
    for name in ("a%41.gltf", "a b#c.gltf"):
        retriangulate(source, tmp_path / name)
        assert retriangulate(tmp_path / name, None).changed == 0


def test_only_referenced_files_must_exist(tmp_path):
    source = kite_text(tmp_path, uri="buf.bin")
    out = tmp_path / "other" / "kite.gltf"
    names = [path.name for path in retriangulate(source, out).files]
    assert names == ["kite.gltf", "kite.gltf.0.bin"]
    assert retriangulate(out, None).changed == 0
    with pytest.raises(UsageError, match=r"missing file kite.gltf.0.bin, .*; copy the file first"):
        retriangulate(out, tmp_path / "kite.gltf")


@pytest.mark.parametrize("far", [0, 20])
def test_normalized_positions_are_scaled_as_drawn(tmp_path, far):
    seen = []
    for normalized in (False, True):
        points = np.rint(KITE / 9 * 32767)
        values = points.astype("<i2") if normalized else (points / 32767).astype("<f4")
        builder = Builder(values, LONG)
        if normalized:
            builder.json["accessors"][builder.first["attributes"]["POSITION"]]["normalized"] = True
        builder.json["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [far, 0, 0]}]
        builder.json["scenes"] = [{"nodes": [0, 1]}]
        seen.append(retriangulate(builder.write(tmp_path / "a.glb"), None, sizes=[64]).views)
    assert seen[0] == seen[1]


def test_a_primitive_without_positions_is_skipped(tmp_path):
    builder = Builder(KITE, LONG)
    builder.json["meshes"].append({"primitives": [{"attributes": {}}]})
    assert retriangulate(builder.write(tmp_path / "a.glb"), tmp_path / "b.glb").changed == 1
    assert [len(parts) for parts in GltfModel(tmp_path / "b.glb").iterate_groups()] == [1, 0]


POINTS = ["v 0 0 0", "v 2 -1 0", "v 9 0 0", "v 2 1 0"]
FACES = ["f 1 2 3", "f 1 3 4"]


@pytest.mark.parametrize(
    "lines",
    [
        ["v 0 0 0 # first", *POINTS[1:], *FACES],
        ["v 0 \\", "0 0", *POINTS[1:], *FACES],
        ["v 0 0\\", "0\\", "", *POINTS[1:], *FACES],
        [*FACES, *POINTS],
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_obj_of_other_programs(tmp_path, lines, end):
    source, out = tmp_path / "a.obj", tmp_path / "b.obj"
    source.write_bytes(end.join([*lines, ""]).encode())
    assert retriangulate(source, out).changed == 1
    changed = [line for line in out.read_bytes().decode().split(end) if line[:1] == "f"]
    assert changed == ["f 4 1 2", "f 4 2 3"]


@pytest.mark.parametrize("value", ["1e200", "1e308", "-1e308", "inf", "nan"])
def test_values_beyond_single_precision_cause_no_warning(tmp_path, value):
    source = tmp_path / "a.obj"
    more = [f"v {value} 0 0", f"v 0 {value} 1", "f 1 2 5", "f 5 6 3"]
    source.write_text("\n".join([*POINTS, *more, *FACES, ""]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for out in (tmp_path / "b.obj", None):
            retriangulate(source, out, sizes=[64])
        read(str(source), views=1, pixels=64)


def test_two_dimensional_positions_are_refused(tmp_path):
    builder = Builder(KITE[:, :2].copy(), LONG)
    source = builder.write(tmp_path / "flat.glb")
    with pytest.raises(SceneError, match="POSITION has 2 numbers per vertex, not 3"):
        retriangulate(source, None)
    with pytest.raises(SceneError, match="POSITION has 2 numbers per vertex, not 3"):
        read(str(source))


@pytest.mark.parametrize(
    "document",
    [
        {"scenes": [{"nodes": [-1]}], "nodes": [{"mesh": 0}]},
        {"scenes": [{"nodes": [0]}], "nodes": [{"mesh": -1}]},
        {"scenes": [{"nodes": [0]}], "nodes": [{"children": [-1]}, {"mesh": 0}]},
        {"scene": -1, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]},
    ],
)
def test_a_negative_index_is_refused(tmp_path, document):
    builder = Builder(KITE, LONG)
    builder.json |= document
    with pytest.raises(SceneError, match="-1 is not an index"):
        retriangulate(builder.write(tmp_path / "kite.glb"), None)


@pytest.mark.parametrize(
    "uri", ["../kite.bin", "/etc/hostname", "a/../../kite.bin", "%2e%2e/kite.bin"]
)
def test_buffers_outside_the_models_folder_are_refused(tmp_path, uri):
    folder = tmp_path / "models"
    folder.mkdir()
    (folder / "a").mkdir()
    (tmp_path / "kite.bin").write_bytes(bytes(200))
    source = kite_text(folder)
    document = json.loads(source.read_text())
    document["buffers"] = [{"byteLength": 1, "uri": uri}]
    source.write_text(json.dumps(document))
    with pytest.raises(SceneError, match="which is outside the model's folder: copy it there"):
        retriangulate(source, None)


def test_continued_lines_take_linear_time(tmp_path):
    """Quadratic time took minutes for a file of a megabyte."""
    source = tmp_path / "long.obj"
    corners = " ".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in KITE.tolist())
    source.write_text(corners + "f 1 2 3\nf 1 3 4\nf " + "1 \\\n" * 100_000 + "2 3\n")
    begun = time.process_time()
    done = retriangulate(source, None)
    assert done.unchanged == {"faces that are not triangles, or on several lines": 1}
    assert time.process_time() - begun < 20
