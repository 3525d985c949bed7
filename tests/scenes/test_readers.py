"""Formats that are read without GDAL."""

import io
import json
from contextlib import nullcontext
from decimal import Decimal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely
import trimesh
from plyfile import PlyData, PlyElement

from harness.models.gltf import GltfModel
from scenes import SceneError, load
from scenes.files import read_chunks
from scenes.readers.gltf import COMPRESSED
from tests.models.build import Builder
from tests.scenes.conftest import assert_valid_polygons, require_error, write_file

SQUARE = shapely.box(0, 0, 10, 10)
HOLED = shapely.Polygon(SQUARE.exterior, [shapely.box(2, 2, 4, 4).exterior])


class TestWkt:
    def test_geometry_per_line(self, tmp_path):
        lines = ["# footprints", SQUARE.wkt, "", HOLED.wkb_hex, "not a geometry", '"POINT (1 2)"']
        scene = load(write_file(tmp_path / "a.wkt", "\n".join(lines)))
        assert_valid_polygons(scene.polygons)
        assert [p.area for p in scene.polygons] == [100, 96]
        assert scene.dropped == [
            ("line 5", "is not WKT or hexadecimal WKB"),
            ("line 6", "is a Point, not a polygon"),
        ]

    def test_one_geometry_over_several_lines(self, tmp_path):
        text = "MULTIPOLYGON (\n ((0 0, 1 0, 1 1, 0 0)),\n ((5 5, 6 5, 6 6, 5 5)))\n"
        assert len(load(write_file(tmp_path / "a.wkt", text)).polygons) == 2

    def test_reference_system_of_ewkt(self, tmp_path):
        degrees = "SRID=4326; POLYGON ((25 60, 25.001 60, 25.001 60.001, 25 60))"
        scene = load(write_file(tmp_path / "a.wkt", degrees))
        assert scene.units == "m"
        assert scene.polygons[0].area == pytest.approx(55.8 * 111.4 / 2, rel=0.01)

    def test_binary(self, tmp_path):
        both = shapely.MultiPolygon([SQUARE, shapely.box(20, 0, 21, 1)])
        scene = load(write_file(tmp_path / "a.wkb", shapely.to_wkb(both)))
        assert [p.area for p in scene.polygons] == [100, 1]
        geographic = shapely.set_srid(shapely.box(25, 60, 25.001, 60.001), 4326)
        wkb = shapely.to_wkb(geographic, include_srid=True)
        assert load(write_file(tmp_path / "b.wkb", wkb)).units == "m"

    def test_where_needs_attributes(self, tmp_path):
        require_error("no attributes", write_file(tmp_path / "a.wkt", SQUARE.wkt), where="a > 1")


PLANAR = {"crs": {"type": "ProjectedCRS", "id": {"authority": "EPSG", "code": 3067}}}


def geoparquet(path: Path, geometries, encoding="WKB", crs=None, **columns) -> Path:
    import pyarrow as pa
    from pyarrow import parquet

    metadata = {"encoding": encoding, "geometry_types": ["Polygon"]} | (crs or {})
    geo = {"version": "1.1.0", "primary_column": "geom", "columns": {"geom": metadata}}
    wkb = [g if g is None or isinstance(g, bytes) else shapely.to_wkb(g) for g in geometries]
    table = pa.table({**columns, "geom": wkb})
    parquet.write_table(table.replace_schema_metadata({"geo": json.dumps(geo)}), path)
    return path


