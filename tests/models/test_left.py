"""Faces and parts that stay unchanged are counted by reason; OBJ keeps all other text."""

import numpy as np
import pytest

from harness.errors import UsageError
from harness.models.in_place import Changes, retriangulate
from scenes import SceneError
from scenes.readers.gltf import GltfFile
from tests.models.build import KITE, LONG, Builder

BLENDED = "with a blended material the order of triangles is visible"


def of_gltf(builder: Builder, folder) -> Changes:
    return retriangulate(builder.write(folder / "a.glb"), folder / "b.glb")


def of_text(text: str, folder) -> tuple[Changes, str]:
    source, out = folder / "a.obj", folder / "b.obj"
    source.write_text(text)
    return retriangulate(source, out), out.read_text()


@pytest.mark.parametrize("by", ["material", "variant"])
def test_triangles_of_a_blended_material_keep_their_order(tmp_path, by):
    for mode, unchanged in (("BLEND", {BLENDED: 1}), ("MASK", {})):
        builder = Builder()
        builder.json["materials"] = [{}, {"alphaMode": mode}]
        more = {"material": 1}
        if by == "variant":
            mappings = [{"material": 1, "variants": [0]}]
            more = {"material": 0, "extensions": {"KHR_materials_variants": {"mappings": mappings}}}
        builder.primitive(KITE, LONG, **more)
        assert of_gltf(builder, tmp_path).unchanged == unchanged


def test_equal_primitives_are_unchanged_if_one_is_blended(tmp_path):
    builder = Builder()
    builder.json["materials"] = [{}, {"alphaMode": "BLEND"}]
    first = builder.primitive(KITE, LONG, material=1)
    builder.json["meshes"].append({"primitives": [{**first, "material": 0}]})
    assert of_gltf(builder, tmp_path).unchanged == {BLENDED: 1}


def test_indices_to_which_an_extension_of_the_mesh_refers_stay(tmp_path):
    builder = Builder()
    indices = builder.primitive(KITE, LONG)["indices"]
    extensions = {"EXT_mesh_manifold": {"manifoldPrimitive": {"indices": indices}}}
    builder.json["meshes"][0]["extensions"] = extensions
    assert of_gltf(builder, tmp_path).unchanged == {"extension EXT_mesh_manifold": 1}
    written = GltfFile(tmp_path / "b.glb").read_array(indices)
    assert written.ravel().tolist() == LONG.ravel().tolist()


POINTS = "v 0 0 0\nv 2 -1 0\nv 9 0 0\nv 2 1 0\nv 9 9 9\nvn 0 0 1\n"
FACES = ("f 1 2 3\n", "f 1 3 4\n")


@pytest.mark.parametrize(
    "word", ["usemap", "mg", "lod", "bevel", "c_interp", "d_interp", "shadow_obj", "trace_obj"]
)
def test_obj_state_lines_delimit_parts(tmp_path, word):
    faces = f"{word} a\n{FACES[0]}{word} b\n{FACES[1]}"
    assert of_text(POINTS + faces, tmp_path)[0].changed == 0
    assert of_text(POINTS + "".join(FACES), tmp_path)[0].changed == 1


SMOOTH = {"smooth, without normals in the file": 1}


@pytest.mark.parametrize(
    ("extra_text", "unchanged"),
    [
        ("s 1\n{}f 3 4 5\n", SMOOTH),
        ("s on\nusemtl a\n{}usemtl b\nf 3 4 5 1\n", SMOOTH),
        ("s 1\n{}f 3 4 \\\n5\n", SMOOTH),
        ("s 1\n{}", {}),
        ("s off\n{}f 3 4 5\n", {}),
        ("s 1\n{}s 0\nf 3 4 5\n", {}),
        ("{}f 3 4 5\n", {}),
        ("s 1\nf 1//1 2//1 3//1\nf 1//1 3//1 4//1\nf 3//1 4//1 5//1\n", {}),
    ],
)
def test_smooth_obj_faces_without_normals_are_unchanged(tmp_path, extra_text, unchanged):
    done, _ = of_text(POINTS + extra_text.format("".join(FACES)), tmp_path)
    several = "faces that are not triangles, or on several lines"
    done.unchanged.pop(several, None)
    assert (done.unchanged, done.changed) == (unchanged, not unchanged)


