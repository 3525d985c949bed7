"""OBJ: triangles change in place, everything else stays."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.errors import UsageError
from harness.models.in_place import retriangulate
from scenes import SceneError

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


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".off"])
def test_models_of_other_formats_are_refused(tmp_path, suffix):
    source = tmp_path / f"kite{suffix}"
    source.write_bytes(b"ply")
    for out in (None, tmp_path / f"out{suffix}", tmp_path / "out.obj"):
        with pytest.raises(UsageError, match=r"kite\.\w+: models are read as \.glb, \.gltf, \.obj"):
            retriangulate(source, out)


@settings(max_examples=60)
@given(place=st.integers(0, 4000), value=st.integers(0, 255), cut=st.integers(0, 300))
def test_changed_bytes_are_read_or_refused(tmp_path_factory, place, value, cut):
    folder = tmp_path_factory.mktemp("damaged")
    name, data = "kite.obj", bytearray(OBJ.format(end="2.25").encode())
    data[place % len(data)] = value
    (folder / name).write_bytes(data[: max(1, len(data) - cut // 3 * (cut % 3 == 0))])
    try:
        retriangulate(folder / name, folder / f"out-{name}")
    except (UsageError, SceneError):
        assert not (folder / f"out-{name}").exists()
