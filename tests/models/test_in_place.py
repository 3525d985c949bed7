"""Models whose flat faces get other diagonals: what changes, and what stays the same."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from harness.errors import HarnessError
from harness.models.diagonals import find_outlines
from harness.models.flat_faces import Faces, compute_float32_tolerance
from harness.models.gltf import GltfModel
from harness.models.in_place import retriangulate
from scenes import SceneError
from tests.conftest import assert_refused, require_ok
from tests.models.build import KITE, LONG, Builder
from tests.models.various import make_solid


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out.glb"


def read_triangles(path) -> list[list[list[int]]]:
    parts = [part for group in GltfModel(path).iterate_groups() for part in group]
    return [np.sort(part.mesh.triangles).tolist() for part in parts]


def cut_again(builder: Builder, out: Path) -> list[list[list[int]]]:
    """Return the triangles of a built model after its faces were triangulated again."""
    retriangulate(builder.write(out.with_name("given.glb")), out)
    return read_triangles(out)


CUT_LONG, CUT_SHORT = [[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]


def test_check_writes_nothing(tmp_path, harness):
    make_solid().export(tmp_path / "plate.glb")
    output, _ = require_ok(harness("triangulate", "plate.glb", "--check"))
    assert "2 faces would get other diagonals" in output
    lines = [line for line in output.splitlines() if line.startswith("from 24 directions")]
    assert [line.split(" px")[0].split()[-1] for line in lines] == ["256", "1024"]
    assert all("helper lanes -" in line and "quads -" in line for line in lines)
    result = harness("triangulate", "plate.glb", "--check", "-o", "new.glb")
    assert_refused(result, "--check and -o are mutually exclusive")
    assert [path.name for path in tmp_path.iterdir()] == ["plate.glb"]


def test_triangulate_prints_the_changes_of_a_model(tmp_path, harness):
    make_solid().export(tmp_path / "plate.glb")
    output, _ = require_ok(harness("triangulate", "plate.glb", "-o", "out.glb"))
    assert "in 70 flat faces of two or more triangles (100% of the area)" in output
    assert "out.glb: 2 faces get other diagonals" in output
    assert "No vertex changes" in output
    assert trimesh.load_mesh(tmp_path / "out.glb").is_watertight


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (("-o", "out.obj"), "the output must keep the input format (.glb)"),
        (("-o", "out.glb", "--limit", "3"), "--limit is for polygons"),
        (("-o", "out.glb", "--criterion", "mixed=1/2/0"), "choose from edge-length"),
        (("-o", "out.glb", "--criterion", "expected-quads"), "depends on a size in pixels"),
        (("-o", "out.glb", "--criterion", "lenght"), "unknown criterion 'lenght'"),
        ((), "-o FILE is missing"),
    ],
)
def test_polygon_options_are_refused_for_models(tmp_path, harness, more, reason):
    make_solid().export(tmp_path / "plate.glb")
    assert_refused(harness("triangulate", "plate.glb", *more), reason)


AFFINE = KITE[:, 0] * 3 - KITE[:, 1] * 2 + 1
BUMP = np.array([0, 0, 0, 1])
ATTRIBUTES = {
    "TEXCOORD_0": lambda bump: np.stack([AFFINE, AFFINE + bump / 50], axis=1).astype("<f4"),
    "NORMAL": lambda bump: np.stack([bump / 100, 0 * bump, 1 + 0 * bump], axis=1).astype("<f4"),
    "TANGENT": lambda bump: np.stack([1 + bump / 99] * 4, axis=1).astype("<f4"),
    "COLOR_0": lambda bump: np.stack([AFFINE / 99 + bump / 99] * 3, axis=1).astype("<f4"),
    "_FEATURE_ID_0": lambda bump: (5 + bump).astype("<f4"),
    "JOINTS_0": lambda bump: np.stack([3 + bump] * 4, axis=1).astype("<u2"),
    # Positions times weights are not affine, even if the weights are.
    "WEIGHTS_0": lambda bump: np.stack([0.25 + bump.any() * KITE[:, 0] / 18] * 4, axis=1),
}


@pytest.mark.parametrize("position", ["attributes", "targets"])
@pytest.mark.parametrize("name", ATTRIBUTES)
def test_a_face_changes_only_if_attributes_are_affine(tmp_path, out, name, position):
    if position == "targets" and name.startswith(("_", "JOINTS", "WEIGHTS")):
        name = "POSITION"
    for bump, expected in ((0 * BUMP, CUT_SHORT), (BUMP, CUT_LONG)):
        builder = Builder(KITE, LONG)
        values = ATTRIBUTES.get(name, lambda bump: (KITE * [2, 3, 1] + bump[:, None]).astype("<f4"))
        added = {name: builder.accessor(values(bump))}
        if position == "attributes":
            builder.first["attributes"] |= added
        else:
            builder.first["targets"] = [added]
        done = retriangulate(builder.write(tmp_path / "kite.glb"), out)
        assert read_triangles(out) == [expected]
        assert bool(done.changed) is (expected is CUT_SHORT)


@pytest.mark.parametrize(("steps", "expected"), [(2, CUT_SHORT), (40, CUT_LONG)])
def test_bend_beyond_the_tolerance_keeps_a_face_unchanged(out, steps, expected):
    bent = KITE.copy()
    bent[2, 2] = steps * compute_float32_tolerance(KITE) / 4
    builder = Builder(bent, LONG)
    assert cut_again(builder, out) == [expected]


@pytest.mark.parametrize(
    ("mode", "indices"), [(5, [1, 0, 2, 3]), (6, [0, 1, 2, 3]), (6, None), (5, [1, 1, 0, 2, 3, 3])]
)
def test_strips_and_fans_become_lists_of_as_many_triangles(tmp_path, out, mode, indices):
    points = KITE[[0, 1, 2, 3]]
    builder = Builder(points, indices, mode=mode)
    if indices:
        builder.json["accessors"][1]["count"] = len(indices)
    before = read_triangles(builder.write(tmp_path / "kite.glb"))
    retriangulate(tmp_path / "kite.glb", out)
    (after,) = read_triangles(out)
    assert len(after) == len(before[0])
    assert sorted(triangle for triangle in after if len({*triangle}) == 3) == CUT_SHORT


def test_shared_indices_are_not_overwritten(out):
    builder = Builder(KITE, LONG)
    bent = KITE.copy()
    bent[0, 2] = 1
    other = builder.primitive(bent, None)
    other["indices"] = builder.first["indices"]
    assert cut_again(builder, out) == [CUT_SHORT, CUT_LONG]


def test_primitives_with_equal_triangles_share_new_indices(tmp_path, out):
    builder = Builder(KITE, LONG)
    builder.json["meshes"].append({"primitives": [dict(builder.first)]})
    source = builder.write(tmp_path / "kites.glb")
    retriangulate(source, out)
    assert read_triangles(out) == [CUT_SHORT]
    assert len(out.read_bytes()) == len(source.read_bytes())


@pytest.mark.parametrize("kind", ["image", "accessor", "overlap"])
def test_bytes_with_another_reader_are_not_overwritten(tmp_path, out, kind):
    builder = Builder(KITE, LONG)
    view = builder.json["accessors"][builder.first["indices"]]["bufferView"]
    if kind == "image":
        builder.json["images"] = [{"bufferView": view, "mimeType": "image/png"}]
    elif kind == "accessor":
        accessor = dict(builder.json["accessors"][builder.first["indices"]], count=4, type="SCALAR")
        builder.json["accessors"].append(accessor)
    else:
        builder.json["bufferViews"].append(dict(builder.json["bufferViews"][view], byteLength=4))
    source = builder.write(tmp_path / "kite.glb")
    span = builder.json["bufferViews"][view]
    retriangulate(source, out)
    assert read_triangles(out) == [CUT_SHORT]
    for path in (source, out):
        data = path.read_bytes()
        first = 28 + int.from_bytes(data[12:16], "little") + span["byteOffset"]
        assert np.frombuffer(data, "<u2", 6, first).tolist() == [0, 1, 2, 0, 2, 3]


def test_an_unknown_extension_keeps_a_primitive_unchanged(tmp_path, out):
    for name, expected in (("KHR_materials_variants", CUT_SHORT), ("CESIUM_outline", CUT_LONG)):
        builder = Builder(KITE, LONG, extensions={name: {}})
        done = retriangulate(builder.write(tmp_path / "kite.glb"), out)
        assert read_triangles(out) == [expected]
        assert dict(done.unchanged) == ({} if expected is CUT_SHORT else {f"extension {name}": 1})


def test_two_sides_of_a_sheet_do_not_share_a_diagonal(tmp_path, out):
    """The sheet is watertight, with two triangles per edge; the new diagonal would have four."""
    builder = Builder(KITE, [*LONG, (1, 0, 3), (1, 3, 2)])
    source = builder.write(tmp_path / "sheet.glb")
    done = retriangulate(source, out)
    assert out.read_bytes() == source.read_bytes()
    assert done.unchanged == {"a diagonal would also be an edge of other triangles": 1}


def test_parts_back_to_back_do_not_share_a_diagonal(tmp_path, out):
    builder = Builder(KITE, LONG)
    builder.primitive(KITE.copy(), LONG[:, ::-1])
    done = retriangulate(builder.write(tmp_path / "sheets.glb"), out)
    assert read_triangles(out) == [CUT_LONG, CUT_LONG]
    assert done.unchanged == {"a diagonal would also be an edge of other triangles": 2}


@pytest.mark.parametrize(
    "triangles",
    [[*LONG, (0, 1, 2)], [*LONG, (0, 2, 1)], [(0, 1, 2), (0, 2, 2)]],
    ids=["a triangle twice", "an edge of three triangles", "a point"],
)
def test_non_manifold_triangles_are_unchanged(tmp_path, out, triangles):
    source = Builder(KITE, triangles).write(tmp_path / "spoilt.glb")
    retriangulate(source, out)
    assert out.read_bytes() == source.read_bytes()


def test_faces_beyond_the_work_budget_get_flips(tmp_path, out, monkeypatch):
    """Of the plate's 70 faces, the two large faces have holes."""
    source = tmp_path / "plate.glb"
    make_solid().export(source)
    every = retriangulate(source, out)
    assert every.optimal == 70
    # 68 quadrilaterals, and one of the two faces with 68 vertices and two holes
    for work, optimal in ((68 * 4**3 + 20 * 68**3, 69), (68 * 4**3, 68), (67 * 4**3, 67)):
        monkeypatch.setattr("harness.models.diagonals.MAX_WORK_NS", float(work))
        done = retriangulate(source, out)
        assert done.optimal == optimal
        assert done.changed == 2
        assert every.after <= done.after < 1.05 * every.after
        assert trimesh.load_mesh(out).is_watertight