class TestGeoParquet:
    def test_attributes_and_conditions(self, tmp_path):
        columns = {"h": [3.5, 1, 9], "s": ["x", "y", "it's"]}
        path = geoparquet(tmp_path / "a.parquet", [SQUARE, None, HOLED], crs=PLANAR, **columns)
        scene = load(path)
        assert [p.area for p in scene.polygons] == [100, 96]
        assert list(scene.attributes["h"]) == [3.5, 9]
        assert scene.dropped == [("row 1", "empty geometry")]
        assert [p.area for p in load(path, where="h > 5 AND s LIKE 'it%'").polygons] == [96]
        require_error("invalid condition 'zz > 1'", path, where="zz > 1")
        require_error("no column 'hh'; did you mean h?", path, where='"hh" > 1')

    def test_condition_on_decimals(self, tmp_path):
        columns = {"h": [Decimal("9.5"), Decimal("20"), None]}
        path = geoparquet(tmp_path / "a.parquet", [SQUARE, HOLED, SQUARE], crs=PLANAR, **columns)
        for condition in ("h > 10", '"H" = 20'):
            assert [p.area for p in load(path, where=condition).polygons] == [96]

    def test_default_reference_system_is_longitude_and_latitude(self, tmp_path):
        square = shapely.box(25, 60, 25.01, 60.01)
        assert load(geoparquet(tmp_path / "a.parquet", [square])).units == "m"
        path = geoparquet(tmp_path / "b.parquet", [square], crs={"crs": None})
        assert load(path).units == "units"

    def test_errors(self, tmp_path):
        pd.DataFrame({"a": [1]}).to_parquet(tmp_path / "plain.parquet")
        native = geoparquet(tmp_path / "native.parquet", [SQUARE], encoding="polygon")
        for path, message in (
            (tmp_path / "plain.parquet", "no geometry column"),
            (native, "has the unsupported encoding polygon"),
            (write_file(tmp_path / "bad.parquet", "PAR1 rubbish"), "cannot be read as GeoParquet"),
        ):
            require_error(message, path)


def cityjson(semantics: bool = True, **changes) -> str:
    """Return CityJSON of a house of 10 m by 8 m by 3 m with a flat roof, in millimetres."""
    corners = [[0, 0], [10_000, 0], [10_000, 8_000], [0, 8_000]]
    vertices = [[x, y, z] for z in (0, 3_000) for x, y in corners]
    ground, roof = [[3, 2, 1, 0]], [[4, 5, 6, 7]]
    walls = [[[i, (i + 1) % 4, (i + 1) % 4 + 4, i + 4]] for i in range(4)]
    solid = {"type": "Solid", "lod": "2", "boundaries": [[ground, roof, *walls]]}
    if semantics:
        kinds = [{"type": t} for t in ("GroundSurface", "RoofSurface", "WallSurface")]
        solid["semantics"] = {"surfaces": kinds, "values": [[0, 1, 2, 2, 2, 2]]}
    model = {
        "type": "CityJSON",
        "version": "2.0",
        "transform": {"scale": [0.001] * 3, "translate": [100, 200, 0]},
        "CityObjects": {"house": {"type": "Building", "geometry": [solid]}},
        "vertices": vertices,
    }
    return json.dumps(model | changes)


def cityjson_sequence(houses: int) -> list[str]:
    """Return a head line, and a line per house, 20 m apart."""
    model = json.loads(cityjson())
    head = {**model, "CityObjects": {}, "vertices": []}
    lines = [json.dumps(head)]
    for number in range(houses):
        vertices = [[x + 20_000 * number, y, z] for x, y, z in model["vertices"]]
        objects = {f"house {number}": model["CityObjects"]["house"]}
        feature = {"type": "CityJSONFeature", "id": f"house {number}", "CityObjects": objects}
        lines.append(json.dumps({**feature, "vertices": vertices}))
    return lines


