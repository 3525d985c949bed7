import json
from pathlib import Path

import numpy as np
import pandas as pd
import pyogrio
import pytest
import shapely
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyarrow import parquet

from harness.commands.many_files import format_notes
from harness.errors import InputError, StorageError, UsageError
from harness.export import check_evidence
from harness.export.export import FORMATS, export_file
from scenes import SceneError, load
from scenes.tiles import FILE
from tests.conftest import assert_refused, make_geojson, require_ok
from triangulators import triangulate_many

CITY = "city:buildings=60"
MODELS = (".glb", ".gltf", ".obj")


def get_area(source: str) -> float:
    return float(sum(polygon.area for polygon in load(source).polygons))


def read_model(path: Path) -> trimesh.Trimesh:
    return trimesh.load_scene(path).to_mesh()


@pytest.fixture
def houses(tmp_path) -> Path:
    """Three footprints with attributes, in a planar system far from the origin."""
    courtyard = shapely.box(20, 0, 40, 20).difference(shapely.box(25, 5, 35, 15))
    shapes = [shapely.box(0, 0, 10, 8), courtyard, shapely.Polygon([(50, 0), (60, 0), (50, 10)])]
    polygons = shapely.transform(shapes, lambda xy: xy + (386_000, 6_672_000))
    path = tmp_path / "houses.gpkg"
    pyogrio.raw.write(
        path,
        shapely.to_wkb(polygons),
        [np.array(["a", "b ü", None], dtype=object), np.array([3.5, 12.0, np.nan])],
        ["name", "height"],
        geometry_type="Polygon",
        crs="EPSG:3067",
    )
    return path


HOUSE_AREAS = [80.0, 300.0, 50.0]


def read_map(path: Path) -> tuple[np.ndarray, dict[str, list]]:
    """Return the geometries and the attributes of a GeoJSON or GeoParquet file."""
    if path.suffix == ".parquet":
        table = pd.read_parquet(path)
        columns = {name: list(table[name]) for name in table if name != "geometry"}
        return shapely.from_wkb(list(table["geometry"])), columns
    meta, _, wkb, columns = pyogrio.raw.read(path)
    return shapely.from_wkb(wkb), dict(zip(meta["fields"], map(list, columns), strict=True))


def read_geo(path: Path) -> dict:
    """Return what a GeoParquet file says of its geometries."""
    return json.loads(parquet.read_schema(path).metadata[b"geo"])["columns"]["geometry"]


def test_obj_far_from_the_origin_keeps_the_sources_coordinates(tmp_path, houses):
    export_file(houses, tmp_path / "a.obj")
    assert "\nv 386000.0 6672000.0 0.0\n" in (tmp_path / "a.obj").read_text()
    inexact = shapely.box(386_000.123, 6_672_000.456, 386_010, 6_672_008)
    (tmp_path / "a.wkt").write_text(inexact.wkt)
    export_file(tmp_path / "a.wkt", tmp_path / "b.obj")
    assert "v 386000.123 6672000.456 0.0" in (tmp_path / "b.obj").read_text()


def test_gltf_is_horizontal_and_has_an_origin(tmp_path, houses):
    out = tmp_path / "houses.gltf"
    export_file(houses, out)
    low, high = read_model(out).bounds
    assert (low[1], high[1]) == pytest.approx((0, 0))  # y is up
    assert high[0] - low[0] == pytest.approx(60)
    assert np.abs([low, high]).max() < 100  # viewers use single precision
    document = json.loads(out.read_text())
    extras = document["asset"]["extras"]
    assert extras["origin"] == [386_030, 6_672_010]
    assert extras["crs"] == "EPSG:3067"
    attributes = document["meshes"][0]["extras"]["attributes"]
    assert attributes == {"name": ["a", "b ü", None], "height": [3.5, 12.0, None]}
    assert (tmp_path / "houses.gltf.bin").exists()


