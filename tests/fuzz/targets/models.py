"""Flat faces of a model get other diagonals: whatever is in a file, it is done right or refused."""

import functools
import io
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import trimesh
from hypothesis import strategies as st

from harness.errors import HarnessError
from harness.models.in_place import retriangulate
from scenes import SceneError
from tests.fuzz.damage import byte_edit, edit_bytes
from tests.fuzz.target import target

KINDS = ("glb", "obj")


@functools.cache
def bracket(kind: str) -> bytes:
    """A plate with two holes, askew, as a file."""
    shape = shapely.box(0, 0, 9, 5).difference(shapely.Point(2, 2).buffer(1, quad_segs=4))
    shape = shape.difference(shapely.box(5, 1, 8, 3))
    made = trimesh.creation.extrude_polygon(shape, 0.5, engine="earcut")
    made.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]))
    data = made.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


edits = st.lists(byte_edit, min_size=1, max_size=4)


@target("spoilt-model", st.fixed_dictionaries({"kind": st.sampled_from(KINDS), "edits": edits}))
def check_spoilt(value: dict[str, Any]) -> None:
    kind = value["kind"]
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder, f"a.{kind}"), Path(folder, f"b.{kind}")
        file.write_bytes(bracket(kind))
        edit_bytes(file, value["edits"])
        try:
            done = retriangulate(file, out)
        except (HarnessError, SceneError):
            assert not out.exists()
            return
        again = retriangulate(out, None)
        assert again.triangles == done.triangles
        assert np.isclose(again.area, done.area, rtol=1e-5, equal_nan=True)


corner = st.tuples(st.integers(-64, 64), st.integers(-64, 64))
face = st.fixed_dictionaries(
    {
        "points": st.lists(corner, min_size=4, max_size=12, unique=True),
        "turn": st.integers(0, 2**32 - 1),
        "kind": st.sampled_from(KINDS),
    }
)


@target("model-face", face)
def check_face(value: dict[str, Any]) -> None:
    """A Delaunay triangulation of points at random, extruded by nothing: interior vertices stay."""
    given = shapely.MultiPoint(value["points"])
    if given.convex_hull.area == 0:
        return
    cells = [each for each in shapely.delaunay_triangles(given).geoms if each.area > 0]
    points = np.array(value["points"], dtype=float)
    number = {tuple(point): at for at, point in enumerate(points.tolist())}
    rows = [[number[at] for at in list(each.exterior.coords)[:3]] for each in cells]
    generator = np.random.default_rng(value["turn"])
    frame = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    spatial = np.column_stack([points, np.zeros(len(points))]) @ frame.T
    model = trimesh.Trimesh(spatial, rows, process=False)
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder, f"a.{value['kind']}"), Path(folder, f"b.{value['kind']}")
        model.export(file)
        done = retriangulate(file, out)
        before, after = (
            trimesh.load(io.BytesIO(path.read_bytes()), file_type=value["kind"], force="mesh")
            for path in (file, out)
        )
    assert len(after.faces) == len(before.faces) == done.triangles
    assert np.isclose(after.area, before.area, rtol=1e-4)
    assert done.after <= done.before * (1 + 1e-9)
    assert len(after.facets_boundary) == len(before.facets_boundary)
