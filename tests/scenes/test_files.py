import ctypes
import json
import sqlite3
import struct
import zipfile
from contextlib import closing
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely

from scenes import load
from scenes.files import read_chunks
from scenes.readers import vector
from scenes.readers.gdal import load_library
from tests.scenes.conftest import SQUARE, assert_valid_polygons, feature, require_error, write_file
from tests.scenes.samples import make_osm, make_way
from tests.scenes.test_readers import PLANAR, geoparquet

POLYGONS = [
    shapely.box(0, 0, 10, 10),
    shapely.Polygon([(20, 0), (30, 0), (30, 9)]),
    shapely.Polygon(shapely.box(0, 20, 9, 29).exterior, [shapely.box(3, 23, 6, 26).exterior]),
]


def write(path: Path, geometries=POLYGONS, layer=None, crs="EPSG:3067", **options) -> str:
    names = np.array([f"house {i}" for i in range(len(geometries))], dtype=object)
    height = np.arange(len(geometries)) * 3.5
    pyogrio.raw.write(
        path,
        shapely.to_wkb(np.asarray(geometries)),
        [names, height],
        ["name", "height"],
        geometry_type=options.pop("geometry_type", "Polygon"),
        crs=crs,
        layer=layer,
        **options,
    )
    return str(path)


@pytest.mark.parametrize("suffix", [".geojson", ".gpkg", ".shp", ".fgb", ".gml", ".geojsonl"])
def test_formats_of_gdal(tmp_path, suffix):
    crs = "EPSG:4326" if suffix == ".geojsonl" else "EPSG:3067"
    scene = load(write(tmp_path / f"houses{suffix}", crs=crs), project=False)
    assert_valid_polygons(scene.polygons)
    assert sorted(p.area for p in scene.polygons) == pytest.approx([45, 72, 100])
    assert sorted(scene.attributes["height"]) == [0.0, 3.5, 7.0]
    by_name = dict(zip(scene.attributes["name"], scene.polygons, strict=True))
    assert by_name["house 2"].equals(POLYGONS[2])


def test_openstreetmap(tmp_path):
    """GDAL cannot write OSM files, so this file is OSM XML; PBF shares the code path."""
    corners = [(24.9, 60.1), (24.901, 60.1), (24.901, 60.101), (24.9, 60.101)]
    content = make_osm(corners, make_way(7, "12341", building="yes"))
    scene = load(write_file(tmp_path / "town.osm", content))
    assert scene.units == "m"
    assert scene.polygons[0].area == pytest.approx(55.6 * 111.4, rel=0.01)


def test_dropped_and_repaired_geometries_are_noted(geojson):
    bow_tie = [[0, 0], [6, 8], [6, 0], [0, 8], [0, 0]]
    two = [[SQUARE], [[[40, 0], [50, 0], [50, 10], [40, 0]]]]
    path = geojson(
        feature([SQUARE], name="good"),
        feature([bow_tie], name="bow tie"),
        feature(None, name="nothing"),
        feature([1, 2], "Point"),
        feature([[[0, 0], [5, 5], [9, 9], [0, 0]]], name="flat"),
        feature(two, "MultiPolygon", name="two"),
    )
    scene = load(path)
    assert_valid_polygons(scene.polygons)
    assert len(scene.polygons) == 1 + 2 + 2
    assert list(scene.attributes["name"]) == ["good", "bow tie", "bow tie", "two", "two"]
    dropped = dict(scene.dropped)
    assert dropped["feature 2"] == "empty geometry"
    assert dropped["feature 3"] == "is a Point, not a polygon"
    assert "feature 4" in dropped
    assert len(scene.dropped) == 3
    reason = "self-intersects at 3.0 4.0; repaired into 2 polygon(s)"
    assert scene.repaired == [("feature 1", reason)]


def test_nan_is_dropped_and_a_file_of_nan_only_refused(tmp_path):
    text = '{"type":"FeatureCollection","features":[%s]}'
    one = '{"type":"Feature","properties":{},"geometry":{"type":"Polygon","coordinates":[[%s]]}}'
    good, bad = one % "[0,0],[1,0],[1,1],[0,0]", one % "[0,0],[1,NaN],[1,1],[0,0]"
    scene = load(write_file(tmp_path / "a.geojson", text % f"{good},{bad}"))
    assert len(scene.polygons) == 1
    assert scene.dropped == [("feature 1", "has a NaN or infinite coordinate")]
    path = write_file(tmp_path / "a.geojson", text % bad)
    require_error(r"no usable polygon: feature 0 has a NaN", path)


