"""Models whose flat faces get other diagonals: what changes, and all that must not."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from harness.errors import HarnessError, UsageError
from harness.models.diagonals import choose
from harness.models.flat_faces import ModelMesh, flat_faces, single_precision_tolerance
from harness.models.gltf import GltfModel
from harness.models.in_place import retriangulate
from scenes import SceneError
from tests.conftest import assert_refused, require_ok
from tests.models.build import KITE, LONG, Builder
from tests.models.various import solid


@pytest.fixture
def out(tmp_path):
    return tmp_path / "out.glb"


def triangles_of(path) -> list[list[list[int]]]:
    """Return the triangles of each part of each mesh, corners in any order."""
    parts = [part for group in GltfModel(path).groups() for part in group]
    return [np.sort(part.mesh.triangles).tolist() for part in parts]


def triangles_after(builder: Builder, out: Path) -> list[list[list[int]]]:
    """Return the triangles of what was built, its faces triangulated anew."""
    retriangulate(builder.write(out.with_name("given.glb")), out)
    return triangles_of(out)


CUT_LONG, CUT_SHORT = [[0, 1, 2], [0, 2, 3]], [[0, 1, 3], [1, 2, 3]]


@pytest.mark.parametrize("suffix", [".glb", ".obj"])
def test_a_plate_gets_shorter_diagonals_and_stays_what_it_is(tmp_path, suffix):
    source, target = tmp_path / f"plate{suffix}", tmp_path / f"other{suffix}"
    solid().export(source)
    done = retriangulate(source, target)
    before, after = (trimesh.load_mesh(path) for path in (source, target))
    assert (done.changed, done.left) == (2, {})
    assert done.triangles == done.flat == len(after.faces) == len(before.faces)
    assert done.after < 0.8 * done.before
    assert after.is_watertight
    assert after.volume == pytest.approx(before.volume, rel=1e-6)
    assert after.area == pytest.approx(before.area, rel=1e-6)
    assert {*map(tuple, after.vertices)} == {*map(tuple, before.vertices)}


def test_check_writes_nothing(tmp_path, harness):
    solid().export(tmp_path / "plate.glb")
    told, _ = require_ok(harness("triangulate", "plate.glb", "--check"))
    assert "2 faces would get other diagonals" in told
    lines = [line for line in told.splitlines() if line.startswith("from 24 directions")]
    assert [line.split(" px")[0].split()[-1] for line in lines] == ["256", "1024"]
    assert all("helper lanes -" in line and "quads -" in line for line in lines)
    assert_refused(
        harness("triangulate", "plate.glb", "--check", "-o", "new.glb"),
        "--check and -o are mutually exclusive",
    )
    assert [path.name for path in tmp_path.iterdir()] == ["plate.glb"]


def test_on_the_command_line(tmp_path, harness):
    solid().export(tmp_path / "plate.glb")
    told, _ = require_ok(harness("triangulate", "plate.glb", "-o", "out.glb"))
    assert "in 70 flat faces of two or more (100% of the area)" in told
    assert "out.glb: 2 faces get other diagonals" in told
    assert "No vertex changes" in told
    assert trimesh.load_mesh(tmp_path / "out.glb").is_watertight


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (("-o", "out.obj"), "the output must keep the input format (.glb)"),
        (("-o", "out.glb", "--limit", "3"), "--limit is for polygons"),
        (("-o", "out.glb", "--criterion", "mixed=1/2/0"), "choose from edge-length"),
        (("-o", "out.glb", "--criterion", "lenght"), "unknown criterion 'lenght'"),
        ((), "-o FILE is missing"),
    ],
)
def test_what_does_not_go_with_a_model(tmp_path, harness, more, reason):
    solid().export(tmp_path / "plate.glb")
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
    "WEIGHTS_0": lambda bump: np.stack([0.25 + bump / 8] * 4, axis=1).astype("<f4"),
}


@pytest.mark.parametrize("where", ["attributes", "targets"])
@pytest.mark.parametrize("name", ATTRIBUTES)
def test_a_face_is_turned_only_if_what_its_corners_carry_is_affine(tmp_path, out, name, where):
    if where == "targets" and name.startswith(("_", "JOINTS", "WEIGHTS")):
        name = "POSITION"
    for bump, wanted in ((0 * BUMP, CUT_SHORT), (BUMP, CUT_LONG)):
        builder = Builder(KITE, LONG)
        values = ATTRIBUTES.get(name, lambda bump: (KITE * [2, 3, 1] + bump[:, None]).astype("<f4"))
        added = {name: builder.accessor(values(bump))}
        if where == "attributes":
            builder.first["attributes"] |= added
        else:
            builder.first["targets"] = [added]
        done = retriangulate(builder.write(tmp_path / "kite.glb"), out)
        assert triangles_of(out) == [wanted]
        assert bool(done.changed) is (wanted is CUT_SHORT)


def test_what_skins_has_to_be_the_same_though_it_is_affine(out):
    builder = Builder(KITE, LONG)
    weights = np.stack([KITE[:, 0] / 18, 1 - KITE[:, 0] / 18, *2 * [0 * KITE[:, 0]]], axis=1)
    builder.first["attributes"]["WEIGHTS_0"] = builder.accessor(weights.astype("<f4"))
    assert triangles_after(builder, out) == [CUT_LONG]


@pytest.mark.parametrize(("steps", "wanted"), [(2, CUT_SHORT), (40, CUT_LONG)])
def test_how_far_a_face_may_be_bent(out, steps, wanted):
    bent = KITE.copy()
    bent[2, 2] = steps * single_precision_tolerance(KITE) / 4
    builder = Builder(bent, LONG)
    assert triangles_after(builder, out) == [wanted]


def test_an_arrowhead_is_left(out):
    arrow = KITE.copy()
    arrow[1] = (2, 0.5, 0)
    builder = Builder(arrow, [(1, 2, 3), (0, 1, 3)])
    assert triangles_after(builder, out) == [[[1, 2, 3], [0, 1, 3]]]


@pytest.mark.parametrize(
    ("mode", "indices"),
    [(5, [1, 0, 2, 3]), (6, [0, 1, 2, 3]), (6, None), (5, [1, 1, 0, 2, 3, 3])],
)
def test_strips_and_fans_become_lists_of_as_many_triangles(tmp_path, out, mode, indices):
    points = KITE[[0, 1, 2, 3]]
    builder = Builder(points, indices, mode=mode)
    if indices:
        builder.json["accessors"][1]["count"] = len(indices)
    before = triangles_of(builder.write(tmp_path / "kite.glb"))
    retriangulate(tmp_path / "kite.glb", out)
    (after,) = triangles_of(out)
    assert len(after) == len(before[0])
    assert sorted(each for each in after if len({*each}) == 3) == CUT_SHORT


def test_what_is_wound_the_other_way_stays_so(out):
    builder = Builder(KITE, LONG[:, ::-1])
    assert triangles_after(builder, out) == [CUT_SHORT]
    made = trimesh.load_mesh(out)
    assert (made.face_normals[:, 2] < 0).all()


def test_indices_that_two_primitives_share_are_kept_for_the_other(out):
    builder = Builder(KITE, LONG)
    bent = KITE.copy()
    bent[0, 2] = 1
    other = builder.primitive(bent, None)
    other["indices"] = builder.first["indices"]
    assert triangles_after(builder, out) == [CUT_SHORT, CUT_LONG]


def test_primitives_that_draw_the_same_stay_one(tmp_path, out):
    builder = Builder(KITE, LONG)
    builder.json["meshes"].append({"primitives": [dict(builder.first)]})
    source = builder.write(tmp_path / "kites.glb")
    retriangulate(source, out)
    assert triangles_of(out) == [CUT_SHORT]
    assert len(out.read_bytes()) == len(source.read_bytes())


@pytest.mark.parametrize("kind", ["image", "accessor", "overlap"])
def test_bytes_that_something_else_reads_are_not_overwritten(tmp_path, out, kind):
    builder = Builder(KITE, LONG)
    view = builder.json["accessors"][builder.first["indices"]]["bufferView"]
    if kind == "image":
        builder.json["images"] = [{"bufferView": view, "mimeType": "image/png"}]
    elif kind == "accessor":
        again = dict(builder.json["accessors"][builder.first["indices"]], count=4, type="SCALAR")
        builder.json["accessors"].append(again)
    else:
        builder.json["bufferViews"].append(dict(builder.json["bufferViews"][view], byteLength=4))
    source = builder.write(tmp_path / "kite.glb")
    place = builder.json["bufferViews"][view]
    retriangulate(source, out)
    assert triangles_of(out) == [CUT_SHORT]
    for path in (source, out):
        data = path.read_bytes()
        first = 28 + int.from_bytes(data[12:16], "little") + place["byteOffset"]
        assert np.frombuffer(data, "<u2", 6, first).tolist() == [0, 1, 2, 0, 2, 3]


def test_an_extension_of_a_primitive_that_is_not_known(tmp_path, out):
    for name, wanted in (("KHR_materials_variants", CUT_SHORT), ("CESIUM_outline", CUT_LONG)):
        builder = Builder(KITE, LONG, extensions={name: {}})
        done = retriangulate(builder.write(tmp_path / "kite.glb"), out)
        assert triangles_of(out) == [wanted]
        assert dict(done.left) == ({} if wanted is CUT_SHORT else {f"extension {name}": 1})


def test_two_sides_of_a_sheet_do_not_get_one_diagonal(tmp_path, out):
    """Watertight as it is: each edge has two triangles. Turned, the diagonal would have four."""
    builder = Builder(KITE, [*LONG, (1, 0, 3), (1, 3, 2)])
    source = builder.write(tmp_path / "sheet.glb")
    done = retriangulate(source, out)
    assert out.read_bytes() == source.read_bytes()
    assert done.left == {"a diagonal would also be an edge of other triangles": 1}


def test_of_two_parts_back_to_back_neither_is_turned_onto_the_other(tmp_path, out):
    builder = Builder(KITE, LONG)
    builder.primitive(KITE.copy(), LONG[:, ::-1])
    done = retriangulate(builder.write(tmp_path / "sheets.glb"), out)
    assert triangles_of(out) == [CUT_LONG, CUT_LONG]
    assert done.left == {"a diagonal would also be an edge of other triangles": 2}


def test_triangles_that_join_a_strip_are_no_neighbours(tmp_path, out):
    """They have two edges in the same place, which would make three with a face's."""
    joining = [(2, 2, 0), (0, 0, 2)]
    builder = Builder(KITE, [LONG[0], *joining, LONG[1]])
    retriangulate(builder.write(tmp_path / "joined.glb"), out)
    (rows,) = triangles_of(out)
    assert rows[1:3] == [sorted(each) for each in joining]
    assert [rows[0], rows[3]] == CUT_SHORT