def test_obj_attributes_are_in_a_table(tmp_path, houses):
    export_file(houses, tmp_path / "houses.obj")
    table = pd.read_csv(tmp_path / "houses.obj.attributes.csv")
    assert list(table["feature"]) == [0, 1, 2]
    assert list(table["name"])[:2] == ["a", "b ü"]


@pytest.mark.parametrize("suffix", [".geojson", ".parquet"])
def test_maps_keep_position_and_attributes(tmp_path, houses, suffix):
    out = tmp_path / f"triangles{suffix}"
    export_file(houses, out)
    if suffix == ".geojson":
        assert pyogrio.read_info(out)["crs"] == "EPSG:3067"
    else:
        metadata = parquet.read_schema(out).metadata
        assert json.loads(metadata[b"raster_harness"])["crs"] == "EPSG:3067"
        assert read_geo(out)["crs"]["id"] == {"authority": "EPSG", "code": 3067}
        assert read_geo(out)["crs"]["type"] == "ProjectedCRS"
        assert load(out).notes == load(houses).notes
    geometries, attributes = read_map(out)
    assert [g.geom_type for g in geometries] == ["MultiPolygon"] * 3
    assert shapely.area(geometries) == pytest.approx(HOUSE_AREAS, rel=1e-9)
    assert geometries[0].bounds == (386_000, 6_672_000, 386_010, 6_672_008)
    assert [len(g.geoms) for g in geometries] == [2, 8, 1]
    assert attributes["name"][:2] == ["a", "b ü"]
    assert pd.isna(attributes["name"][2])
    assert attributes["height"][:2] == [3.5, 12.0]


@pytest.mark.parametrize("suffix", [".geojson", ".parquet"])
@pytest.mark.parametrize("crs", ["ESRI:54009", None])
def test_maps_name_any_reference_system_or_none(tmp_path, suffix, crs):
    """Also with attributes named like the column of geometries."""
    source, out = tmp_path / "in.gpkg", tmp_path / f"out{suffix}"
    columns = [np.array([number]) for number in range(2)], ["geometry", "geometry_"]
    options = {"geometry_type": "Polygon", "crs": crs}
    pyogrio.raw.write(source, shapely.to_wkb([shapely.box(0, 0, 9, 9)]), *columns, **options)
    export_file(source, out)
    assert read_map(out)[1].keys() >= {"geometry_"}
    assert load(out).units == ("units" if crs is None else "m")
    assert load(out).polygons[0].bounds == (0, 0, 9, 9)


@pytest.mark.parametrize("missing", [0, 1])
def test_batches_without_values_fit_lists_and_large_numbers(tmp_path, missing):
    rows: list[dict] = [{"tags": ["a"], "key": 2**60}, {"tags": ["b"], "key": 2**60 + 1}]
    rows[missing] = {"tags": None, "key": None}
    document = json.loads(make_geojson([shapely.box(n, 0, n + 1, 1) for n in range(2)]))
    for feature, row in zip(document["features"], rows, strict=True):
        feature["properties"] = row
    (tmp_path / "in.geojson").write_text(json.dumps(document))
    out = tmp_path / "out.parquet"
    assert export_file(tmp_path / "in.geojson", out, chunk=1).polygons == 2
    (value,) = pd.read_parquet(out)["tags"].dropna()
    assert value == '["b"]' if missing == 0 else list(value) == ["a"]


@pytest.mark.parametrize("suffix", [".geojson", ".parquet"])
def test_collections_of_triangles_are_valid(harness, tmp_path, houses, suffix):
    out = tmp_path / f"triangles{suffix}"
    require_ok(harness("triangulate", str(houses), "-o", str(out), "--collection"))
    if suffix == ".parquet":
        assert read_geo(out)["geometry_types"] == ["GeometryCollection"]
    geometries, _ = read_map(out)
    assert {g.geom_type for g in geometries} == {"GeometryCollection"}
    assert shapely.is_valid(geometries).all()
    assert shapely.area(geometries) == pytest.approx(HOUSE_AREAS, rel=1e-9)
    assert [len(g.geoms) for g in geometries] == [2, 8, 1]
    assert len(load(out).polygons) == 11
    result = harness("triangulate", str(houses), "-o", str(tmp_path / "a.glb"), "--collection")
    assert_refused(result, "a.glb", "--collection is for maps", ".geojson")