def test_unclosed_ring_is_closed_and_noted(geojson):
    scene = load(geojson(feature([SQUARE[:-1]])))
    assert scene.polygons[0].area == 100
    assert scene.repaired == [("feature 0", "has an open ring; closed")]


def test_layers_and_conditions(tmp_path):
    path = tmp_path / "town.gpkg"
    write(path, [shapely.Point(0, 0)], "trees", geometry_type="Point")
    write(path, POLYGONS[:1], "houses", append=True)
    write(path, POLYGONS[1:], "parks", append=True)
    first, parks = load(path), load(path, layer="parks")
    assert [len(scene.polygons) for scene in (first, parks)] == [1, 2]
    assert first.notes[0] == "layer houses (others: trees, parks)"
    assert parks.notes[0] == "layer parks (others: trees, houses)"
    assert len(load(f"{path}:layer=parks,where=height > 1").polygons) == 1
    require_error("did you mean parks", path, layer="park")
    require_error("no column 'heigth'; did you mean height?", path, where='"heigth" > 1')
    require_error("no polygon for where=height > 99", path, where="height > 99")


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".shp", ".fgb"])
@pytest.mark.parametrize("condition", ["nam = 'x'", "height == 3 3", "name = 'x"])
def test_invalid_condition_is_reported_with_the_attributes(tmp_path, suffix, condition):
    path = write(tmp_path / f"town{suffix}")
    message = require_error(None, path, where=condition)
    assert message.startswith(f"{path}: invalid condition {condition!r}")
    assert message.endswith("attributes are name, height")
    assert "SELECT" not in message


@pytest.mark.parametrize("suffix", [".gpkg", ".geojson", ".shp", ".fgb", ".csv"])
@pytest.mark.parametrize("streaming", [True, False])
def test_conditions_hold_whether_or_not_attributes_are_read(
    tmp_path, monkeypatch, suffix, streaming
):
    """Commands that measure read no attributes, but conditions need them."""
    if not streaming:
        monkeypatch.setattr("scenes.readers.vector.find_spec", lambda name: None)
    options = {"layer_options": {"GEOMETRY": "AS_WKT"}} if suffix == ".csv" else {}
    path = write(tmp_path / f"town{suffix}", **options)
    for condition, areas in (("height > 1", [45, 72]), ("name IS NULL", []), ("height = 7", [72])):
        for attributes in (True, False):
            chunks = read_chunks(path, where=condition, attributes=attributes, project=False)
            polygons = [p for chunk in chunks for p in chunk.cleaned.polygons]
            assert sorted(p.area for p in polygons) == pytest.approx(areas)


class TestCsv:
    ROWS = 'id,%s,zip,h\n1,"%s",00700,9\n2,"%s",00800,10\n'

    @pytest.mark.parametrize("name", ["WKT", "geometry", "geom", "the_geom"])
    def test_names_of_the_geometry_column(self, tmp_path, name):
        content = self.ROWS % (name, POLYGONS[0].wkt, POLYGONS[1].wkb_hex)
        scene = load(write_file(tmp_path / "a.csv", content), where="h < 10")
        assert [p.area for p in scene.polygons] == [100]
        assert scene.attributes.iloc[0].to_dict() == {"id": 1, "zip": "00700", "h": 9}

    @pytest.mark.parametrize("text", ["", "abc", "SRID=3067;POLYGON ((0 0,9 0,9 9,0 0))"])
    def test_rows_without_wkt_are_named_with_the_reason(self, tmp_path, text):
        content = f'id,WKT\n1,"{text}"\n2,"{POLYGONS[0].wkt}"\n'
        scene = load(write_file(tmp_path / "a.csv", content))
        assert list(scene.attributes["id"]) == [2]
        ((label, reason),) = scene.dropped
        assert label == "feature 1"
        assert reason.startswith("has no WKT")

    @pytest.mark.parametrize("streaming", [True, False])
    def test_the_first_of_two_geometry_columns_is_read(self, tmp_path, streaming, monkeypatch):
        if not streaming:  # as without pyarrow
            monkeypatch.setattr("scenes.readers.vector.find_spec", lambda name: None)
        content = f'id,WKT,geometry\n1,"{POLYGONS[0].wkt}","{POLYGONS[1].wkt}"\n'
        scene = load(write_file(tmp_path / "a.csv", content))
        assert scene.polygons[0].equals(POLYGONS[0])
        assert list(scene.attributes) == ["id"]
        note = ("the first geometry column is read, not geometry",)
        assert scene.notes == (note if streaming else ())

    def test_table_without_geometries_is_refused_with_a_remedy(self, tmp_path):
        path = write_file(tmp_path / "a.csv", "id,h\n1,2\n")
        require_error("name the column of WKT geometries WKT or geometry", path)

    def test_comparison_of_text_with_a_number_gets_a_hint(self, geojson):
        path = geojson(feature([SQUARE], h="12"))
        require_error(r"h is text: CAST\(h AS FLOAT\) is a number", path, where="h > 5")
        assert len(load(path, where="CAST(h AS FLOAT) > 5").polygons) == 1