@pytest.mark.parametrize(("count", "kind"), [(65_535, 5123), (65_536, 5125)])
def test_type_of_new_indices_grows_with_the_vertex_count(out, count, kind):
    points = np.vstack([np.zeros((count - 3, 3), "<f4"), KITE[1:]])
    ((*_, first, second),) = cut_again(Builder(points, None, mode=6), out)
    assert [first, second] == [[0, count - 3, count - 1], [count - 3, count - 2, count - 1]]
    assert GltfModel(out).json["accessors"][-1]["componentType"] == kind


def test_sparse_positions_and_indices(out):
    builder = Builder(np.zeros_like(KITE), [(0, 1, 2), (0, 2, 0)])
    positions = builder.json["accessors"][builder.first["attributes"]["POSITION"]]
    del positions["bufferView"]
    rows, values = np.arange(4, dtype="<u2"), KITE
    positions["sparse"] = sparse(builder, rows, values)
    indices = builder.json["accessors"][builder.first["indices"]]
    indices["sparse"] = sparse(builder, np.array([5], "<u2"), np.array([3], "<u2"))
    assert cut_again(builder, out) == [CUT_SHORT]


def sparse(builder: Builder, rows: np.ndarray, values: np.ndarray) -> dict[str, object]:
    return {
        "count": len(rows),
        "indices": {"bufferView": builder.view(rows.tobytes()), "componentType": 5123},
        "values": {"bufferView": builder.view(values.tobytes())},
    }


