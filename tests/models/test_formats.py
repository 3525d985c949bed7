"""OBJ, PLY and STL: triangles change in place, everything else stays."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.errors import UsageError
from harness.models.in_place import retriangulate
from scenes import SceneError
from tests.models.build import KITE, LONG

OBJ = """# a kite
mtllib paint.mtl
v 0 0 0
v 2 -1 0
v 9 0 0
v 2 1 0
vt 0 0
vt 0.2 0.4
vt 0.9 {end}
vt 0.2 0.6
vn 0 0 1
o kite
usemtl red
f 1/1/1 2/2/1 3/3/1
f -4/-4/-1 -2/-2/-1 -1/-1/-1 # the other half
l 1 2
"""


def changed(tmp_path, name: str, content: str | bytes) -> tuple[list[str], list[str]]:
    """Return the lines of a model before and after."""
    source, out = tmp_path / name, tmp_path / f"out-{name}"
    source.write_bytes(content.encode() if isinstance(content, str) else content)
    retriangulate(source, out)
    return [path.read_text(errors="replace").splitlines() for path in (source, out)]


def test_obj_keeps_all_other_lines_and_the_triples(tmp_path):
    before, after = changed(tmp_path, "kite.obj", OBJ.format(end="2.25"))
    assert before[:13] + before[15:] == after[:13] + after[15:]
    assert after[13] == "f 4/4/1 1/1/1 2/2/1"
    assert after[14] == "f 4/4/1 2/2/1 3/3/1 # the other half"


def obj_with(old: str, new: str, end: str = "2.25") -> str:
    assert old in OBJ
    return OBJ.format(end=end).replace(old, new)


@pytest.mark.parametrize(
    "content",
    [
        obj_with("vt 0 0", "vt 0 0.1"),  # the map is not affine
        obj_with("f -4", "usemtl blue\nf -4"),
        obj_with("f -4", "s 2\nf -4"),
        obj_with("f -4/-4/-1", "f -4/-4"),  # one corner without a normal is another vertex
        obj_with("v 9 0 0", "v 9 0 0.1"),
        obj_with("v 2 1 0", "v 2 1 0.001"),
        obj_with("f 1/1/1 2/2/1 3/3/1", "f 1/1/1 2/2/1 \\\n3/3/1"),
    ],
)
def test_obj_that_is_left(tmp_path, content):
    before, after = changed(tmp_path, "kite.obj", content)
    assert before == after


def test_obj_of_whole_numbers_is_not_taken_for_flat_because_they_are_short(tmp_path):
    """A step of 1 in the texts is no tolerance: this roof rises by 1."""
    roof = "v 0 0 0\nv 9 -3 0\nv 20 0 1\nv 9 3 0\nf 1 2 3\nf 1 3 4\n"
    before, after = changed(tmp_path, "roof.obj", roof)
    assert before == after


@pytest.mark.parametrize("line", ["f 1 2 9", "f 1 2 x", "v 1 2", "f 0 1 2", "vt a", "f //1 2 3"])
def test_obj_that_is_none(tmp_path, line):
    with pytest.raises(SceneError, match=r"is not OBJ|as a model"):
        changed(tmp_path, "kite.obj", OBJ.format(end="2.25") + line + "\n")


PLY = """ply
format ascii 1.0
comment a kite
element vertex 4
property float x
property float y
property float z
property uchar red
property int label
element face 2
property list uchar int vertex_indices
property uchar red
end_header
0 0 0 10 7
2 -1 0 10 7
9 0 0 10 {label}
2 1 0 {red} 7
3 0 1 2 200
3 0 2 3  {face}
"""


@pytest.mark.parametrize(
    ("label", "red", "face", "turned"),
    [(7, 10, 200, True), (8, 10, 200, False), (7, 20, 200, False), (7, 10, 201, False)],
)
def test_ply_text(tmp_path, label, red, face, turned):
    content = PLY.format(label=label, red=red, face=face)
    before, after = changed(tmp_path, "kite.ply", content)
    assert before[:17] == after[:17]
    wanted = ["3 3 0 1 200", f"3 3 1 2  {face}"] if turned else before[17:]
    assert after[17:] == wanted


@pytest.mark.parametrize("order", ["little", "big"])
def test_ply_binary(tmp_path, order):
    mark = "<" if order == "little" else ">"
    head = PLY.partition("end_header\n")[0].replace("ascii", f"binary_{order}_endian")
    vertices = b"".join(struct.pack(f"{mark}3fBi", *row, 10, 7) for row in KITE.tolist())
    faces = [struct.pack(f"{mark}B3iB", 3, *row, 200) for row in LONG.tolist()]
    whole = (head + "end_header\n").encode() + vertices + b"".join(faces)
    source, out = tmp_path / "kite.ply", tmp_path / "out.ply"
    source.write_bytes(whole)
    retriangulate(source, out)
    data = out.read_bytes()
    assert len(data) == len(whole)
    place = len(whole) - 2 * len(faces[0])
    assert data[:place] == whole[:place]
    rows = list(struct.iter_unpack(f"{mark}B3iB", data[place:]))
    assert [sorted(row[1:4]) for row in rows] == [[0, 1, 3], [1, 2, 3]]
    assert all((row[0], row[4]) == (3, 200) for row in rows)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("element face 2", "element face 3", "2 of 3 lines"),
        ("3 0 2 3", "4 0 1 2 3", "no triangles"),
        ("3 0 2 3", "3 0 2 4", "index 4 of 4"),
        ("vertex_indices", "corners", "its faces have no vertex_indices"),
        ("ply\n", "plx\n", "no header"),
        ("property uchar red\nend", "property list uchar float uv\nend", "a list of uv"),
    ],
)
def test_ply_that_is_none(tmp_path, old, new, reason):
    content = PLY.format(label=7, red=10, face=200)
    assert old in content
    if "uv" in new:
        content = content.replace("ascii", "binary_little_endian")
    with pytest.raises(SceneError, match=reason):
        changed(tmp_path, "kite.ply", content.replace(old, new))


def stl_of(attributes: tuple[int, int]) -> bytes:
    rows = [
        struct.pack("<3f", 0, 0, 1) + KITE[row].tobytes() + struct.pack("<H", attribute)
        for row, attribute in zip(LONG, attributes, strict=True)
    ]
    return b"a kite".ljust(80) + struct.pack("<I", 2) + b"".join(rows)


@pytest.mark.parametrize(("attributes", "turned"), [((3, 3), True), ((3, 4), False)])
def test_stl_binary(tmp_path, attributes, turned):
    source, out = tmp_path / "kite.stl", tmp_path / "out.stl"
    source.write_bytes(stl_of(attributes))
    done = retriangulate(source, out)
    before, after = source.read_bytes(), out.read_bytes()
    assert (len(before), before[:84]) == (len(after), after[:84])
    assert bool(done.changed) is turned is (before != after)
    for place, attribute in zip((84, 134), attributes, strict=True):
        assert after[place : place + 12] == before[place : place + 12]  # the normal
        assert after[place + 48 : place + 50] == struct.pack("<H", attribute)


def test_stl_text(tmp_path):
    corners = [[f"    vertex {' '.join(f'{x:.1e}' for x in KITE[i])}" for i in row] for row in LONG]
    lines = ["solid kite"]
    for three in corners:
        lines += ["  facet normal 0 0 1", "   outer loop", *three, "   endloop", "  endfacet"]
    before, after = changed(tmp_path, "kite.stl", "\n".join([*lines, "endsolid kite"]))
    keep = [number for number, line in enumerate(before) if "vertex" not in line]
    assert [before[number] for number in keep] == [after[number] for number in keep]
    assert before != after
    assert sorted(set(before)) == sorted(set(after))  # no number is written anew


def test_stl_cut_off(tmp_path):
    (tmp_path / "kite.stl").write_bytes(stl_of((1, 1))[:-7])
    with pytest.raises((UsageError, SceneError)):
        retriangulate(tmp_path / "kite.stl", tmp_path / "out.stl")


WHOLE = {
    "kite.obj": OBJ.format(end="2.25").encode(),
    "kite.ply": PLY.format(label=7, red=10, face=200).encode(),
    "kite.stl": stl_of((1, 1)),
}


@pytest.mark.parametrize("name", WHOLE)
@settings(max_examples=60)
@given(place=st.integers(0, 4000), value=st.integers(0, 255), cut=st.integers(0, 300))
def test_changed_bytes_are_read_or_refused(tmp_path_factory, name, place, value, cut):
    folder = tmp_path_factory.mktemp("damaged")
    data = bytearray(WHOLE[name])
    data[place % len(data)] = value
    (folder / name).write_bytes(data[: max(1, len(data) - cut // 3 * (cut % 3 == 0))])
    try:
        retriangulate(folder / name, folder / f"out-{name}")
    except (UsageError, SceneError):
        assert not (folder / f"out-{name}").exists()