CIRCLE = "CURVEPOLYGON (CIRCULARSTRING (20 5,25 10,30 5,25 0,20 5))"
SURFACE = "MULTISURFACE (((0 0,9 0,9 9,0 0)),CURVEPOLYGON (COMPOUNDCURVE ((20 5,30 5),"
SURFACE += "CIRCULARSTRING (30 5,25 10,20 5))))"
PATCHES = "TIN Z (((0 0 0,4 0 0,0 4 0,0 0 0)),((4 0 0,4 4 0,0 4 0,4 0 0)))"


def curved_wkb(text: str) -> bytes:
    """Return the WKB of a curve, which GDAL can write but GEOS cannot."""
    library = load_library()
    geometry, wkt = ctypes.c_void_p(), ctypes.c_char_p(text.encode())
    library.OGR_G_CreateFromWkt(ctypes.byref(wkt), None, ctypes.byref(geometry))
    buffer = ctypes.create_string_buffer(library.OGR_G_WkbSize(geometry))
    library.OGR_G_ExportToIsoWkb(geometry, 1, buffer)
    library.OGR_G_DestroyGeometry(geometry)
    return buffer.raw


class TestCurves:
    """In every format curves become chords with a note, and other features are unaffected."""

    AREAS = (16, np.pi * 25, 40.5 + np.pi * 12.5, 16)

    @pytest.mark.parametrize("suffix", [".wkt", ".csv", ".parquet", ".gpkg"])
    def test_formats(self, tmp_path, suffix):
        texts = ["POLYGON ((0 0,4 0,4 4,0 4,0 0))", CIRCLE, SURFACE, PATCHES]
        wkb = [shapely.from_wkt(texts[0]).wkb, *map(curved_wkb, texts[1:])]
        path = tmp_path / f"a{suffix}"
        if suffix == ".wkt":
            path.write_text("\n".join(texts))
        elif suffix == ".csv":
            path.write_text("id,WKT\n" + "".join(f'{i},"{t}"\n' for i, t in enumerate(texts)))
        elif suffix == ".parquet":
            geoparquet(path, wkb, crs=PLANAR)
        else:
            names = np.arange(4)
            pyogrio.raw.write(path, wkb, [names], ["id"], geometry_type="Unknown", crs="EPSG:3067")
        scene = load(path)
        assert_valid_polygons(scene.polygons)
        assert sum(p.area for p in scene.polygons) == pytest.approx(sum(self.AREAS), rel=2e-3)
        reasons = [why for _, why in scene.repaired]
        assert reasons == ["has curves; replaced by chords of 4 degrees"] * 2
        assert scene.dropped == []

    def test_curves_are_dropped_without_gdal(self, tmp_path, monkeypatch):
        monkeypatch.setattr("scenes.readers.wkt.linearize", lambda geometry: None)
        content = f"{CIRCLE}\nPOLYGON ((0 0,4 0,4 4,0 4,0 0))\n"
        scene = load(write_file(tmp_path / "a.wkt", content))
        assert [p.area for p in scene.polygons] == [16]
        assert "curves" in scene.dropped[0][1]

    def test_curve_with_an_srid(self, tmp_path):
        wkb = curved_wkb(CIRCLE)
        extended = wkb[:1] + struct.pack("<II", 10 | 0x20000000, 3067) + wkb[5:]
        for name, content in (("a.wkb", extended), ("a.wkt", extended.hex())):
            scene = load(write_file(tmp_path / name, content))
            assert scene.polygons[0].area == pytest.approx(78.5, rel=2e-3)
            assert (scene.units, scene.notes[-1]) == (
                "m",
                "coordinates in ETRS89 / TM35FIN(E,N), m",
            )