@pytest.mark.parametrize(
    ("number", "change", "reason"),
    [
        (0, {"count": 3}, "vertex indices 0 to 3 are out of range: the primitive has 3 vertices"),
        (1, {"count": 7000}, "reaches beyond its buffer view"),
        (1, {"componentType": 4711}, "component type 4711 is unknown"),
        (1, {"bufferView": -1}, "-1 is not an index"),
        (1, {"count": 5}, "5 indices are not a multiple of 3"),
    ],
)
def test_a_damaged_model_is_refused_with_one_line(tmp_path, harness, number, change, reason):
    builder = Builder(KITE, LONG)
    builder.json["accessors"][number] |= change
    builder.write(tmp_path / "kite.glb")
    assert_refused(harness("triangulate", "kite.glb", "-o", "out.glb"), reason)
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.parametrize("content", [b"glTF", b"[]", b"{", b"glTF\2\0\0\0\x0c\0\0\0", b"null"])
def test_invalid_gltf_is_refused(tmp_path, content):
    (tmp_path / "a.glb").write_bytes(content)
    with pytest.raises((HarnessError, SceneError)):
        retriangulate(tmp_path / "a.glb", tmp_path / "b.glb")


def test_face_with_two_outer_rings_has_no_outline():
    """Two counter-clockwise triangles, one inside the other, are no polygon with a hole."""
    points = np.array([(0, 0), (9, 0), (0, 9), (1, 1), (3, 1), (1, 3)], dtype=float)
    triangles = np.arange(6).reshape(2, 3)
    one = Faces(points, np.arange(6), triangles, np.arange(2), np.array([0, 2]))
    two = one._replace(triangle_offsets=np.array([0, 1, 2]))
    assert [find_outlines(faces).face.tolist() for faces in (one, two)] == [[], [0, 1]]