@pytest.mark.parametrize("suffix", [".geojson", ".parquet"])
def test_maps_in_degrees_get_their_degrees_back(tmp_path, suffix):
    ring = [[24.9384, 60.1699], [24.9391, 60.1699], [24.9391, 60.1704], [24.9384, 60.1699]]
    source = tmp_path / "in.geojson"
    source.write_text(make_geojson([shapely.Polygon(ring)]))
    out = tmp_path / f"out{suffix}"
    export_file(source, out)
    if suffix == ".parquet":
        assert "crs" not in read_geo(out)  # the default, longitude and latitude
    corners = {tuple(point) for point in shapely.get_coordinates(read_map(out)[0])}
    assert corners == {tuple(point) for point in ring}
    assert load(out).polygons[0].area == pytest.approx(load(source).polygons[0].area, rel=1e-9)


@pytest.mark.parametrize("chunk", [1, 7, 1000])
def test_npz_has_plain_arrays(tmp_path, houses, chunk):
    export_file(houses, tmp_path / "a.npz", chunk=chunk)
    with np.load(tmp_path / "a.npz") as data:
        vertices, triangles = data["vertices"], data["triangles"]
        a, b, c = (vertices[triangles[:, k]] for k in range(3))
        areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
        assert (areas > 0).all()  # counter-clockwise
        starts = data["triangle_offsets"]
        assert np.add.reduceat(areas, starts[:-1]) == pytest.approx(HOUSE_AREAS)
        assert data["vertex_offsets"].tolist() == [0, 4, 12, 15]
        assert data["attribute_name"].tolist() == ["a", "b ü", ""]
        assert data["attribute_height"][:2].tolist() == [3.5, 12.0]
        assert data["triangulator"] == "optimal:half-perimeter"