def test_closed_lines_of_a_drawing_are_polygons(tmp_path):
    ring, line = shapely.LinearRing(POLYGONS[0].exterior), [(0, 0), (9, 0), (9, 9), (0, 9)]
    block = shapely.GeometryCollection([shapely.LinearRing(POLYGONS[2].exterior)])
    lines = [ring, shapely.LineString(line), shapely.MultiLineString([block.geoms[0], line])]
    path = tmp_path / "a.dxf"
    pyogrio.raw.write(path, shapely.to_wkb(lines), [], [], geometry_type="LineString", driver="DXF")
    scene = load(path)
    assert sorted(p.area for p in scene.polygons) == [81, 100]
    assert "closed lines are read as polygons" in scene.notes
    assert {reason for _, reason in scene.dropped} == {"is a LineString, not a polygon"}
    nested = shapely.GeometryCollection([block, shapely.Point(0, 0)])
    assert vector._close_geometry(nested).area == 81
    assert vector._close_geometry(shapely.Point(0, 0)).area == 0


def test_topojson_has_longitude_and_latitude(tmp_path):
    ring = [[24.9, 60.1], [24.901, 60.1], [24.901, 60.101], [24.9, 60.101], [24.9, 60.1]]
    topology = {"type": "Topology", "objects": {"a": {"type": "Polygon", "arcs": [[0]]}}}
    for suffix in (".topojson", ".json"):
        path = write_file(tmp_path / f"a{suffix}", json.dumps(topology | {"arcs": [ring]}))
        scene = load(path)
        assert scene.units == "m"
        assert scene.polygons[0].area == pytest.approx(55.6 * 111.4, rel=0.01)
    planar = [[1000 * x, y] for x, y in ring]
    assert load(write_file(path, json.dumps(topology | {"arcs": [planar]}))).units == "units"


class TestArchives:
    def make_zip(self, tmp_path, *names: str) -> Path:
        write(tmp_path / "town.shp")
        path = tmp_path / "town.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for name in names:
                for part in (".shp", ".shx", ".dbf", ".prj"):
                    archive.write(tmp_path / f"town{part}", name + part)
        return path

    def test_a_data_set_in_a_folder(self, tmp_path):
        scene = load(self.make_zip(tmp_path, "data/town"), where="height > 1")
        assert len(scene.polygons) == 2
        assert scene.units == "m"

    def test_several_in_folders_or_none_are_refused(self, tmp_path):
        archive = self.make_zip(tmp_path, "a/b", "c/d")
        require_error(r"several data sets in folders \(a/b.shp, c/d.shp\)", archive)
        with zipfile.ZipFile(tmp_path / "empty.zip", "w") as archive:
            archive.writestr("a/readme.txt", "none")
        require_error("has no data set: unpack it", tmp_path / "empty.zip")

    def test_other_files_at_the_top(self, tmp_path):
        path = self.make_zip(tmp_path, "data/town")
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr("readme.txt", "none")
            archive.writestr("__MACOSX/data/._town.shp", "none")
        assert len(load(path).polygons) == 3
        with zipfile.ZipFile(path, "a") as archive:
            for part in (".shp", ".shx", ".dbf", ".prj"):
                archive.write(tmp_path / f"town{part}", f"town{part}")
        assert len(load(path).polygons) == 3


def test_condition_on_a_shapefile_without_attributes_is_refused(tmp_path):
    path = write(tmp_path / "town.shp")
    (tmp_path / "town.dbf").unlink()
    require_error("attributes are none", path, where="name = 'x'")


def test_unread_files_of_a_folder_of_shapefiles_are_named(tmp_path):
    write(tmp_path / "town.shp")
    write(tmp_path / "park.gpkg")
    (note, *_) = load(tmp_path).notes
    assert note == "1 of the folder's files not read, first park.gpkg: give a file"
    (tmp_path / "readme.txt").write_text("x")
    write(tmp_path / "wood.shp")
    notes = load(tmp_path).notes
    assert notes[1] == "2 of the folder's files not read, first park.gpkg: give a file"


@pytest.mark.parametrize("name", ["a.svg", "a.wkt", "a.off", "a.obj"])
def test_a_layer_of_a_file_without_layers_is_refused(tmp_path, name):
    path = write_file(tmp_path / name, "x")
    require_error(", without layers: leave layer out", path, layer="x")


