"""A valid file of each format, and the outcome of reading damaged files."""

import gzip
import json
import tempfile
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import shapely
from pmtiles.tile import Compression

from scenes import Scene, SceneError, load
from scenes.readers.tile_archives import TilePosition
from tests.scenes.conftest import assert_valid_polygons

COUNT = 24
BOXES = [shapely.box(20 * i, 0, 20 * i + 10, 9 + i / 8) for i in range(COUNT)]
_OPTIONS = {
    "csv": {"driver": "CSV", "layer_options": {"GEOMETRY": "AS_WKT"}},
    "dxf": {"driver": "DXF", "crs": None},
    "kml": {"driver": "KML", "crs": "EPSG:4326"},
    "geojsonl": {"crs": "EPSG:4326"},
}
_BY_GDAL = (
    *("geojson", "geojsonl", "gpkg", "sqlite", "fgb", "gml", "kml", "jml", "csv", "dxf", "gmt"),
    *("shp", "shx", "dbf", "mif", "mid", "tab", "map", "dat", "id"),
)
_MODELS = ("obj", "ply", "ascii.ply", "off", "stl", "ascii.stl", "glb", "gltf")
_OTHERS = ("parquet", "wkt", "wkb", "svg", "city.json", "city.jsonl")
_TILES = ("mvt", "mvt.gz", "pmtiles", "mbtiles")
KINDS = (*_BY_GDAL, *_MODELS, *_OTHERS, *_TILES)

_MAIN = {"shx": "shp", "dbf": "shp", "mid": "mif", "map": "tab", "dat": "tab", "id": "tab"}
"""Main file of data sets of several files, by suffix."""

_SILENT = ("gmt", "obj", "mif")
"""Formats without a length or an end mark."""


def is_truncation_visible(kind: str, data: bytes, length: int) -> bool:
    """Whether the first `length` bytes of a file are recognisable as truncated."""
    truncated = data[:length]
    if kind in _SILENT or data[length:].strip() == b"":
        return False
    if kind == "csv":
        return truncated.count(b'"') % 2 == 1
    if kind in ("geojsonl", "wkt", "city.jsonl"):
        return not truncated.endswith(b"\n") and not data[length:].startswith((b"\n", b"\r"))
    return True


@cache
def make_files(kind: str) -> dict[str, bytes]:
    """Return the files of a valid data set by name, including `a.<kind>`."""
    with tempfile.TemporaryDirectory() as folder:
        _write(Path(folder, f"a.{_MAIN.get(kind, kind)}"))
        return {file.name: file.read_bytes() for file in Path(folder).iterdir()}


