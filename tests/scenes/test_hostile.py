"""Readers return valid polygons or an error of one line for any bytes."""

import gzip
import json
import random
import zipfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scenes import SceneError, load
from scenes.readers import guard
from tests.scenes.conftest import SQUARE, feature, require_error, write_file
from tests.scenes.samples import load_or_refuse, make_files
from tests.scenes.test_files import write
from tests.scenes.test_readers import HOLED, geoparquet

FUZZ = settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def test_file_with_an_invalid_arrow_header_is_refused(tmp_path):
    """pyarrow raises a separate exception for these four changed bytes of a FlatGeobuf file."""
    path = Path(write(tmp_path / "a.fgb"))
    data, rng = bytearray(path.read_bytes()), random.Random(930)
    for _ in range(4):
        data[rng.randrange(len(data))] = rng.randrange(256)
    path.write_bytes(data)
    assert load_or_refuse(path) is None


@pytest.mark.parametrize(
    "kind", ["geojson", "gpkg", "fgb", "parquet", "wkt", "wkb", "svg", "city.json", "obj", "ply"]
)
def test_exceptions_of_libraries_become_one_line(tmp_path, monkeypatch, kind):
    path = tmp_path / f"a.{kind}"
    path.write_bytes(make_files(kind)[path.name])

    def fail(*_, **__):
        raise Exception("first line\nsecond")

    # Each reader uses one of these for geometries.
    for function in (
        *("shapely.from_wkb", "shapely.from_wkt"),
        "scenes.readers.svg.fill_contours",
        "scenes.readers.cityjson._read_vertices",
        "scenes.readers.meshes.arrange_in_rows",
    ):
        monkeypatch.setattr(function, fail)
    assert path.name in require_error("first line second", path)


@pytest.mark.parametrize(
    ("raised", "expected", "message"),
    [
        (KeyboardInterrupt, KeyboardInterrupt, None),
        (SystemExit, SystemExit, None),
        (MemoryError, SceneError, "needs more memory than available"),
    ],
)
def test_exits_and_lack_of_memory_are_not_reported_as_unreadable_files(
    tmp_path, monkeypatch, raised, expected, message
):
    def fail(*_, **__):
        raise raised

    monkeypatch.setattr("shapely.from_wkb", fail)
    path = write_file(tmp_path / "a.wkb", HOLED.wkb)
    with pytest.raises(expected, match=message):
        load(path)


@pytest.mark.parametrize(
    "kind",
    ["geojson", "gpkg", "shp", "fgb", "pbf", "wkt", "wkb", "svg", "obj", "ply", "json", "xyz"],
)
@FUZZ
@given(data=st.binary(max_size=200) | st.text(max_size=100).map(str.encode))
def test_arbitrary_bytes(tmp_path, kind, data):
    load_or_refuse(write_file(tmp_path / f"a.{kind}", data))


number = st.integers(-10, 10) | st.floats(allow_nan=False, allow_infinity=False)
ring = st.lists(st.lists(number, min_size=2, max_size=3), max_size=8)
coordinates = st.lists(ring, max_size=3) | st.lists(st.lists(ring, max_size=3), max_size=3) | ring


@FUZZ
@given(
    st.lists(coordinates, max_size=4), st.sampled_from(["Polygon", "MultiPolygon", "LineString"])
)
def test_arbitrary_geojson(tmp_path, polygons, kind):
    collection = {"type": "FeatureCollection", "features": [feature(c, kind) for c in polygons]}
    load_or_refuse(write_file(tmp_path / "a.geojson", json.dumps(collection)))


def test_condition_can_only_select(tmp_path):
    path = geoparquet(tmp_path / "a.parquet", [HOLED], h=[1.0])
    for condition in ("1); DROP TABLE features; --", "h = 1; SELECT 1", "load_extension('x')"):
        require_error("invalid condition", path, where=condition)


@pytest.mark.parametrize("suffix", [".wkt", ".obj", ".geojson", ".gpkg", ".ply", ".svg", ".json"])
def test_files_of_a_gigabyte_of_zeros_are_refused(tmp_path, suffix):
    path = tmp_path / f"huge{suffix}"
    with path.open("wb") as stream:  # a sparse file
        stream.truncate(2**30)
    assert load_or_refuse(path) is None


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".svg", ".wkb", ".city.json", ".stl"])
def test_files_read_at_once_have_a_size_limit(tmp_path, monkeypatch, suffix):
    path = write_file(tmp_path / f"a{suffix}", b'{"type": "CityJSON"' + bytes(2**20))
    monkeypatch.setattr(guard, "MAX_FILE_BYTES", 2**20)
    require_error("limit is 1,048,576", path)


def town(features: int) -> bytes:
    collection = {"type": "FeatureCollection", "features": [feature([SQUARE])] * features}
    return json.dumps(collection).encode()


def zipped(path: Path, content: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.geojson", content)
    return path


@pytest.mark.parametrize("suffix", [".zip", ".shz"])
def test_zip_bomb_is_refused(tmp_path, monkeypatch, suffix):
    bomb = zipped(tmp_path / f"a{suffix}", town(1) + b" " * 2**22)
    monkeypatch.setattr(guard, "MAX_FILE_BYTES", 2**20)
    require_error(r"unpacks to 4,.* bytes, more than 100 times the archive", bomb)


def test_usual_archives_are_read(tmp_path, monkeypatch):
    assert len(load(zipped(tmp_path / "a.zip", town(1) + b" " * 2**22)).polygons) == 1
    monkeypatch.setattr(guard, "MAX_FILE_BYTES", 1000)
    path = zipped(tmp_path / "b.zip", town(30))
    assert path.stat().st_size < 1000 < len(town(30))
    assert len(load(path).polygons) == 30


def test_recursive_entities_are_refused(tmp_path):
    lines = ['<!ENTITY a0 "M0 0h9v9z">']
    lines += [f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12)]
    content = f'<!DOCTYPE svg [{"".join(lines)}]><svg><path d="&a11;"/></svg>'
    assert load_or_refuse(write_file(tmp_path / "laughs.svg", content)) is None


@pytest.mark.parametrize("name", ["a.geojson.gz", "a.geojson", "a.wkt", "a.svgz"])
def test_compressed_files_are_refused_by_their_compression(tmp_path, name):
    path = write_file(tmp_path / name, gzip.compress(town(1)))
    require_error("is compressed by gzip: unpack it first", path)


@pytest.mark.parametrize("name", ["a.geojson", "a.geojsonl", "a.csv", "a.wkt", "a.obj"])
def test_utf16_is_refused(tmp_path, name):
    path = write_file(tmp_path / name, town(1).decode().encode("utf-16"))
    require_error("is text in UTF-16: save it as UTF-8", path)


def test_unknown_content_is_not_reported_as_damaged(tmp_path):
    for name in ("a.xyz", "a.mbtiles", "a.glb", "a.parquet", "a.gpkg"):
        path = write_file(tmp_path / name, "anything else")
        assert "damaged" not in require_error(None, path)