class TestCityJsonSequence:
    @pytest.mark.parametrize("size", [1, 2, 100])
    def test_features_are_read_in_chunks(self, tmp_path, size):
        path = write_file(tmp_path / "town.city.jsonl", "\n".join([*cityjson_sequence(5), ""]))
        chunks = list(read_chunks(str(path), layer="RoofSurface", size=size))
        assert max(len(chunk.cleaned.polygons) for chunk in chunks) <= size
        polygons = [polygon for chunk in chunks for polygon in chunk.cleaned.polygons]
        expected = [(100 + 20 * k, 200, 110 + 20 * k, 208) for k in range(5)]
        assert np.array([p.bounds for p in polygons]) == pytest.approx(np.array(expected))
        scene = load(path)
        assert len(scene.polygons) == 10
        assert scene.units == "m"
        assert list(scene.attributes["id"][::2]) == [f"house {k}" for k in range(5)]

    def test_invalid_line_is_noted_and_skipped(self, tmp_path):
        lines = cityjson_sequence(3)
        lines[1] = lines[1][:50]
        lines[2] = json.dumps({"type": "Feature", "CityObjects": {}})
        scene = load(write_file(tmp_path / "town.city.jsonl", "\n".join(lines)))
        assert len(scene.polygons) == 2
        assert [name for name, _ in scene.dropped] == ["line 2", "line 3"]
        assert "not CityJSONFeature" in scene.dropped[1][1]

    def test_errors(self, tmp_path):
        lines = cityjson_sequence(1)
        path = write_file(tmp_path / "a.city.jsonl", lines[0][:-1] + "\n" + lines[1])
        require_error("line 1 cannot be read as JSON", path)
        path = write_file(tmp_path / "b.city.jsonl", "\n".join(lines))
        require_error("give RoofSurface or GroundSurface", path, layer="Roof")
        require_error("holds no polygon", write_file(tmp_path / "c.city.jsonl", lines[0]))


class TestCityJson:
    @pytest.mark.parametrize("semantics", [True, False])
    def test_roofs_and_ground_in_plan(self, tmp_path, semantics):
        path = write_file(tmp_path / "town.city.json", cityjson(semantics))
        scene = load(path, layer="RoofSurface")
        assert scene.units == "m"
        assert scene.polygons[0].bounds == pytest.approx((100, 200, 110, 208))
        assert scene.attributes.iloc[0].to_list() == ["house", "Building", "RoofSurface", 3.0]
        both = load(path)
        assert_valid_polygons(both.polygons)
        if semantics:
            assert sorted(both.attributes["surface"]) == ["GroundSurface", "RoofSurface"]

    @pytest.mark.parametrize("values", [None, [None], [[None] * 6], [[None, 0]], [[]]])
    def test_surfaces_without_semantics_are_classified_by_slope(self, tmp_path, values):
        model = json.loads(cityjson())
        solid = model["CityObjects"]["house"]["geometry"][0]
        solid["semantics"] = {"surfaces": [{"type": "RoofSurface"}], "values": values}
        path = write_file(tmp_path / "town.city.json", json.dumps(model))
        assert [p.area for p in load(path, layer="RoofSurface").polygons] == [80]

    @pytest.mark.parametrize(
        "system",
        [
            "https://www.opengis.net/def/crs/EPSG/0/7415",
            "urn:ogc:def:crs:EPSG::28992",
            "urn:ogc:def:crs,crs:EPSG::28992,crs:EPSG::5709",
        ],
    )
    def test_horizontal_reference_system(self, tmp_path, system):
        text = cityjson(metadata={"referenceSystem": system})
        scene = load(write_file(tmp_path / "town.city.json", text))
        assert "coordinates in Amersfoort / RD New, m" in scene.notes

    def test_instances_of_templates_are_noted(self, tmp_path):
        model = json.loads(cityjson())
        instance = {"type": "GeometryInstance", "template": 0, "boundaries": [0]}
        model["CityObjects"]["tree"] = {"type": "CityFurniture", "geometry": [instance]}
        scene = load(write_file(tmp_path / "town.city.json", json.dumps(model)))
        reasons = dict(scene.dropped)
        assert reasons["tree"].startswith("has an instance of a template, which is unsupported")
        assert len(scene.polygons) == 2

    def test_errors(self, tmp_path):
        solid = {"type": "Solid", "boundaries": [[[[0, 1, 99]]]]}
        broken = {"house": {"type": "Building", "geometry": [solid]}}
        for text, message in (
            (cityjson()[:200], "cannot be read as JSON"),
            (cityjson(vertices="no"), "cannot be read as CityJSON"),
            (cityjson(CityObjects=broken), "house is an invalid city object"),
            (cityjson(CityObjects={}), "holds no polygon"),
        ):
            require_error(message, write_file(tmp_path / "a.city.json", text))
        path = write_file(tmp_path / "b.city.json", cityjson())
        require_error("give RoofSurface or GroundSurface", path, layer="Roof")


