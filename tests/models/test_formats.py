"""OBJ: triangles change in place, everything else stays."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.errors import UsageError
from harness.models.in_place import retriangulate
from scenes import SceneError
from tests.models.various import solid

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


class Obj:
    """An OBJ file as a parser of this test's own reads it: it shares no line with the product's."""

    def __init__(self, text: str) -> None:
        self.other, self.faces, self.points = [], [], []
        part = 0
        for line in text.splitlines():
            words = line.split("#")[0].split()
            if words[:1] == ["f"]:
                self.faces.append((part, [self._place(word) for word in words[1:]]))
                continue
            self.other.append((len(self.faces), line))
            if words[:1] == ["v"]:
                self.points.append([float(word) for word in words[1:4]])
            elif words[:1] in (["g"], ["o"], ["usemtl"], ["s"]):
                part += 1

    def _place(self, word: str) -> tuple[int, ...]:
        own = int(word.split("/")[0])
        return (own - 1 if own > 0 else len(self.points) + own, *map(int, word.split("/")[1:]))

    def areas(self) -> dict[tuple[int, tuple[float, ...]], float]:
        """The area that each part has in each plane."""
        found: dict[tuple[int, tuple[float, ...]], float] = {}
        for part, corners in self.faces:
            a, b, c = (np.array(self.points[corner[0]]) for corner in corners)
            normal = np.cross(b - a, c - a)
            unit = normal / np.linalg.norm(normal)
            plane = (part, tuple(np.round([*unit, unit @ a], 3) + 0.0))
            found[plane] = found.get(plane, 0.0) + np.linalg.norm(normal) / 2
        return found


@pytest.mark.parametrize("parts", [1, 3])
def test_obj_in_place_compared_by_another_parser(tmp_path, parts):
    source, out = tmp_path / "a.obj", tmp_path / "b.obj"
    moved = [solid(0.0).apply_translation([0, 0, 9 * number]) for number in range(parts)]
    lines, first = [], 1
    for number, mesh in enumerate(moved):
        lines += [f"o part{number}", *(f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices)]
        lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + first]
        first += len(mesh.vertices)
    source.write_text("\n".join(lines) + "\n")
    done = retriangulate(source, out)
    before, after = Obj(source.read_text()), Obj(out.read_text())
    assert done.changed == 2 * parts
    assert before.other == after.other
    assert len(before.faces) == len(after.faces)
    assert [part for part, _ in before.faces] == [part for part, _ in after.faces]
    assert before.areas().keys() == after.areas().keys()
    for plane, area in before.areas().items():
        assert after.areas()[plane] == pytest.approx(area, rel=1e-6)
    edges = [Counter(), Counter()]
    for counted, each in zip(edges, (before, after), strict=True):
        for _, (a, b, c) in each.faces:
            counted.update([(a, b), (b, c), (c, a)])
    for counted in edges:  # watertight, and each side is gone along once in either direction
        assert set(counted.values()) == {1}
        assert all((b, a) in counted for a, b in counted)
    assert len(set(edges[0]) - set(edges[1])) > 10 * parts