SPOILT = {
    "a triangle twice": [*LONG, (0, 1, 2)],
    "an edge of three triangles": [*LONG, (0, 2, 1)],
    "a point": [(0, 1, 2), (0, 2, 2)],
}


@pytest.mark.parametrize("name", SPOILT)
def test_triangles_that_are_no_surface_stay(tmp_path, out, name):
    builder = Builder(KITE, SPOILT[name])
    source = builder.write(tmp_path / "spoilt.glb")
    retriangulate(source, out)
    assert out.read_bytes() == source.read_bytes()


def test_a_thin_triangle_and_a_place_that_is_no_number_stay(out):
    builder = Builder()
    middle = (KITE[1] + KITE[2]) / 2
    points = np.vstack([KITE, [middle, (np.nan, 0, 0)]]).astype("<f4")
    thin, nowhere = (2, 1, 4), (3, 2, 5)
    builder.primitive(points, [*LONG, thin, nowhere])
    assert triangles_after(builder, out) == [[*CUT_SHORT, sorted(thin), sorted(nowhere)]]


def test_no_triangle_gets_thin():
    """A corner on a straight edge, but for rounding: to cut it off would be the shortest."""
    points = np.array([(0, 0, 0), (4, 1e-6, 0), (8, 0, 0), (8, 6, 0), (0, 6, 0)], dtype=float)
    triangles = np.array([(0, 1, 4), (1, 3, 4), (1, 2, 3)])
    none = np.empty((5, 0))
    faces, _ = flat_faces(
        ModelMesh(points, triangles, none, none, single_precision_tolerance(points))
    )
    made = choose(faces, "edge-length").triangles
    assert not any({0, 1, 2} == set(row) for row in faces.vertices[made].tolist())