# A house with a gable: floor, two walls, two pentagons, two roof planes.
GABLE = """\
v 0 0 0
v 10 0 0
v 10 6 0
v 0 6 0
v 0 0 3
v 10 0 3
v 10 6 3
v 0 6 3
v 0 3 5
v 10 3 5
"""
FACES = ["4 3 2 1", "1 2 6 5", "3 4 8 7", "1 5 9 8 4", "2 3 7 10 6", "5 6 10 9", "7 8 9 10"]
AREAS = [60, 30, 30, 24, 24, 10 * 13**0.5, 10 * 13**0.5]


def ply(byte_order: str) -> bytes:
    """Return the house as PLY: text for the order "=", otherwise binary."""
    corners = [(*map(float, line.split()[1:]), 255) for line in GABLE.splitlines()]
    faces = [(np.array(face.split(), np.int32) - 1,) for face in FACES]
    fields = [("x", "f4"), ("y", "f4"), ("z", "f4"), ("red", "u1")]
    vertex = PlyElement.describe(np.array(corners, fields), "vertex")
    face = PlyElement.describe(np.array(faces, [("vertex_indices", "O")]), "face")
    stream = io.BytesIO()
    PlyData([vertex, face], byte_order == "=", byte_order, ["a house"]).write(stream)
    return stream.getvalue()


