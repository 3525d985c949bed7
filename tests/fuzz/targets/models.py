"""Retriangulation of models: any file is processed correctly or refused."""

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
from tests.fuzz.damage import byte_edits, edit_file_bytes
from tests.fuzz.target import target

KINDS = ("glb", "obj")


@functools.cache
def export_bracket(kind: str) -> bytes:
    shape = shapely.box(0, 0, 9, 5).difference(shapely.Point(2, 2).buffer(1, quad_segs=4))
    shape = shape.difference(shapely.box(5, 1, 8, 3))
    mesh = trimesh.creation.extrude_polygon(shape, 0.5, engine="earcut")
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3]))
    data = mesh.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


edits = st.lists(byte_edits, min_size=1, max_size=4)


@target("damaged-model", st.fixed_dictionaries({"kind": st.sampled_from(KINDS), "edits": edits}))
def check_damaged(value: dict[str, Any]) -> None:
    kind = value["kind"]
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder, f"a.{kind}"), Path(folder, f"b.{kind}")
        file.write_bytes(export_bracket(kind))
        edit_file_bytes(file, value["edits"])
        try:
            result = retriangulate(file, out)
        except (HarnessError, SceneError):
            assert not out.exists()
            return
        check = retriangulate(out, None)
        assert check.triangles == result.triangles
        assert np.isclose(check.area, result.area, rtol=1e-5, equal_nan=True)


corner = st.tuples(st.integers(-64, 64), st.integers(-64, 64))
face = st.fixed_dictionaries(
    {
        "points": st.lists(corner, min_size=4, max_size=12, unique=True),
        "seed": st.integers(0, 2**32 - 1),
        "kind": st.sampled_from(KINDS),
    }
)


@target("model-face", face)
def check_face(value: dict[str, Any]) -> None:
    """Check a flat Delaunay triangulation of random points, which has interior vertices."""
    points_shape = shapely.MultiPoint(value["points"])
    if points_shape.convex_hull.area == 0:
        return
    cells = [cell for cell in shapely.delaunay_triangles(points_shape).geoms if cell.area > 0]
    points = np.array(value["points"], dtype=float)
    index_of = {tuple(point): index for index, point in enumerate(points.tolist())}
    rows = [[index_of[point] for point in list(cell.exterior.coords)[:3]] for cell in cells]
    generator = np.random.default_rng(value["seed"])
    frame = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    spatial = np.column_stack([points, np.zeros(len(points))]) @ frame.T
    model = trimesh.Trimesh(spatial, rows, process=False)
    with tempfile.TemporaryDirectory() as folder:
        file, out = Path(folder, f"a.{value['kind']}"), Path(folder, f"b.{value['kind']}")
        model.export(file)
        result = retriangulate(file, out)
        before, after = (
            trimesh.load(io.BytesIO(path.read_bytes()), file_type=value["kind"], force="mesh")
            for path in (file, out)
        )
    assert len(after.faces) == len(before.faces) == result.triangles
    assert np.isclose(after.area, before.area, rtol=1e-4)
    assert result.after <= result.before * (1 + 1e-9)
    assert len(after.facets_boundary) == len(before.facets_boundary)
