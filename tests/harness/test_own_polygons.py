"""The user's polygons on the command line: parts of a file, and notes about reading."""

import json
from pathlib import Path

import pyogrio
import pytest
import shapely
from pyarrow import parquet

from harness.results.run_folder import read_run
from scenes.projection import find_system
from tests.conftest import assert_refused, make_geojson, require_ok, write_geojson
from tests.harness.test_cli import MOCK
from tests.models.various import MODELS
from tests.scenes.test_files import without_utf8, write

pytestmark = pytest.mark.usefixtures("no_plots")
LOUD = [part for part in MOCK if part != "--quiet"]
HOUSES = [shapely.box(12 * i, 0, 12 * i + 10, 10 + i) for i in range(4)]


@pytest.fixture
def town(tmp_path) -> str:
    path = tmp_path / "town.gpkg"
    write(path, HOUSES, "houses")
    return write(path, [shapely.box(0, 50, 40, 90)], "parks", append=True)


def scene_of(folder: str) -> dict:
    return read_run(Path(folder)).facts["scene"]


def test_a_part_of_a_file(harness, town):
    condition = "height/2 > 1 AND name IN ('house 2', 'house 3')"
    part = ("--layer", "houses", "--where", condition, "--limit", "1")
    run = ("run", "--scene", town, "--triangulators", "fan", "--out", "out", *LOUD)
    require_ok(harness(*run, *part))
    scene = scene_of("out")
    assert scene["polygons"] == 1
    assert scene["parameters"] == {"layer": "houses", "where": condition, "limit": "1"}
    (record,) = read_run(Path("out")).records
    assert record.polygons == 1
    assert record.id.scene == f"town.gpkg:layer=houses,where={condition},limit=1"
    answer = harness("inspect", town, *part[:2], "--where", "height > 4", "--polygon", "9")
    assert_refused(answer, "has polygons 0 to 1, not 9")
    source = f"{town}:layer=houses,where=2 * height > 8"
    assert "2 polygons" in require_ok(harness("triangulate", source, "-o", "out.glb"))[0]


def test_one_line_describes_the_read_file(harness, town):
    code, _, err = harness("run", "--scene", town, "--triangulators", "fan", "--out", "out", *LOUD)
    line = "town: layer houses (others: parks); coordinates in ETRS89 / TM35FIN(E,N), m"
    assert code == 0
    assert err.splitlines().count(line) == 1
    assert scene_of("out")["polygons"] == 4
    assert scene_of("out")["notes"] == line.removeprefix("town: ").split("; ")
    _, err = require_ok(harness("run", "--resume", "out", *LOUD))
    assert "--rasterisers: ignored, as --resume continues the stored plan" in err
    assert len(read_run(Path("out")).records) == 1
    out, err = require_ok(harness("triangulate", town, "-o", "out.parquet"))
    assert "4 polygons" in out
    assert f"{town}: {line.removeprefix('town: ')}" in err


def test_triangulate_accepts_text_other_than_utf8(harness, tmp_path):
    source = without_utf8(tmp_path / "old.gpkg")
    for out in ("out.geojson", "out.parquet", "out.glb"):
        _, err = require_ok(harness("triangulate", str(source), "-o", out))
        assert "text of name is not UTF-8" in err
    names = pyogrio.raw.read("out.geojson")[3][0]
    assert any("\ufffd" in name for name in names)


@pytest.mark.parametrize("crs", ["EPSG:7844", "EPSG:4326"])
def test_geoparquet_names_the_reference_system_except_wgs84(harness, tmp_path, crs):
    degrees = [shapely.box(25, 60, 25.001, 60.001)]
    source = write(tmp_path / "in.gpkg", degrees, crs=crs)
    assert harness("triangulate", source, "-o", "out.parquet")[0] == 0
    column = read_geometry_column("out.parquet")
    assert ("crs" in column) is (crs != "EPSG:4326")
    if "crs" in column:
        assert find_system(json.dumps(column["crs"])) == find_system(crs)
    assert harness("triangulate", "out.parquet", "-o", "again.parquet")[0] == 0
    assert read_geometry_column("again.parquet").get("crs") == column.get("crs")


def read_geometry_column(file: str) -> dict:
    return json.loads(parquet.read_schema(file).metadata[b"geo"])["columns"]["geometry"]