class TestModels:
    def test_ngons_of_obj(self, tmp_path):
        faces = "".join(f"f {face}\n" for face in FACES)
        scene = load(write_file(tmp_path / "house.obj", GABLE + "vn 0 0 1\n" + faces))
        assert scene.notes == ("each face in a plane, side by side",)
        assert_valid_polygons(scene.polygons)
        assert [p.area for p in scene.polygons] == pytest.approx(AREAS)
        assert [len(p.exterior.coords) - 1 for p in scene.polygons] == [4, 4, 4, 5, 5, 4, 4]
        # The gable stands upright: 6 wide, 5 high.
        left, low, right, high = scene.polygons[3].bounds
        assert (right - left, high - low) == pytest.approx((6, 5))

    def test_references_of_obj(self, tmp_path):
        text = GABLE + "f 1/1/1 2/2/2 6//3 -6/4 # a wall\nf 1 2 99\nf 1 2\nf 1 1 1\n"
        scene = load(write_file(tmp_path / "a.obj", text))
        assert [p.area for p in scene.polygons] == [30]
        assert [name for name, _ in scene.dropped] == ["face 1", "face 2", "face 3"]

    @pytest.mark.parametrize(
        ("faces", "areas"),
        [
            (["1 2 3", "1 3 4", "3 2 1", "4 3 1"], [1, 1]),  # a sheet with two sides
            (["1 2 3", "1 3 4", "4 2 1", "4 3 2"], [1, 1]),  # with other diagonals
            (["1 2 3", "1 4 3"], [1]),  # reversed
        ],
    )
    def test_coplanar_triangles_of_both_orientations(self, tmp_path, faces, areas):
        text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n" + "".join(f"f {face}\n" for face in faces)
        scene = load(write_file(tmp_path / "a.obj", text))
        assert ([p.area for p in scene.polygons], scene.dropped) == (areas, [])

    def test_faces_that_are_not_planar_are_noted(self, tmp_path):
        text = "v 0 0 0\nv 1 0 0\nv 1 1 0.2\nv 0 1 0\nf 1 2 3 4\n"
        assert "not planar" in load(write_file(tmp_path / "a.obj", text)).repaired[0][1]

    @pytest.mark.parametrize("byte_order", "=<>")
    def test_ngons_of_ply(self, tmp_path, byte_order):
        scene = load(write_file(tmp_path / "house.ply", ply(byte_order)))
        assert [p.area for p in scene.polygons] == pytest.approx(AREAS)

    @pytest.mark.parametrize("suffix", [".glb", ".gltf", ".stl", ".off", ".obj", ".ply"])
    @pytest.mark.parametrize("separate", [False, True])
    def test_triangles_in_one_plane_are_joined(self, tmp_path, suffix, separate):
        solid = trimesh.creation.extrude_polygon(HOLED, 3.0, engine="earcut")
        if separate:  # separate vertices for each triangle
            solid.unmerge_vertices()
        folder = tmp_path / "model"
        folder.mkdir()
        solid.export(folder / f"solid{suffix}")
        scene = load(folder / f"solid{suffix}")
        assert_valid_polygons(scene.polygons)
        assert sorted(round(p.area, 3) for p in scene.polygons) == [6] * 4 + [30] * 4 + [96] * 2
        assert sum(len(p.interiors) for p in scene.polygons) == 2

    def test_walls_of_gltf_are_upright(self, tmp_path):
        """In glTF, y points up."""
        corners = [(0, 0, 0), (3, 0, -4), (3, 2, -4), (0, 2, 0)]
        trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)]).export(tmp_path / "wall.glb")
        (wall,) = load(tmp_path / "wall.glb").polygons
        left, low, right, high = wall.bounds
        assert (right - left, high - low) == pytest.approx((5, 2))

    @pytest.mark.parametrize("change", [str.upper, str.title, str.lower])
    def test_keywords_of_stl_have_any_case(self, tmp_path, change):
        facets = "".join(
            f"facet normal 0 0 1\nouter loop\nvertex 0 0 0\n{corners}endloop\nendfacet\n"
            for corners in ("vertex 4 0 0\nvertex 4 4 0\n", "vertex 4 4 0\nvertex 0 4 0\n")
        )
        path = write_file(tmp_path / "a.stl", change(f"solid a\n{facets}endsolid a\n"))
        assert [p.area for p in load(path).polygons] == [16]

    @pytest.mark.parametrize(
        ("name", "content", "message"),
        [
            ("a.obj", "v 0 0\nf 1 2 3\n", "line 1 is not OBJ"),
            ("a.obj", "v 0 0 0\n", "has no faces"),
            ("a.obj", "v 0 0 0\nf 1 1 1\n", "holds no usable polygon"),
            ("a.ply", "plx\n", "expected 'ply'"),
            ("a.ply", b"ply\nformat ascii 1.0\nelement vertex -3\nend_header\n", "PLY"),
            ("a.glb", b"glTF rubbish", "cannot be read as a 3D model"),
            ("a.stl", b"solid nothing\nendsolid\n", "model"),
        ],
    )
    def test_errors(self, tmp_path, name, content, message):
        require_error(message, write_file(tmp_path / name, content))