def test_where_optima_would_take_too_long_the_dearest_faces_get_flips(tmp_path, out, monkeypatch):
    """Of a plate's 70 faces the two large ones have holes."""
    source = tmp_path / "plate.glb"
    solid().export(source)
    every = retriangulate(source, out)
    assert every.optimal == 70
    # 68 quadrilaterals, and one of two faces with 68 corners and two holes
    for work, optimal in ((68 * 4**3 + 20 * 68**3, 69), (68 * 4**3, 68), (67 * 4**3, 67)):
        monkeypatch.setattr("harness.models.diagonals.MAX_WORK_NS", float(work))
        done = retriangulate(source, out)
        assert done.optimal == optimal
        assert done.changed == 2
        assert every.after <= done.after < 1.05 * every.after
        assert trimesh.load_mesh(out).is_watertight


@pytest.mark.parametrize("count", [65_535, 65_536])
def test_as_many_vertices_as_two_bytes_name(out, count):
    builder = Builder()
    points = np.zeros((count, 3), dtype="<f4")
    points[-4:] = KITE
    indices = (LONG + count - 4).astype("<u2" if count < 65_536 else "<u4").reshape(-1)
    primitive = builder.primitive(points, None)
    primitive["indices"] = builder.accessor(indices)
    assert triangles_after(builder, out) == [(np.array(CUT_SHORT) + count - 4).tolist()]


