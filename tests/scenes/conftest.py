import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from scenes import SceneError, load

SQUARE = [[0, 0], [10, 0], [10, 10], [0, 10], [0, 0]]


def feature(coordinates: Any, kind: str = "Polygon", **properties: Any) -> dict[str, Any]:
    geometry = None if coordinates is None else {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


@pytest.fixture
def geojson(tmp_path: Path) -> Callable[..., str]:
    def write(*features: dict[str, Any], name: str = "some.geojson", planar: bool = True) -> str:
        collection: dict[str, Any] = {"type": "FeatureCollection", "features": list(features)}
        if planar:
            collection["crs"] = {"type": "name", "properties": {"name": "EPSG:3857"}}
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(collection))
        return str(path)

    return write


def write_file(path: Path, content: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def require_error(message: str | None, *arguments: Any, **parameters: Any) -> str:
    """Require that `load` fails with a message of one line that matches; return the message."""
    with pytest.raises(SceneError, match=message) as caught:
        load(*arguments, **parameters)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def assert_valid_polygons(polygons: list[shapely.Polygon]) -> None:
    array = np.asarray(polygons)
    assert len(array) > 0
    assert shapely.is_valid(array).all()
    assert not shapely.has_z(array).any()
    assert (shapely.area(array) > 0).all()
    for polygon in polygons:
        assert isinstance(polygon, shapely.Polygon)
        assert polygon.exterior.is_ccw
        assert not any(ring.is_ccw for ring in polygon.interiors)
