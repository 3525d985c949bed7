"""Fixtures that all tests share."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from shapely.geometry import Polygon, box, mapping

ROOT = Path(__file__).resolve().parent.parent
SHARED_DATA = ROOT.parent / "shared" / "data"


def write_geojson(path: Path, polygons: list[Polygon]) -> Path:
    """Write polygons in metres to a GeoJSON file."""
    features = [
        {"type": "Feature", "properties": {"id": number}, "geometry": mapping(polygon)}
        for number, polygon in enumerate(polygons)
    ]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::3067"}}
    content = {"type": "FeatureCollection", "crs": crs, "features": features}
    path.write_text(json.dumps(content))
    return path


@pytest.fixture(scope="session", autouse=True)
def _own_model_database(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep tests, and the programs they start, away from the user's model database."""
    with pytest.MonkeyPatch.context() as patch:
        place = tmp_path_factory.mktemp("cache") / "triangulations.sqlite"
        patch.setenv("RASTER_HARNESS_CACHE", str(place))
        yield


@pytest.fixture
def block(tmp_path: Path) -> Path:
    """A GeoJSON file of three footprints: an L, a courtyard, a square."""
    ell = Polygon([(0, 0), (12, 0), (12, 4), (4, 4), (4, 10), (0, 10)])
    courtyard = box(20, 0, 36, 16).difference(box(24, 4, 32, 12))
    return write_geojson(tmp_path / "block.geojson", [ell, courtyard, box(0, 20, 8, 28)])