def test_skipped_features_are_named_ten_on_screen_all_in_the_run(harness):
    bow_tie = shapely.Polygon([(3, 0), (4, 1), (4, 0), (3, 1)])
    shapes = [shapely.box(0, 0, 1, 1), *[shapely.Point(0, 0)] * 6, *[None] * 6, bow_tie]
    Path("own.geojson").write_text(make_geojson(shapes))
    arguments = ("--scene", "own.geojson", "--triangulators", "fan", "--out", "out", *LOUD)
    _, err = require_ok(harness("run", *arguments))
    dropped = dict(scene_of("out")["dropped"])
    assert [name for name, _ in scene_of("out")["repaired"]] == ["feature 13"]
    points = {f"feature {number}": "is a Point, not a polygon" for number in range(1, 7)}
    assert dropped == points | {f"feature {number}": "empty geometry" for number in range(7, 13)}
    named = [line for line in err.splitlines() if ": dropped feature " in line]
    assert len(named) == 10
    for line in named:
        name, reason = line.partition("dropped ")[2].split(": ")
        assert dropped.pop(name) == reason
    assert "dropped 2 more; see run.json of a run" in err


def test_the_input_is_never_overwritten(harness):
    """Triangles, charts and models with other diagonals need another name than the input."""
    write_geojson(Path("own.geojson"), [shapely.box(0, 0, 9, 9)])
    Path("own.svg").write_text('<svg><path d="M0 0H9V9H0Z"/></svg>')
    MODELS["plain.glb"](Path("own.glb"))
    for command in (
        ("triangulate", "own.geojson", "-o", "own.geojson"),
        ("triangulate", "own.glb", "-o", "./own.glb"),
        ("inspect", "own.svg", "--sizes", "16", "--out", "own.svg"),
        ("triangulate", "own.svg", "-o", "a.obj", "--certify", "--evidence", "own.svg"),
    ):
        before = Path(command[1]).read_bytes()
        assert_refused(harness(*command), "would overwrite the input; give another name")
        assert Path(command[1]).read_bytes() == before


def test_inspect_prints_notes_and_dropped_features(harness):
    degrees = [shapely.box(n, 50, n + 0.5, 50.5) for n in range(9)]
    Path("degrees.geojson").write_text(make_geojson([*degrees, shapely.box(3, 90, 4, 91)]))
    err = harness("inspect", "degrees.geojson", "--out", "b.png")[2]
    assert "dropped feature 9: has a vertex off the globe" in " ".join(err.split())
    write(Path("bare.gpkg"), degrees, "bare", crs=None)
    err = harness("inspect", "bare.gpkg", "--out", "c.png")[2]
    assert "no reference system; coordinates used unchanged" in " ".join(err.split())


def test_a_shapefile_folder_is_read_once(harness):
    Path("folder").mkdir()
    write(Path("folder/houses.shp"), HOUSES, "houses")
    two = ("--triangulators", "ear-clipping,delaunay")
    Path("folder/houses.shp.xml").write_text("<metadata/>")
    out, _ = require_ok(harness("census", "folder", "-o", "census", *two))
    assert "4 footprints" in out
    code, _, err = harness("census", "folder", "-o", "nothing", *two, "--units-per-pixel", "1000")
    assert code == 4
    assert "no pixel is covered: give a smaller --units-per-pixel" in " ".join(err.split())


def test_models_without_triangles_are_refused(harness):
    Path("lines.obj").write_text("v 0 0 0\nv 1 0 0\nl 1 2\n")
    assert_refused(harness("triangulate", "lines.obj", "--check"), "has no triangles", code=4)


def test_large_polygon_is_announced_with_the_quadratic_steps(harness, monkeypatch):
    """By `run` and `inspect` after loading, by `triangulate` before its triangulation."""
    monkeypatch.setattr("harness.triangulating.triangulate.LARGE_HOLES", 2)
    squares = [shapely.box(x, 0, x + 4, 4) for x in (0, 10)]
    holes = [shapely.box(11 + x, 1, 12 + x, 2).exterior for x in (0, 1.5)]
    squares[1] = shapely.Polygon(squares[1].exterior, holes)
    write_geojson(Path("file.geojson"), squares)
    for command in ("inspect file.geojson --polygon 0", "triangulate file.geojson -o out.obj"):
        code, _, err = harness(*command.split())
        assert code == 0
        (line,) = (line for line in err.splitlines() if "quadratic" in line)
        assert "polygon 1 has 15 vertices and 2 holes; ear clipping" in line
    monkeypatch.undo()
    assert "quadratic" not in harness("inspect", "file.geojson")[2]