def test_sparse_positions_and_indices(out):
    builder = Builder(np.zeros_like(KITE), [(0, 1, 2), (0, 2, 0)])
    positions = builder.json["accessors"][builder.first["attributes"]["POSITION"]]
    del positions["bufferView"]
    rows, values = np.arange(4, dtype="<u2"), KITE
    positions["sparse"] = sparse(builder, rows, values)
    indices = builder.json["accessors"][builder.first["indices"]]
    indices["sparse"] = sparse(builder, np.array([5], "<u2"), np.array([3], "<u2"))
    assert triangles_after(builder, out) == [CUT_SHORT]


def sparse(builder: Builder, rows: np.ndarray, values: np.ndarray) -> dict[str, object]:
    return {
        "count": len(rows),
        "indices": {"bufferView": builder.view(rows.tobytes()), "componentType": 5123},
        "values": {"bufferView": builder.view(values.tobytes())},
    }


@pytest.mark.parametrize(
    ("number", "change", "reason"),
    [
        (0, {"count": 3}, "index 3 of 3 vertices"),
        (1, {"count": 7000}, "reaches beyond its buffer view"),
        (1, {"componentType": 4711}, "component type 4711 is unknown"),
        (1, {"bufferView": -1}, "-1 is not an index"),
        (1, {"count": 5}, "5 indices are not a multiple of 3"),
        (None, {}, "KHR_draco_mesh_compression is unsupported; unpack the model first"),
    ],
)
def test_a_damaged_model_is_refused_in_a_line(tmp_path, harness, number, change, reason):
    builder = Builder(KITE, LONG)
    if number is None:
        builder.json["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    else:
        builder.json["accessors"][number] |= change
    builder.write(tmp_path / "kite.glb")
    assert_refused(harness("triangulate", "kite.glb", "-o", "out.glb"), reason)
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.parametrize("content", [b"glTF", b"[]", b"{", b"glTF\2\0\0\0\x0c\0\0\0", b"null"])
def test_what_is_no_gltf(tmp_path, content):
    (tmp_path / "a.glb").write_bytes(content)
    with pytest.raises((HarnessError, SceneError)):
        retriangulate(tmp_path / "a.glb", tmp_path / "b.glb")


def test_gltf_with_a_buffer_beside_it(tmp_path):
    source = tmp_path / "a" / "plate.gltf"
    source.parent.mkdir()
    for name, data in trimesh.exchange.gltf.export_gltf(solid().scene()).items():
        (source.parent / name.replace("model", "plate")).write_bytes(data)
    before = (source.parent / "gltf_buffer_0.bin").read_bytes()
    done = retriangulate(source, source.with_name("other.gltf"))
    assert [path.name for path in done.files] == ["other.gltf", "other.gltf.0.bin"]
    made = trimesh.load_mesh(source.with_name("other.gltf"))
    assert made.is_watertight
    assert (source.parent / "gltf_buffer_0.bin").read_bytes() == before
    (tmp_path / "b").mkdir()
    with pytest.raises(UsageError, match="copy it first"):
        retriangulate(source, tmp_path / "b" / "other.gltf")