class TestGltf:
    """The readers of glTF for scenes, and for views and `--check`, read the same model."""

    CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], dtype="<f4")
    PAIR = np.array([0, 1, 2, 0, 2, 3])

    def area(self, builder: Builder, path: Path) -> float:
        scene = load(builder.write(path))
        assert_valid_polygons(scene.polygons)
        lengths = []
        for part in (part for group in GltfModel(path).iterate_groups() for part in group):
            for matrix in part.placements:
                corners = (part.mesh.positions @ matrix[:3, :3].T)[part.mesh.triangles]
                a, b, c = np.moveaxis(corners, 1, 0)
                lengths += np.linalg.norm(np.cross(b - a, c - a), axis=1).tolist()
        area = sum(p.area for p in scene.polygons)
        assert area == pytest.approx(sum(lengths) / 2)
        return area

    @pytest.mark.parametrize(("mode", "indices"), [(4, PAIR), (5, [0, 1, 3, 2]), (6, None)])
    def test_modes(self, tmp_path, mode, indices):
        builder = Builder(self.CORNERS, indices, mode=mode)
        builder.primitive(self.CORNERS[:2], None, mode=1)
        assert self.area(builder, tmp_path / "a.glb") == pytest.approx(1)
        assert "1 primitive(s) of points or lines skipped" in load(tmp_path / "a.glb").notes

    def test_bytes_after_the_model_are_ignored(self, tmp_path):
        path = Builder(self.CORNERS, self.PAIR).write(tmp_path / "a.glb")
        path.write_bytes(path.read_bytes() + b"rest")
        assert [p.area for p in load(path).polygons] == [1]

    @pytest.mark.parametrize("kind", ["u1", "i1", "u2", "i2"])
    @pytest.mark.parametrize("normalized", [True, False])
    def test_quantized_positions(self, tmp_path, kind, normalized):
        full = np.iinfo(kind).max
        positions = np.hstack([self.CORNERS * full, np.zeros((4, 1))]).astype(kind)[:, :3]
        builder = Builder(positions, self.PAIR)
        builder.json["accessors"][0]["normalized"] = normalized
        expected = 1 if normalized else float(full) ** 2
        assert self.area(builder, tmp_path / "a.glb") == pytest.approx(expected)

    def test_lowest_integer_is_minus_one(self, tmp_path):
        builder = Builder((self.CORNERS * -128).astype("i1"), self.PAIR)
        builder.json["accessors"][0]["normalized"] = True
        assert self.area(builder, tmp_path / "a.glb") == pytest.approx(1)

    def test_nodes_and_instances(self, tmp_path):
        builder = Builder(self.CORNERS, self.PAIR)
        instances = {
            "TRANSLATION": builder.accessor(np.array([(0, 0, 0), (5, 0, 0)], "<f4")),
            "SCALE": builder.accessor(np.array([(1, 1, 1), (2, 2, 2)], "<f4")),
            "ROTATION": builder.accessor(np.array([(0, 0, 0, 1), (0, 127, 0, 0)], "i1"), True),
        }
        builder.json |= {
            "scenes": [{"nodes": [0]}],
            "nodes": [
                {"scale": [3, 3, 3], "children": [1, 2]},
                {"mesh": 0, "translation": [0, 0, 9]},
                {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": instances}}},
            ],
        }
        assert self.area(builder, tmp_path / "a.glb") == pytest.approx(9 * (1 + 1 + 4))

    @pytest.mark.parametrize("extension", COMPRESSED)
    def test_compressed_triangles_are_refused(self, tmp_path, extension):
        builder = Builder(self.CORNERS, self.PAIR)
        builder.json["extensionsUsed"] = [extension]
        path = builder.write(tmp_path / "a.glb")
        require_error(f"a.glb: {extension} is unsupported; unpack", path)

    @pytest.mark.parametrize(
        ("changes", "reason"),
        [
            ({"extensionsRequired": ["KHR_x"]}, "requires the extension KHR_x, which is unsupp"),
            ({"extensionsRequired": ["KHR_materials_x", "EXT_mesh_gpu_instancing"]}, ""),
            ({"nodes": [{"children": [1, 1]}, {"mesh": 0}]}, "the nodes are not a tree"),
            ({"nodes": [{"mesh": 0, "children": [0]}]}, "the nodes are not a tree"),
        ],
    )
    def test_no_part_is_lost_in_silence(self, tmp_path, changes, reason):
        builder = Builder(self.CORNERS, self.PAIR)
        builder.json |= {"scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}]} | changes
        with pytest.raises(SceneError, match=reason) if reason else nullcontext():
            load(builder.write(tmp_path / "a.glb"))


@pytest.mark.parametrize("header", [b"solid named so by its writer", b"facet in the head"])
def test_binary_stl_with_bytes_after_the_triangles(tmp_path, header):
    solid = trimesh.creation.box((2, 3, 4)).export(file_type="stl")
    for tail in (b"", b"exported by someone"):
        path = write_file(tmp_path / "a.stl", header.ljust(80) + solid[80:] + tail)
        assert sum(p.area for p in load(path).polygons) == pytest.approx(52)