def _write(path: Path) -> None:
    from tests.scenes.test_readers import PLANAR, cityjson_sequence, geoparquet

    kind = path.name.partition(".")[2]
    shapes = "".join(f'<path d="M{20 * i} 0h9v9h-9z m2 2v4h4v-4z"/>' for i in range(1, COUNT))
    lines = cityjson_sequence(COUNT // 2)
    if kind in _BY_GDAL:
        options = {"crs": "EPSG:3067"} | _OPTIONS.get(kind, {})
        fields = [] if kind == "dxf" else [np.array([f"house {i}" for i in range(COUNT)], object)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            names = ["name"] * len(fields)
            wkb = shapely.to_wkb(BOXES)
            pyogrio.raw.write(path, wkb, fields, names, geometry_type="Polygon", **options)
    elif kind in _MODELS:
        _write_model(path, kind)
    elif kind in _TILES:
        _write_tiles(path, kind)
    elif kind == "parquet":
        geoparquet(path, BOXES, crs=PLANAR, h=[1.0] * COUNT)
    elif kind == "wkb":
        path.write_bytes(shapely.to_wkb(shapely.MultiPolygon(BOXES)))
    else:
        path.write_text(
            {
                "wkt": f"{BOXES[0].wkb_hex}\n" + "".join(f"{box.wkt}\n" for box in BOXES[1:]),
                "svg": f'<svg><g transform="scale(2)">{shapes}<circle r="4"/></g></svg>',
                "city.json": json.dumps(_city(lines)),
                "city.jsonl": "".join(f"{line}\n" for line in lines),
            }[kind]
        )


def _city(lines: list[str]) -> dict[str, object]:
    model = json.loads(lines[0])
    for line in lines[1:]:
        feature = json.loads(line)
        ((name, thing),) = feature["CityObjects"].items()
        shift = len(model["vertices"])
        ((ground, roof, *walls),) = thing["geometry"][0]["boundaries"]
        shells = [[[[i + shift for i in ring] for ring in side] for side in (ground, roof, *walls)]]
        thing["geometry"][0]["boundaries"] = shells
        model["vertices"] += feature["vertices"]
        model["CityObjects"][name] = thing
    return model


def _write_model(path: Path, kind: str) -> None:
    import trimesh

    faces = [list(box.exterior.coords)[:-1] for box in BOXES]
    if kind == "obj":
        points = "".join(f"v {x} {y} 0\n" for face in faces for x, y in face)
        rings = "".join(f"f {i} {i + 1} {i + 2} {i + 3}\n" for i in range(1, 4 * COUNT, 4))
        path.write_text(points + rings)
        return
    vertices = np.array([[x, y, 0.0] for face in faces for x, y in face])
    first = 4 * np.arange(COUNT)[:, None]
    triangles = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    more = {"ascii.ply": {"encoding": "ascii"}, "ascii.stl": {"file_type": "stl_ascii"}}
    trimesh.Trimesh(vertices, triangles, process=False).export(path, **more.get(kind, {}))


def _write_tiles(path: Path, kind: str) -> None:
    """Write all boxes in a tile, or a tile per box."""
    from tests.scenes.test_tiles import encoded, three_archives

    if kind in ("mvt", "mvt.gz"):
        tile = encoded(BOXES)
        path.write_bytes(gzip.compress(tile) if kind == "mvt.gz" else tile)
        return
    tiles = {
        TilePosition(5, 3, 2 + i): gzip.compress(encoded([box])) for i, box in enumerate(BOXES)
    }
    with tempfile.TemporaryDirectory() as folder:
        written = three_archives(Path(folder), tiles, Compression.GZIP)[kind]
        path.write_bytes(Path(written).read_bytes())


def make_way(number: int, nodes: str, **tags: str) -> str:
    refs = "".join(f'<nd ref="{node}"/>' for node in nodes)
    pairs = "".join(f'<tag k="{k}" v="{v}"/>' for k, v in tags.items())
    return f'<way id="{number}" version="1">{refs}{pairs}</way>'


def make_osm(corners: list[tuple[float, float]], *ways: str) -> str:
    nodes = ""
    for number, (lon, lat) in enumerate(corners, 1):
        nodes += f'<node id="{number}" lat="{lat}" lon="{lon}" version="1"/>'
    return f'<osm version="0.6">{nodes}{"".join(ways)}</osm>'


def load_or_refuse(path: Path, **parameters: Any) -> Scene | None:
    """Return the scene of a file, or None for an error of one line that names the file."""
    try:
        scene = load(path, **parameters)
    except SceneError as error:
        message = str(error)
        assert message.isprintable()
        assert str(path.with_suffix("")) in message
        return None
    assert_valid_polygons(scene.polygons)
    if scene.attributes is not None:
        # Some libraries decode text only when used.
        assert scene.attributes.to_csv()
    return scene


NAMED = "read, missing polygons noted"


def outcome(kind: str, damaged: bytes, length: int | None = None) -> str:
    """Return the outcome of reading a file of these bytes; AssertionError if polygons are missing.

    With `length`, the bytes are the first of the valid file: missing polygons must be noted, or the
    file refused.
    """
    files = make_files(kind)
    with tempfile.TemporaryDirectory() as folder:
        for name, content in files.items():
            Path(folder, name).write_bytes(damaged if name == f"a.{kind}" else content)
        path = Path(folder, f"a.{_MAIN.get(kind, kind)}")
        scene = load_or_refuse(path, **({"tiles": "99"} if kind in _TILES else {"project": False}))
    if scene is None:
        return "refused"
    if damaged == files[f"a.{kind}"]:
        assert len(scene.polygons) == COUNT
    if length is None:
        return "read"
    if not is_truncation_visible(kind, files[f"a.{kind}"], length):
        return "read, not recognisable as truncated"
    accounted = len(scene.polygons) + len(scene.dropped)
    assert accounted >= COUNT, f"{kind} truncated at {length}: {accounted} of {COUNT} polygons"
    return NAMED