def without_utf8(path: Path) -> Path:
    """Return a file with a name in Latin 1, as in old files."""
    write(path)
    if path.suffix == ".gpkg":
        with closing(sqlite3.connect(path)) as database, database:
            query = "SELECT name FROM sqlite_master WHERE type = 'trigger'"
            for (trigger,) in database.execute(query).fetchall():
                database.execute(f'DROP TRIGGER "{trigger}"')
            database.execute(f"UPDATE {path.stem} SET name = CAST(X'68E47573' AS TEXT)")
    else:
        table = path.with_suffix(".dbf") if path.suffix == ".shp" else path
        table.write_bytes(table.read_bytes().replace(b"house 1", b"h\xe4user1"))
    return path


@pytest.mark.parametrize("suffix", [".gpkg", ".fgb", ".shp", ".geojson"])
def test_text_that_is_not_utf8_is_marked_and_noted(tmp_path, suffix):
    scene = load(without_utf8(tmp_path / f"old{suffix}"))
    assert len(scene.polygons) == 3
    assert [name for name in scene.attributes["name"] if "\ufffd" in name]
    assert "text of name is not UTF-8: invalid bytes became U+FFFD" in scene.notes


def test_dropped_heights_are_noted(tmp_path):
    flat, tall = POLYGONS[0], shapely.force_3d(POLYGONS[1], 4.0)
    kind = {"geometry_type": "Polygon Z"}
    assert "heights (Z) dropped" in load(write(tmp_path / "a.gpkg", [flat, tall], **kind)).notes
    assert "heights (Z) dropped" not in load(write(tmp_path / "b.gpkg")).notes


def test_notes_are_in_the_first_chunk_only(tmp_path):
    boxes = [shapely.force_3d(shapely.box(i, 0, i + 0.5, 1), 1.0) for i in range(5)]
    path = write(tmp_path / "a.gpkg", boxes, crs="EPSG:4326", geometry_type="Polygon Z")
    first, *later = (chunk.notes for chunk in read_chunks(path, size=2))
    assert len(first) == 2
    assert later == [(), ()]


@pytest.mark.parametrize("streaming", [True, False])
def test_chunks_contain_the_complete_file(tmp_path, streaming, monkeypatch):
    if not streaming:  # as without pyarrow
        monkeypatch.setattr("scenes.readers.vector.find_spec", lambda name: None)
    boxes = [shapely.box(i, 0, i + 0.5, 1) for i in range(25)]
    path = write(tmp_path / "many.gpkg", boxes, crs="EPSG:4326")
    chunks = list(read_chunks(path, size=10))
    assert [len(c.cleaned.polygons) for c in chunks] == [10, 10, 5]
    assert [h for c in chunks for h in c.attributes["height"]] == [3.5 * i for i in range(25)]
    assert all(c.units == "m" for c in chunks)
    polygons = [p for c in chunks for p in c.cleaned.polygons]
    # All chunks have the same projection, so neighbours of different chunks keep the distance.
    within = polygons[10].distance(polygons[11])
    assert polygons[9].distance(polygons[10]) == pytest.approx(within, rel=0.02)


def test_errors_are_one_line_and_name_the_file(tmp_path, geojson):
    font = write_file(tmp_path / "letters.TTF", b"\0\1\0\0" + bytes(60))
    for path, message in (
        (tmp_path / "none.geojson", "not found"),
        (write_file(tmp_path / "empty.gpkg", b""), "is empty"),
        (font, r"is a font: read its letters as glyphs:font=.*TTF,text=abc"),
        (write_file(tmp_path / "text.doc", "text"), "unsupported format: convert it"),
        (tmp_path, "is a folder"),
        (geojson(feature([1, 2], "Point"), name="point.geojson"), "is a Point"),
        (geojson(name="no.geojson"), "holds no polygon"),
    ):
        assert Path(path).name in require_error(message, path)
    require_error(r"cannot be opened: .*null", "a\0b.geojson")


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_csv_with_text_after_a_closing_quote_is_refused(tmp_path, separator):
    """GDAL joins the rows up to the next quote, so that polygons are lost in silence."""
    rows = ['"POLYGON ((0 0,1 0,0 1,0 0))"', '"POLYGON ((0 0,2 0,0 2,0 0))"']
    content = "\n".join([f"WKT{separator}name", *(f'{row}{separator}"a ""b"""' for row in rows)])
    assert len(load(write_file(tmp_path / "whole.csv", content)).polygons) == 2
    torn = write_file(tmp_path / "torn.csv", content.replace(rows[0], rows[0] + '"'))
    require_error(r"torn.csv line 2: text after a closing quote", torn)