def test_unchanged_faces_are_counted_by_reason(tmp_path):
    points = np.vstack([KITE, [(KITE[1] + KITE[2]) / 2, (np.nan, 0, 0), (0, 0, 3), (0, 0, -3)]])
    fins = [(0, 1, 6), (0, 1, 7)]
    triangles = [*LONG, *fins, (2, 1, 4), (3, 2, 5), (0, 0, 3)]
    builder = Builder(points.astype("<f4"), triangles)
    assert of_gltf(builder, tmp_path).unchanged == {
        "triangles too thin, or with invalid coordinates": 2,
        "edges with more than two triangles": 1,
    }
    faces = "f 1 2 3 4\nf 1 2 \\\n5\nf 1 3 4\n"
    done, after = of_text(POINTS + faces, tmp_path)
    assert done.unchanged == {"faces that are not triangles, or on several lines": 2}
    assert after == POINTS + faces


@pytest.mark.parametrize(("kind", "normalized"), [("<u2", False), ("<u2", True), ("u1", True)])
@pytest.mark.parametrize("bump", [0, 1])
def test_integer_texture_coordinates_must_be_exactly_affine(tmp_path, kind, normalized, bump):
    values = np.stack([KITE[:, 0] * 3, KITE[:, 1] + 2 + [0, 0, 0, bump]], axis=1).astype(kind)
    builder = Builder(KITE, LONG)
    builder.first["attributes"]["TEXCOORD_0"] = builder.accessor(values, normalized=normalized)
    assert of_gltf(builder, tmp_path).changed == 1 - bump


def test_normalized_texture_coordinates_may_be_rounded_to_their_last_bit(tmp_path):
    builder = Builder(KITE, LONG)
    values = np.rint(np.stack([KITE[:, 0] * 45001 / 9, KITE[:, 1] * 3000 + 9000], axis=1))
    builder.first["attributes"]["TEXCOORD_0"] = builder.accessor(values.astype("<u2"), True)
    assert of_gltf(builder, tmp_path).changed == 1


def test_integer_displacements_must_be_affine(tmp_path):
    for bump in (0, 1):
        moved = (KITE + [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, bump]]).astype("<i2")
        builder = Builder(KITE, LONG)
        builder.first["targets"] = [{"POSITION": builder.accessor(moved)}]
        assert of_gltf(builder, tmp_path).changed == 1 - bump


@pytest.mark.parametrize(("size", "rise", "flat"), [(1, 2, 0), (1, 0, 1), (1500, 2, 1)])
def test_integer_position_tolerance_is_relative_to_the_size(tmp_path, size, rise, flat):
    builder = Builder()
    roof = np.array([(0, 0, 0), (9, -6, 0), (20, 0, 0), (9, 6, 0)]) * size
    roof[2, 2] = rise
    builder.primitive(roof.astype("<i2"), LONG)
    assert of_gltf(builder, tmp_path).changed == flat


ROOF = [(0, 0, 0), (30, -20, 0), (80, 0, 1.5), (30, 20, 0)]


def test_a_roof_in_map_coordinates_is_bent(tmp_path):
    """Single precision is off by half a unit there, but OBJ numbers are decimal texts."""
    for rise, flat in ((1, 0), (0, 1)):
        points = np.array(ROOF) * [1, 1, rise] + (385000, 6672000, 0)
        lines = ["v {:.3f} {:.3f} {:.3f}\n".format(*row) for row in points.tolist()]
        assert of_text("".join(lines) + "f 1 2 3\nf 1 3 4\n", tmp_path)[0].changed == flat


STRAY = np.vstack([np.array(ROOF), [(3e6, 0, 0)]])