def test_npz_keeps_attributes_whose_names_differ_in_a_slash(tmp_path):
    source = tmp_path / "in.geojson"
    text = make_geojson([shapely.box(0, 0, 9, 9)])
    source.write_text(text.replace('"id": 0', '"a/b": 1, "a_b": 2'))
    export_file(source, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as data:
        names = {name: data[name].tolist() for name in data if name.startswith("attribute_")}
    assert names == {"attribute_a_b": [1], "attribute_a_b_": [2]}


@pytest.mark.parametrize("order", ["walk", "native"])
def test_triangles_are_written_in_a_walk_by_default(tmp_path, harness, order):
    options = [] if order == "walk" else ["--order", order]
    command = ("triangulate", CITY, "--triangulator", "delaunay", "-o", "a.npz")
    require_ok(harness(*command, *options))
    expected = triangulate_many(load(CITY).polygons, "delaunay", order=order)
    with np.load(tmp_path / "a.npz") as data:
        first = np.repeat(data["vertex_offsets"][:-1], np.diff(data["triangle_offsets"]))
        assert np.array_equal(data["triangles"] - first[:, None], expected.triangles)


@pytest.mark.parametrize("suffix", FORMATS)
def test_chunk_size_does_not_change_the_output(tmp_path, suffix):
    complete, pieces = tmp_path / f"whole{suffix}", tmp_path / f"pieces{suffix}"
    seen: list[int] = []
    one = export_file(CITY, complete)
    many = export_file(CITY, pieces, chunk=7, progress=seen.append)
    assert seen == [*range(7, 60, 7), 60]
    assert one.triangles == many.triangles
    for report, path in ((one, complete), (many, pieces)):
        assert (report.polygons, report.files[0]) == (60, path)
        if suffix in MODELS:
            model = read_model(path)
            assert len(model.faces) == report.triangles
            assert model.area == pytest.approx(get_area(CITY), rel=1e-6)
    if suffix in (".geojson", ".json"):
        assert complete.read_bytes() == pieces.read_bytes()


def test_obj_groups_are_polygons(tmp_path):
    export_file("paper", tmp_path / "a.obj", "delaunay")
    text = (tmp_path / "a.obj").read_text()
    assert text.startswith("# raster-harness, delaunay, units: units\n")
    assert text.count("\nv ") == 9
    assert text.count("\ng feature_") == 1
    assert text.count("\nf ") == 7


def test_failed_polygons_are_named(tmp_path):
    report = export_file("paper", tmp_path / "a.obj", "optimal:overdraw")
    assert report.list_examples("failed") == []
    report = export_file(CITY, tmp_path / "b.obj", "fan")
    failed = report.list_examples("failed")
    assert failed
    in_parts = export_file(CITY, tmp_path / "b.obj", "fan", chunk=7)
    assert in_parts.list_examples("failed") == failed
    assert report.polygons + len(failed) == 60
    assert sum(n for (kind, _), n in report.counts.items() if kind == "failed") == len(failed)
    assert (tmp_path / "b.obj").read_text().count("\ng ") == report.polygons


def test_filters_and_limit(tmp_path, houses):
    out = tmp_path / "a.npz"
    assert export_file(f"{houses}:limit=2", out).polygons == 2
    assert export_file(f"{houses}:where=height > 5", out).polygons == 1
    assert export_file(f"{CITY},limit=45", out, chunk=20).polygons == 45


def test_a_flat_model_has_a_matrix_that_single_precision_inverts(tmp_path):
    export_file("paper", tmp_path / "a.gltf")
    matrix = np.array(json.loads((tmp_path / "a.gltf").read_text())["nodes"][1]["matrix"])
    scales = matrix.reshape(4, 4).diagonal()[:3]
    assert scales[2] == pytest.approx(scales[0])
    inverse = np.linalg.inv(matrix.reshape(4, 4).astype(np.float32))
    assert np.isfinite(inverse).all()


class TestErrors:
    def refused(self, tmp_path, *args, error=UsageError, **kwargs) -> str:
        before = sorted(p.name for p in tmp_path.iterdir())
        with pytest.raises(error) as caught:
            export_file(*args, **kwargs)
        assert "\n" not in str(caught.value)
        assert sorted(p.name for p in tmp_path.iterdir()) == before  # no partial file remains
        return str(caught.value)

    def test_output(self, tmp_path):
        assert "choose from .glb" in self.refused(tmp_path, "paper", tmp_path / "a.xyz")
        (tmp_path / "dir.obj").mkdir()
        assert "is a folder" in self.refused(tmp_path, "paper", tmp_path / "dir.obj")
        (tmp_path / "file").write_text("x")
        inside = tmp_path / "file" / "a.obj"
        assert "cannot be written" in self.refused(tmp_path, "paper", inside, error=StorageError)

    @pytest.mark.parametrize("suffix", MODELS)
    def test_models_are_refused_as_source_of_a_model(self, tmp_path, suffix):
        model = tmp_path / "wall.obj"
        model.write_text("v 0 0 0\nv 4 0 0\nv 4 3 0\nv 0 3 0\nf 1 2 3 4\n")
        message = self.refused(tmp_path, model, tmp_path / f"b{suffix}")
        assert "a 3D model" in message
        assert "run --scene" in message
        assert export_file(model, tmp_path / "b.geojson").triangles == 2

    def test_source(self, tmp_path):
        out = tmp_path / "a.obj"
        self.refused(tmp_path, tmp_path / "none.gpkg", out, error=SceneError)
        message = self.refused(tmp_path, "city:where=a > 1", out, error=SceneError)
        assert "scene city has no parameter 'where'" in message
        assert "give 1 or more" in self.refused(tmp_path, f"{FILE}:limit=0", out)
        for parameter in ("pixels=64", "size=3", "rows=1"):
            message = self.refused(tmp_path, f"{FILE}:{parameter}", out, error=SceneError)
            assert "has no parameter" in message
        (tmp_path / "point.wkt").write_text("POINT (1 2)")
        message = self.refused(tmp_path, tmp_path / "point.wkt", out, error=InputError)
        assert "is a Point" in message

    def test_triangulator(self, tmp_path):
        message = self.refused(tmp_path, "paper", tmp_path / "a.obj", "delauny")
        assert "delaunay" in message
        self.refused(tmp_path, "paper", tmp_path / "a.obj", "optimal:prettiness")

    def test_an_existing_file_is_unchanged_after_an_error(self, tmp_path, monkeypatch):
        out = tmp_path / "a.obj"
        export_file("paper", out)
        before = out.read_bytes()

        def full(self: object, mesh: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("harness.export.writers.ObjWriter.add", full)
        assert "No space left" in self.refused(tmp_path, CITY, out, error=StorageError)
        assert out.read_bytes() == before


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    offset=st.sampled_from([0.0, 1e3, 5e5, 6.7e6]),
    size=st.sampled_from([1e-3, 1.0, 1e4]),
    seed=st.integers(0, 1000),
)
def test_glb_keeps_areas_wherever_the_polygons_lie(tmp_path, offset, size, seed):
    star = load("stress", family="random-star", vertices=24, seed=seed).polygons[0]
    polygon = shapely.transform(star, lambda xy: xy * size + offset)
    (tmp_path / "a.wkt").write_text(shapely.to_wkt(polygon, rounding_precision=-1))
    export_file(tmp_path / "a.wkt", tmp_path / "a.glb", "ear-clipping")
    # a file cannot be more exact than the polygon's coordinates
    lost = 10 * np.spacing(offset) / size
    assert read_model(tmp_path / "a.glb").area == pytest.approx(polygon.area, rel=1e-6 + lost)


def test_proofs_are_written_and_valid(houses, tmp_path):
    proofs = tmp_path / "proofs.jsonl"
    report = export_file(houses, tmp_path / "houses.glb", certify=proofs)
    lines = proofs.read_text().splitlines()
    claims = [json.loads(line) for line in lines]
    assert len(claims) == report.certified.polygons == 3
    assert [len(claim["rings"]) for claim in claims] == [1, 2, 1]
    for line, claim in zip(lines, claims, strict=True):
        assert claim["proven"]
        assert "optimal" in check_evidence.check_line(line)
        half = {"cost": claim["cost"] / 2, "lower_bound": claim["cost"] / 2}
        with pytest.raises(check_evidence.EvidenceError):
            check_evidence.check_line(json.dumps(claim | half))
    assert proofs in report.files


def test_flips_by_a_test_are_certified_for_half_perimeter(tmp_path, houses):
    certified = export_file(houses, tmp_path / "a.npz", "flips:l1", certify=True).certified
    counts = (certified.criterion, certified.polygons, certified.refused)
    assert counts == ("half-perimeter", 3, 0)


def test_skipped_polygons_are_named(harness, tmp_path):
    points = [{"type": "Point", "coordinates": [number, 0]} for number in range(5)]
    file = tmp_path / "mixed.geojson"
    file.write_text(make_geojson([shapely.box(0, 0, 4, 4), *points]))
    _, err = require_ok(harness("triangulate", str(file), "-o", "out.npz"))
    named = "feature 1, feature 2, feature 3 and 2 more"
    assert f"dropped 5: is a Point, not a polygon ({named})" in " ".join(err.split())
    # A note stands for all repetitions of a tile, and not all notes are stored.
    lines = format_notes({("dropped", "is flat"): 9}, [("dropped", "tile 3/0/1", "is flat")])
    assert list(lines) == ["dropped 9: is flat (tile 3/0/1 and 8 more)"]
