"""What counts as flat and affine: of whole numbers, far from 0, beside vertices that none uses."""

from __future__ import annotations

import numpy as np
import pytest

from harness.models.in_place import retriangulate
from tests.models.build import KITE, LONG, Builder


def changed(builder: Builder, folder) -> int:
    return retriangulate(builder.write(folder / "a.glb"), folder / "b.glb").changed


def carrying(name: str, values: np.ndarray, normalized: bool = False) -> Builder:
    builder = Builder()
    primitive = builder.primitive(KITE, LONG)
    primitive["attributes"][name] = builder.accessor(values, normalized=normalized)
    return builder


@pytest.mark.parametrize(("kind", "normalized"), [("<u2", False), ("<u2", True), ("u1", True)])
@pytest.mark.parametrize("bump", [0, 1])
def test_whole_texture_coordinates_have_to_be_affine_to_the_last_bit(
    tmp_path, kind, normalized, bump
):
    values = np.stack([KITE[:, 0] * 3, KITE[:, 1] + 2 + [0, 0, 0, bump]], axis=1).astype(kind)
    builder = carrying("TEXCOORD_0", values, normalized)
    assert changed(builder, tmp_path) == 1 - bump


def test_whole_displacements_have_to_be_affine(tmp_path):
    for bump in (0, 1):
        builder = Builder()
        moved = (KITE + [[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, bump]]).astype("<i2")
        builder.primitive(KITE, LONG, targets=[{"POSITION": builder.accessor(moved)}])
        assert changed(builder, tmp_path) == 1 - bump


@pytest.mark.parametrize(("size", "rise", "flat"), [(1, 2, 0), (1, 0, 1), (1500, 2, 1)])
def test_a_unit_of_whole_positions_counts_only_where_it_is_small(tmp_path, size, rise, flat):
    builder = Builder()
    roof = np.array([(0, 0, 0), (9, -6, 0), (20, 0, 0), (9, 6, 0)]) * size
    roof[2, 2] = rise
    builder.primitive(roof.astype("<i2"), LONG)
    assert changed(builder, tmp_path) == flat


ROOF = [(0, 0, 0), (30, -20, 0), (80, 0, 1.5), (30, 20, 0)]
FAR = (385000, 6672000, 0)


def far(rise: float) -> np.ndarray:
    return np.array(ROOF) * [1, 1, rise] + FAR


def obj(points: np.ndarray) -> bytes:
    lines = ["v {:.3f} {:.3f} {:.3f}".format(*row) for row in points.tolist()]
    return "\n".join([*lines, "f 1 2 3", "f 1 3 4", ""]).encode()


def test_a_roof_in_map_coordinates_is_bent(tmp_path):
    """Single precision is off by half a unit there, but these are no single numbers."""
    source = tmp_path / "roof.obj"
    for rise, flat in ((1, 0), (0, 1)):
        source.write_bytes(obj(far(rise)))
        done = retriangulate(source, source.with_stem("out"))
        assert done.changed == flat


STRAY = np.vstack([np.array(ROOF), [(3e6, 0, 0)]])


def test_a_vertex_that_no_triangle_uses_is_no_measure(tmp_path):
    for points in (STRAY.astype("<f4"), np.minimum(STRAY, 30000).astype("<i2")):
        builder = Builder()
        builder.primitive(points, LONG)
        assert changed(builder, tmp_path) == 0
    maps = np.vstack([KITE[:, :2], [(3e6, 0)]])
    maps[3, 1] += 0.1
    builder = Builder()
    primitive = builder.primitive(np.vstack([KITE, KITE[:1]]), LONG)
    primitive["attributes"]["TEXCOORD_0"] = builder.accessor(maps.astype("<f4"))
    assert changed(builder, tmp_path) == 0
