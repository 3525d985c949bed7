"""`triangulate --polygons`: rings of polygons in glTF, in the draft extension EXT_mesh_polygon."""

import json
from itertools import pairwise

import numpy as np
import pytest
import shapely

from harness.errors import UsageError
from harness.export.export import export_file
from scenes import SceneError, load
from scenes.readers.gltf import POLYGONS, RESTART, GltfFile, read_polygons
from tests.conftest import assert_refused
from triangulators import names

COURTYARD = shapely.box(0, 0, 8, 8).difference(
    shapely.unary_union([shapely.box(1, 1, 3, 3), shapely.box(5, 5, 7, 7)])
)
STRAIGHT = shapely.Polygon([(10, 0), (12, 0), (14, 0), (14, 4), (10, 4)])
"""A vertex in the middle of a straight side."""

TOUCHING = shapely.Polygon(
    [(20, 0), (24, 0), (24, 4), (22, 4), (20, 4)], [[(22, 4), (21, 2), (23, 2)]]
)
"""A hole with a vertex of the exterior, in the middle of a straight side."""

ON_EDGE = shapely.Polygon([(30, 0), (34, 0), (34, 4), (30, 4)], [[(32, 4), (31, 2), (33, 2)]])
REPEATED = shapely.Polygon([(40, 0), (44, 0), (44, 0), (42, 3), (40, 0)])
WITH_JUNCTIONS = {"ear-clipping", "earcut-refine", "flips"}
"""Triangulators that leave out a vertex of polygons 2 and 3: the flips start from ear clipping."""

SHAPES = (COURTYARD, STRAIGHT, TOUCHING, ON_EDGE, REPEATED.reverse())


@pytest.fixture
def shapes(tmp_path):
    path = tmp_path / "shapes.wkt"
    path.write_text("\n".join(shape.wkt for shape in SHAPES))
    return path


def read_primitives(path):
    """Return, for each polygon of a model, the loops and the triangles of its primitive."""
    model = GltfFile(path)
    assert model.json["extensionsUsed"] == [POLYGONS]
    assert "extensionsRequired" not in model.json
    result = []
    for mesh in model.json["meshes"]:
        (primitive,) = mesh["primitives"]
        assert primitive["mode"] == 4
        extension = primitive["extensions"][POLYGONS]
        names = ("indicesOffsets", "loopIndices", "loopIndicesOffsets")
        accessors = (primitive["indices"], *(extension[name] for name in names))
        arrays = [model.read_array(accessor)[:, 0] for accessor in accessors]
        assert all(array.dtype == np.uint32 for array in arrays)
        indices, starts, loops, loop_starts = arrays
        assert len(starts) == len(loop_starts) == extension["count"]
        points = model.read_array(primitive["attributes"]["POSITION"])[:, :2]
        ends_of_triangles = pairwise([*starts.tolist(), len(indices)])
        ends_of_loops = pairwise([*loop_starts.tolist(), len(loops)])
        for (first, last), (begin, end) in zip(ends_of_triangles, ends_of_loops, strict=True):
            assert (loops[end - 1] == RESTART) == (end < len(loops))
            rings = np.split(loops[begin:end], np.flatnonzero(loops[begin:end] == RESTART))
            rings = [ring[ring != RESTART] for ring in rings]
            triangles = indices[first:last].reshape(-1, 3)
            result.append((points, [ring for ring in rings if len(ring)], triangles))
    return result


def require_valid(points, rings, triangles):
    """Require the rules of the draft for the loops and triangles of a polygon."""
    used = set(triangles.ravel().tolist())
    for number, ring in enumerate(rings):
        assert len(set(ring.tolist())) == len(ring)
        assert set(ring.tolist()) <= used
        assert shapely.LinearRing(points[ring]).is_ccw == (number == 0)
    assert {vertex for ring in rings for vertex in ring.tolist()} == used
    polygon = shapely.Polygon(points[rings[0]], [points[ring] for ring in rings[1:]])
    areas = shapely.area(shapely.polygons(points[triangles]))
    assert areas.sum() == pytest.approx(polygon.area, rel=1e-5)