def test_unused_vertices_do_not_affect_the_tolerance(tmp_path):
    for points in (STRAY.astype("<f4"), np.minimum(STRAY, 30000).astype("<i2")):
        builder = Builder(points, LONG)
        assert of_gltf(builder, tmp_path).changed == 0
    maps = np.vstack([KITE[:, :2], [(3e6, 0)]])
    maps[3, 1] += 0.1
    builder = Builder(np.vstack([KITE, KITE[:1]]), LONG)
    builder.first["attributes"]["TEXCOORD_0"] = builder.accessor(maps.astype("<f4"))
    assert of_gltf(builder, tmp_path).changed == 0


OBJ = """# a kite
mtllib paint.mtl
v 0 0 0
v 2 -1 0
v 9 0 0
v 2 1 0
vt 0 0
vt 0.2 0.4
vt 0.9 2.25
vt 0.2 0.6
vn 0 0 1
o kite
usemtl red
f 1/1/1 2/2/1 3/3/1
f -4/-4/-1 -2/-2/-1 -1/-1/-1 # the other half
l 1 2
"""


def test_obj_keeps_other_lines_and_vertex_triples(tmp_path):
    before, after = OBJ.splitlines(), of_text(OBJ, tmp_path)[1].splitlines()
    assert before[:13] + before[15:] == after[:13] + after[15:]
    assert after[13] == "f 4/4/1 1/1/1 2/2/1"
    assert after[14] == "f 4/4/1 2/2/1 3/3/1 # the other half"


def obj_with(old: str, new: str) -> str:
    assert old in OBJ
    return OBJ.replace(old, new)


@pytest.mark.parametrize(
    "content",
    [
        obj_with("vt 0 0", "vt 0 0.1"),  # the map is not affine
        obj_with("f -4", "usemtl blue\nf -4"),
        obj_with("f -4", "s 2\nf -4"),
        obj_with("f -4/-4/-1", "f -4/-4"),  # a corner without a normal is a different vertex
        obj_with("v 9 0 0", "v 9 0 0.1"),
        obj_with("v 2 1 0", "v 2 1 0.001"),
        obj_with("f 1/1/1 2/2/1 3/3/1", "f 1/1/1 2/2/1 \\\n3/3/1"),
        # A step of 1 in the texts is not the tolerance: this roof rises by 1.
        "v 0 0 0\nv 9 -3 0\nv 20 0 1\nv 9 3 0\nf 1 2 3\nf 1 3 4\n",
    ],
)
def test_obj_faces_that_stay_unchanged(tmp_path, content):
    assert of_text(content, tmp_path)[1] == content


@pytest.mark.parametrize(("height", "flat"), [("0.0002", True), ("0.00020", False)])
def test_decimals_of_obj_coordinates_set_the_tolerance(tmp_path, height, flat):
    roof = f"v 0 0 0\nv 90 -30 0\nv 200 0 {height}\nv 90 30 0\nf 1 2 3\nf 1 3 4\n"
    assert of_text(roof, tmp_path)[0].changed == flat


def test_thin_triangles_are_no_optimum(tmp_path):
    """The shorter diagonal would cut off a triangle that is thinner than the tolerance allows."""
    kite = "v 0 0 0\nv 1 -0.{} 0\nv 2 0 0\nv 1 5 0\nf 1 2 4\nf 2 3 4\n"
    assert [of_text(kite.format(d), tmp_path)[0].changed for d in ("000002", "000009")] == [0, 1]


@pytest.mark.parametrize("line", ["f 1 2 9", "f 1 2 x", "v 1 2", "f 0 1 2", "vt a", "f //1 2 3"])
def test_invalid_obj_is_refused(tmp_path, line):
    with pytest.raises(SceneError, match=r"^\S+ line 17: not OBJ|^\S+: .* refers to v line 9"):
        of_text(f"{OBJ}{line}\n", tmp_path)


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".off"])
def test_models_of_other_formats_are_refused(tmp_path, suffix):
    source = tmp_path / f"kite{suffix}"
    source.write_bytes(b"ply")
    for out in (None, tmp_path / f"out{suffix}", tmp_path / "out.obj"):
        with pytest.raises(UsageError, match=r"kite\.\w+: unsupported model format; export"):
            retriangulate(source, out)