def require_equal(polygons, expected, tolerance):
    """Check that polygons are the expected ones, translated by the same vector."""
    assert len(polygons) == len(expected)
    expected = shapely.normalize(shapely.remove_repeated_points(expected))
    polygons = shapely.normalize(polygons)
    for polygon, other in zip(polygons, expected, strict=True):
        assert shapely.get_num_coordinates(polygon) == shapely.get_num_coordinates(other)
    offsets = shapely.get_coordinates(polygons) - shapely.get_coordinates(expected)
    assert np.ptp(offsets, axis=0).max() <= tolerance


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("meshes", [1, 4])
def test_polygons_are_read_back(tmp_path, shapes, suffix, meshes):
    source, out = shapes if meshes == 1 else "city:buildings=200", tmp_path / f"out{suffix}"
    polygons = np.array(SHAPES if meshes == 1 else load(source).polygons)
    report = export_file(source, out, polygons=True, chunk=64)
    assert (report.polygons, report.counts) == (len(polygons), {})
    assert len(GltfFile(out).json["meshes"]) == meshes
    tolerance = 1e-5 if meshes == 1 else 1e-6 * np.ptp(shapely.total_bounds(polygons))
    require_equal(load(str(out)).polygons, polygons, tolerance)
    for piece in read_primitives(out):
        require_valid(*piece)


def test_every_triangulator_is_conforming_or_refused(tmp_path, shapes):
    for name in names(available_only=True):
        out = tmp_path / "out.glb"
        report = export_file(shapes, out, name, polygons=True)
        pieces = read_primitives(out)
        assert len(pieces) == report.polygons == len(SHAPES) - report.counts.total()
        for piece in pieces:
            require_valid(*piece)
        failed = report.list_examples("failed")
        message = "1 T-junction(s): a vertex lies on an edge of a triangle"
        refused = [polygon for _, polygon, reason in failed if message in reason]
        assert refused == ["polygon 2", "polygon 3"] * (name in WITH_JUNCTIONS)


def test_polygons_are_for_gltf(harness, tmp_path):
    with pytest.raises(UsageError, match=r"out.obj: --polygons is for glTF; give a .glb or .gltf"):
        export_file("city:buildings=2", tmp_path / "out.obj", polygons=True)
    export_file("city:buildings=2", tmp_path / "model.glb")
    result = harness("triangulate", "model.glb", "--polygons", "-o", "other.glb")
    assert_refused(result, "--polygons is for polygons")


def edit(path, out, change):
    """Write a .gltf model with changed JSON next to its buffer."""
    model = json.loads(path.read_text())
    change(model, model["meshes"][0]["primitives"][0])
    out.write_text(json.dumps(model))
    return out


def test_polygons_in_space_keep_their_shape(tmp_path, shapes):
    export_file(shapes, tmp_path / "flat.gltf", polygons=True)

    def tilt(model, _):
        model["nodes"][0]["rotation"] = [0.5, 0.5, 0.5, 0.5]
        del model["nodes"][0]["matrix"]

    scene = load(str(edit(tmp_path / "flat.gltf", tmp_path / "tilted.gltf", tilt)))
    assert np.array_equal(
        shapely.get_num_interior_rings(scene.polygons), shapely.get_num_interior_rings(SHAPES)
    )
    assert shapely.area(scene.polygons) == pytest.approx(shapely.area(SHAPES), rel=1e-5)


def test_earlier_draft_with_loops_as_primitive_is_read(tmp_path, shapes):
    export_file(shapes, tmp_path / "new.gltf", polygons=True)

    def as_loops(model, primitive):
        extension = primitive["extensions"][POLYGONS]
        primitive["extensions"][POLYGONS] = {
            "count": extension["count"],
            "indicesOffsets": extension["loopIndicesOffsets"],
            "triangleIndices": primitive["indices"],
            "triangleIndicesOffsets": extension["indicesOffsets"],
        }
        primitive |= {"mode": 2, "indices": extension["loopIndices"]}
        model["extensionsRequired"] = [POLYGONS, "KHR_mesh_primitive_restart"]

    old = edit(tmp_path / "new.gltf", tmp_path / "old.gltf", as_loops)
    require_equal(load(str(old)).polygons, np.array(SHAPES), 1e-5)


def test_mixed_models_are_read_as_triangles(tmp_path, shapes):
    export_file(shapes, tmp_path / "all.gltf", polygons=True)

    def add_plain(model, primitive):
        plain = {key: primitive[key] for key in ("attributes", "indices")}
        model["meshes"][0]["primitives"].append(plain)

    mixed = edit(tmp_path / "all.gltf", tmp_path / "mixed.gltf", add_plain)
    assert read_polygons(GltfFile(mixed)) is None


@pytest.mark.parametrize(
    ("key", "value"), [("count", 4), ("loopIndicesOffsets", 2), ("loopIndices", 0)]
)
def test_invalid_polygons_are_reported(tmp_path, shapes, key, value):
    export_file(shapes, tmp_path / "good.gltf", polygons=True)

    def damage(_, primitive):
        primitive["extensions"][POLYGONS][key] = value

    with pytest.raises(SceneError, match=r"bad\.gltf"):
        load(str(edit(tmp_path / "good.gltf", tmp_path / "bad.gltf", damage)))
