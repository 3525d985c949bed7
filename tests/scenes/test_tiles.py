"""Map tiles: the same polygons as of other readers, unclipped, with notes on dropped polygons."""

import base64
import gzip
import json
import signal
import sqlite3
import tracemalloc
import zlib
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

import mapbox_vector_tile
import numpy as np
import pytest
import shapely
from mapbox_vector_tile.Mapbox import vector_tile_pb2
from pmtiles.tile import (
    Compression,
    Entry,
    TileType,
    serialize_directory,
    serialize_header,
    zxy_to_tileid,
)
from pmtiles.writer import write

from harness.errors import UsageError
from harness.frame import View, get_scene_view, make_scene_frame
from harness.grid import SUBPIXEL
from scenes import SceneError, load
from scenes.readers import tile_archives as archives
from scenes.readers.tile_archives import PMTiles, TilePosition, compute_first_number, decompress
from scenes.readers.vector_tile import Layer, build_layer, decode_layers
from scenes.scene import Note
from scenes.slices import TileSelection, cut_tiles, read_tiles
from scenes.tiles import FILE, locate_tile
from tests.paths import ROOT
from tests.scenes.conftest import require_error, write_file

HERE = ROOT / "tests" / "scenes"
STREETS = sorted((HERE / "tiles").glob("*.mvt*"))
FIXTURES = json.loads((HERE / "mvt_fixtures.json").read_text())["tiles"]
CONTRADICTED = {"016": "003", "057": "051"}
"""Marked valid, but a fixture marked invalid has the same fault; 016 has the same bytes."""
HARMLESS = {"010", "011", "026", "030", "046"}
"""Invalid without loss of a polygon: attributes without values, a feature with two geometries, a
line with a repeated point."""


def read_tile(name: str) -> bytes:
    """Return a tile, written by GDAL or by one of two versions of Mapbox's program."""
    if name == "helsinki":
        tiles = PMTiles(FILE)
        return tiles.read(tiles.list_tile_keys(14)[0]) or b""
    return decompress(next(item for item in STREETS if item.name.startswith(name)).read_bytes())


def decode(tile: bytes) -> list[Layer]:
    return [build_layer(*item) for item in decode_layers(tile).items()]


@pytest.fixture(params=["helsinki", "12-3188-1888", "14-9384-9577"])
def tile(request: pytest.FixtureRequest) -> bytes:
    return read_tile(request.param)


def normalise(polygons: Any) -> list[str]:
    """Return the sorted WKT of polygons, without holes of no area."""
    texts = []
    for polygon in polygons:
        holes = [ring for ring in polygon.interiors if shapely.Polygon(ring).area > 0]
        texts.append(shapely.normalize(shapely.Polygon(polygon.exterior, holes)).wkt)
    return sorted(texts)


def test_polygons_agree_with_mapbox_vector_tile(tile):
    expected_layers = mapbox_vector_tile.decode(tile, default_options={"y_coord_down": True})
    layers = decode(tile)
    assert {layer.name for layer in layers} == set(expected_layers)
    for layer in layers:
        polygons = np.asarray(layer.polygons)
        for number, item in enumerate(expected_layers[layer.name]["features"]):
            parts = shapely.get_parts(shapely.geometry.shape(item["geometry"]))
            areal = [part for part in parts if part.geom_type == "Polygon"]
            assert normalise(polygons[layer.feature == number]) == normalise(areal), number
    assert sum(len(layer.polygons) for layer in layers) > 10


@pytest.mark.parametrize("name", list(FIXTURES))
def test_fixtures_of_the_format_are_read_or_refused_in_a_line(name):
    fixture = FIXTURES[name]
    notes: list[str] = []
    try:
        for layer in decode(base64.b64decode(fixture["base64"])):
            notes += [reason for _, reason in layer.dropped]
    except ValueError as error:
        notes.append(str(error))
    assert all(0 < len(note) < 100 and "\n" not in note for note in notes)
    valid = fixture["valid"] and name not in CONTRADICTED
    assert bool(notes) == (not valid and name not in HARMLESS)


def encoded(polygons: list[Any], layer: str = "land", **more: Any) -> bytes:
    """Return a tile of polygons in integer units, y down."""
    features = [{"geometry": polygon.wkt, "properties": {}} for polygon in polygons]
    content = [{"name": layer, "features": features}]
    return mapbox_vector_tile.encode(content, default_options={"y_coord_down": True, **more})


def save(path: Path, polygons: list[Any], **more: Any) -> str:
    return str(write_file(path, encoded(polygons, **more)))


COURT = shapely.Polygon(
    [(0, 0), (4096, 0), (4096, 2048), (0, 2048)], [[(8, 8), (8, 24), (24, 24), (24, 8)]]
)


def test_a_tile_is_in_pixels_with_y_up(tmp_path):
    scene = load(save(tmp_path / "one.mvt", [COURT]) + ":pixels=256")
    assert scene.units == "px"
    assert scene.polygons[0].bounds == (0, 128, 256, 256)
    assert scene.polygons[0].interiors[0].bounds == (0.5, 254.5, 1.5, 255.5)
    assert scene.tiling.names == ("one.mvt",)
    assert scene.attributes.to_dict("list") == {"tile": ["one.mvt"], "layer": ["land"]}


@pytest.mark.parametrize("pixels", [256, 512, 1024])
def test_vertices_are_on_the_grid_and_unclipped(pixels):
    scene = load(f"helsinki-tiles:zoom=15,tiles=9,pixels={pixels}")
    frame = make_scene_frame(scene, get_scene_view(scene))
    assert frame.view == View(pixels, 0.0, "tile")
    left, bottom, width, height = frame.scissor
    assert (left, bottom, width, height) == (64, 64, pixels, pixels)
    assert frame.width == frame.height == pixels + 128
    assert frame.dropped == frame.repaired == ()
    unit = SUBPIXEL * pixels // 4096
    assert (frame.points % unit == 0).all()
    points = shapely.get_coordinates(np.array(scene.polygons)) + 64
    assert set(map(tuple, (points * SUBPIXEL).tolist())) == set(map(tuple, frame.points.tolist()))
    # Polygons across the edge have vertices on both sides: nothing was clipped.
    assert frame.points.min() < 64 * SUBPIXEL
    assert not any("rounded" in note for note in scene.notes)
    assert frame.tiles.tolist() == scene.tiling.first.tolist()


@pytest.mark.parametrize(("reach", "margin"), [(0, 0), (1, 64), (512, 64), (513, 128), (4096, 512)])
def test_viewport_contains_polygons_that_cross_the_tile_edge(tmp_path, reach, margin):
    path = _raw(tmp_path / "one.mvt", [shapely.box(-reach, 0, 10, 4096 + reach)])
    scene = load(path + ":pixels=512")
    frame = make_scene_frame(scene, get_scene_view(scene))
    assert frame.scissor == (margin, margin, 512, 512)
    assert frame.width == 512 + 2 * margin
    assert frame.points.min() == (margin * 8 - reach) * 32


def test_polygons_stay_in_their_tile_when_others_vanish(tmp_path):
    line = shapely.box(0, 0, 1, 1)  # of 1/512 px
    for name, shapes in (("a", [line, COURT]), ("b", [line]), ("c", [COURT, line, COURT])):
        _raw(tmp_path / f"{name}.mvt", shapes)
    scene = load(f"{tmp_path}:pixels=8")
    assert scene.tiling.first.tolist() == [0, 2, 3, 6]
    frame = make_scene_frame(scene, get_scene_view(scene))
    assert [number for number, _ in frame.dropped] == [0, 2, 4]
    assert frame.tiles.tolist() == [0, 1, 1, 3]


def test_other_extents_are_rounded_with_a_note(tmp_path):
    path = save(tmp_path / "one.mvt", [COURT], extents=5000)
    assert any("1/5000 of 512 px" in note for note in load(path + ":pixels=512").notes)
    assert not any("rounded" in note for note in load(path + ":pixels=1250").notes)


def test_polygons_of_each_tile_stay_together():
    scene = load("helsinki-tiles:zoom=15,tiles=9")
    tile_names = scene.attributes["tile"].to_list()
    assert [tile_names[k] for k in scene.tiling.first[:-1]] == list(scene.tiling.names)
    assert len(dict.fromkeys(tile_names)) == len(scene.tiling.names) == 9
    first = scene.head(scene.tiling.first[1] + 3)
    assert first.tiling.names == scene.tiling.names[:2]
    assert first.tiling.first.tolist() == [0, scene.tiling.first[1], scene.tiling.first[1] + 3]
    exact = scene.head(scene.tiling.first[2])
    assert exact.tiling.names == scene.tiling.names[:2]


def test_only_requested_layers_and_tiles_are_read():
    complete = load(f"helsinki-tiles:zoom=16,tiles=99,limit={10**19}")
    assert complete.notes[0] == "24 of 24 tiles of zoom 16, 24 with polygons"
    assert set(complete.attributes["layer"]) == {"area", "building"}
    some = load("helsinki-tiles:zoom=16,tiles=5,layers=building")
    assert some.notes[0] == "5 of 24 tiles of zoom 16, 5 with polygons"
    assert set(some.attributes["layer"]) == {"building"}
    positions = PMTiles(FILE).list_tile_keys(16)
    assert some.tiling.names == tuple(str(positions[k]) for k in (2, 7, 12, 16, 21))
    around = load("helsinki-tiles:zoom=16,tiles=24.94,60.168,24.945,60.17")
    corners = [locate_tile(24.94, 60.168, 16), locate_tile(24.945, 60.17, 16)]
    assert around.tiling.names[0] == "16/{}/{}".format(*np.min(corners, axis=0))
    assert len(around.tiling.names) <= 4


def encode_features(name: str, kind: int, geometries: Iterable[list[int]]) -> bytes:
    tile = vector_tile_pb2.tile()
    layer = tile.layers.add(name=name, version=2)
    for geometry in geometries:
        layer.features.add(type=kind, geometry=geometry)
    return tile.SerializeToString()


def encode_commands(polygon: shapely.Polygon) -> list[int]:
    x = y = 0
    commands: list[int] = []
    for ring in (polygon.exterior, *polygon.interiors):
        points = [(int(px), int(py)) for px, py in ring.coords[:-1]]
        for number, (px, py) in enumerate(points):
            commands += [9] * (number == 0) + [(len(points) - 1) << 3 | 2] * (number == 1)
            commands += [(step << 1) ^ (step >> 63) for step in (px - x, py - y)]
            x, y = px, py
        commands.append(15)
    return commands


def _raw(path: Path, polygons: list[Any]) -> str:
    """Write a tile of unchanged polygons, which the package would repair."""
    return str(write_file(path, encode_features("land", 3, map(encode_commands, polygons))))


def test_invalid_polygons_are_noted_and_repaired_only_on_integers(tmp_path):
    bow_tie = shapely.Polygon([(0, 0), (31, 30), (31, 0), (0, 20)])  # crosses at a fraction
    squares = [(50, 50), (60, 60), (50, 70), (40, 60), (50, 50), (60, 40), (40, 40)]  # touching
    polygons = [bow_tie, shapely.Polygon(squares), shapely.box(-5000, 0, 10, 10), COURT]
    scene = load(_raw(tmp_path / "bad.mvt", polygons) + ":pixels=512")
    names = [name for name, _ in scene.dropped]
    assert names == ["bad.mvt land feature 0", "bad.mvt land feature 2"]
    crossing, far = (reason for _, reason in scene.dropped)
    assert crossing == "self-intersects at 12.4 12.0; dropped"
    assert far == "exceeds the tile by more than a tile's side"
    assert [name for name, _ in scene.repaired] == ["bad.mvt land feature 1"]
    tiles = {TilePosition(1, 0, 0): encoded(polygons)}
    as_map = load(three_archives(tmp_path, tiles, Compression.NONE)["mbtiles"])
    assert [name for name, _ in as_map.repaired] == ["1/0/0 land feature 1"]
    assert scene.attributes["layer"].to_list() == ["land"] * len(scene.polygons)
    points = shapely.get_coordinates(np.array(scene.polygons)) * 8
    assert (points == np.rint(points)).all()
    assert len(scene.polygons) == 3


def test_ring_without_area_is_noted_and_does_not_set_the_orientation(tmp_path):
    line = shapely.Polygon([(0, 0), (9, 0), (5, 0)])
    rings_of_one = shapely.Polygon(line.exterior, [COURT.exterior, *COURT.interiors])
    scene = load(_raw(tmp_path / "line.mvt", [rings_of_one]) + ":pixels=512")
    assert scene.dropped == [("line.mvt land feature 0", "has a ring without area")]
    assert scene.repaired == []
    assert [polygon.area for polygon in scene.polygons] == [COURT.area / 64]


@pytest.mark.parametrize("move", [(-4097, 0), (4097, 0), (0, -4097), (0, 4097)])
def test_polygons_that_exceed_their_tile_are_dropped(tmp_path, move):
    box = shapely.box(*move, *np.add(move, 4096))
    near = shapely.box(*np.sign(move) * 4096, *np.add(np.sign(move) * 4096, 4096))
    scene = load(_raw(tmp_path / "far.mvt", [box, near]) + ":pixels=512")
    assert [name for name, _ in scene.dropped] == ["far.mvt land feature 0"]
    assert len(scene.polygons) == 1


def pmtiles(path: Path, root: bytes, leaf: bytes = b"", data: bytes = b"", **more: Any) -> str:
    """Write an archive of the given directories, metadata and tiles."""
    header, content = {"clustered": True, "min_zoom": 0, "max_zoom": 0}, b""
    header |= {"tile_type": TileType.MVT, "tile_compression": Compression.NONE}
    header["internal_compression"] = Compression.GZIP
    parts = {"root": root, "metadata": more.pop("metadata", b""), "leaf_directory": leaf}
    for name, part in (parts | {"tile_data": data}).items():
        header |= {f"{name}_offset": 127 + len(content), f"{name}_length": len(part)}
        content += part
    return str(write_file(path, serialize_header(header | more) + content))


def test_directory_that_contains_itself_is_refused(tmp_path):
    leaf = serialize_directory([Entry(0, 0, 30, 0)])
    leaf = serialize_directory([Entry(0, 0, len(leaf), 0)])
    path = pmtiles(tmp_path / "a.pmtiles", leaf, max_zoom=3, leaf_directory_offset=127)
    require_error("a directory contains itself", f"{path}:zoom=3")


def three_archives(
    folder: Path, tiles: dict[TilePosition, bytes], compression: Compression
) -> dict[str, str]:
    """Write the same tiles as PMTiles, MBTiles and files in a folder."""
    pmtiles = folder / "a.pmtiles"
    with write(str(pmtiles)) as writer:
        for position, data in sorted(tiles.items(), key=lambda item: zxy_to_tileid(*item[0])):
            writer.write_tile(zxy_to_tileid(*position), data)
        header = {"tile_type": TileType.MVT, "tile_compression": compression}
        writer.finalize(header, {"attribution": "(c) us"})
    mbtiles = folder / "a.mbtiles"
    with closing(sqlite3.connect(mbtiles)) as database, database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute("CREATE TABLE tiles (zoom_level, tile_column, tile_row, tile_data)")
        metadata = [("format", "pbf"), ("attribution", "(c) us")]
        database.executemany("INSERT INTO metadata VALUES (?, ?)", metadata)
        rows = [(z, x, 2**z - 1 - y, data) for (z, x, y), data in tiles.items()]
        database.executemany("INSERT INTO tiles VALUES (?, ?, ?, ?)", rows)
    for (z, x, y), data in tiles.items():
        write_file(folder / "tiles" / str(z) / str(x) / f"{y}.pbf", data)
    (folder / "tiles" / "metadata.json").write_text('{"attribution": "(c) us"}')
    return {"pmtiles": str(pmtiles), "mbtiles": str(mbtiles), "folder": str(folder / "tiles")}


def two_tiles(folder: Path, pack: Any, compression: Compression) -> dict[str, str]:
    tiles = dict.fromkeys([TilePosition(3, 4, 2), TilePosition(3, 4, 3)], pack(encoded([COURT])))
    return three_archives(folder, tiles, compression)


PACKED = {"none": (bytes, Compression.NONE), "gzip": (gzip.compress, Compression.GZIP)}


@pytest.mark.parametrize("compression", list(PACKED))
def test_archives_have_the_same_content(compression, tmp_path):
    for path in two_tiles(tmp_path, *PACKED[compression]).values():
        scene = load(f"{path}:zoom=3")
        assert set(scene.tiling.names) == {"3/4/2", "3/4/3"}
        assert scene.credit == "(c) us"
        assert [polygon.area for polygon in scene.polygons] == [COURT.area / 64] * 2
        one = load(f"{path}:zoom=3,tiles=1,50,40,60")
        assert one.tiling.names == ("3/4/2",)
        require_error(r"has no zoom 9; it has 3 to 3", f"{path}:zoom=9")


def test_tile_of_several_gzip_members_is_read_completely():
    pieces = gzip.compress(b"one, ") + gzip.compress(b"") + gzip.compress(b"two")
    assert decompress(pieces) == b"one, two"
    for short in (pieces[:-1], pieces[:-9], zlib.compress(encoded([COURT]))[:-6]):
        with pytest.raises(ValueError, match="truncated compressed data"):
            decompress(short)


def test_decompression_has_a_limit(monkeypatch):
    monkeypatch.setattr(archives, "MAX_TILE_BYTES", 2**16)
    packed = gzip.compress(bytes(2**24))
    tracemalloc.start()
    with pytest.raises(ValueError, match="0 MiB or more, uncompressed"):
        decompress(packed)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**20


@pytest.mark.parametrize("kind", [Compression.BROTLI, Compression.ZSTD])
def test_unsupported_compression_is_refused(kind, tmp_path):
    path = two_tiles(tmp_path, bytes, kind)["pmtiles"]
    message = f"a.pmtiles is compressed by {kind.name}, which is unsupported"
    require_error(message, f"{path}:zoom=3")
    zstd = write_file(tmp_path / "a.mvt", b"\x28\xb5\x2f\xfd" + bytes(9))
    require_error("compressed by zstd, which is unsupported", f"{zstd}:pixels=512")


@pytest.mark.parametrize("kind", ["NONE", "GZIP"])
def test_directories_are_decompressed_as_the_header_states(kind, tmp_path):
    pack = {key.upper(): item[0] for key, item in PACKED.items()}
    first = 139  # with 31 entries an uncompressed root begins like gzip
    leaf = gzip.decompress(serialize_directory([Entry(first, 0, 4, 1), Entry(first + 1, 4, 4, 1)]))
    leaf = pack[kind](leaf)
    others = [Entry(first + 2 + k, 8, 4, 1) for k in range(30)]
    root = gzip.decompress(serialize_directory([Entry(first, 0, len(leaf), 0), *others]))
    assert root[:2] == b"\x1f\x8b"
    metadata = pack[kind](b'{"attribution": "us"}')
    zooms = {"min_zoom": 4, "max_zoom": 4, "internal_compression": Compression[kind]}
    file, data = tmp_path / "a.pmtiles", b"aaaabbbbcccc"
    pmtiles(file, pack[kind](root), leaf, data, metadata=metadata, **zooms)
    tiles = PMTiles(file)
    contents = [tiles.read(name) for name in tiles.list_tile_keys(4)]
    assert contents == [b"aaaa", b"bbbb", *[b"cccc"] * 30]
    assert tiles.attribution == "us"


@pytest.mark.parametrize("kind", ["mvt", "application/vnd.mapbox-vector-tile", "PBF", None])
@pytest.mark.parametrize("pack", [gzip.compress, zlib.compress, bytes])
def test_formats_and_compressions_of_mbtiles(tmp_path, kind, pack):
    tile = pack(encoded([shapely.box(0, 0, 100, 100)]))
    path = three_archives(tmp_path, {TilePosition(3, 4, 2): tile}, Compression.NONE)["mbtiles"]
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("UPDATE metadata SET value = ? WHERE name = 'format'", (kind,))
    scene = load(f"{path}:tiles=9")
    assert len(scene.polygons) == 1
    assert scene.dropped == []
    # As a map, although GDAL supports neither the format's name nor the missing layers.
    (polygon,) = load(path).polygons
    side = 2 * 20_037_508.342789244 / 8
    assert polygon.area == pytest.approx((side * 100 / 4096) ** 2)
    assert polygon.bounds[0] == pytest.approx(0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("helsinki-tiles:zoom=11", "has no zoom 11; it has 12 to 16"),
        ("helsinki-tiles:layers=bilding", "has no layer 'bilding'; did you mean building?"),
        ("helsinki-tiles:tiles=0", "neither a number from 1 to 100000 nor west,south,east,north"),
        ("helsinki-tiles:tiles=5,4,3,2", "nor west,south,east,north in degrees"),
        ("helsinki-tiles:tiles=0,0,1,1", "holds no polygon in tiles=0,0,1,1"),
        ("helsinki-tiles:zoom=16,tiles=-170,-80,170,80", "more than 100000 tiles: give a smaller"),
        ("helsinki-tiles:pixels=511", "pixels=511 is not an even number from 8 to 4096"),
        ("FOLDER:pixels=512", "holds no tiles: zoom=, layers=, tiles= and pixels= are for"),
        ("FOLDER/a.gpkg:zoom=3", "a.gpkg holds no tiles"),
        ("FOLDER/a.pmtiles:zoom=3", "not a PMTiles archive: give a PMTiles archive of version 3"),
        ("FOLDER/png.pmtiles:zoom=0", "holds PNG tiles: give Mapbox vector tiles"),
        ("FOLDER/png.mbtiles:zoom=0", "holds tiles of format png: give vector tiles"),
        ("FOLDER/no.mbtiles:zoom=0", "cannot be read as map tiles: no such table: metadata"),
        ("FOLDER/b.mvt:zoom=3", "is unknown: leave zoom= out"),
        ("FOLDER/b.mvt:pixels=512", "usable polygon: tile b.mvt cannot be read: not a vector tile"),
        ("FOLDER/c.mvt:pixels=512", "cannot be read: truncated compressed data"),
    ],
)
def test_unreadable_archives_are_reported_in_one_line(text, message, tmp_path):
    for name, data in {"a.gpkg": b"x", "a.pmtiles": bytes(200), "b.mvt": b"\x1e"}.items():
        (tmp_path / name).write_bytes(data)
    (tmp_path / "c.mvt").write_bytes(gzip.compress(encoded([COURT]))[:-9])
    with write(str(tmp_path / "png.pmtiles")) as writer:
        writer.write_tile(0, b"png")
        writer.finalize({"tile_type": TileType.PNG, "tile_compression": Compression.NONE}, {})
    for name in ("png", "no"):
        with closing(sqlite3.connect(tmp_path / f"{name}.mbtiles")) as database, database:
            database.execute(f"CREATE TABLE {'metadata' if name == 'png' else 'x'} (name, value)")
            if name == "png":
                database.execute("INSERT INTO metadata VALUES ('format', 'png')")
    if text == "FOLDER:pixels=512":
        tmp_path = tmp_path / "empty"
        tmp_path.mkdir()
    require_error(message.replace("(", r"\("), text.replace("FOLDER", str(tmp_path)))


@pytest.mark.parametrize("names", [("x/1/0/0.mvt", "y/1/0/0.mvt"), ("1/0/0.mvt", "1/0/0.pbf")])
def test_two_files_for_a_tile_are_refused(names, tmp_path):
    for name in names:
        save(tmp_path / name, [COURT])
    message = require_error("are both tile 1/0/0: remove one", f"{tmp_path}:zoom=1")
    assert all(name in message for name in names)


@pytest.mark.parametrize(
    ("name", "tile"),
    [
        ("14/9384/9577.MVT", "14/9384/9577"),
        ("x/14-9384-9577.vector.Pbf.GZ", "14/9384/9577"),
        ("0/0/0.mvt", "0/0/0"),
        ("20-06-01.mvt", "20-06-01.mvt"),
        ("20-6-01.mvt", "20-6-01.mvt"),
        ("a/2024-06-01.mvt", "a/2024-06-01.mvt"),
        ("31-6-1.mvt", "31-6-1.mvt"),
        ("2-10-11.mvt", "2-10-11.mvt"),
        ("v1/0/0.mvt", "v1/0/0.mvt"),
    ],
)
def test_positions_in_paths(name, tile, tmp_path):
    save(tmp_path / name, [COURT])
    loaded = archives.Folder(tmp_path)
    assert [str(item) for item in loaded.list_tile_keys(None)] == [tile]
    assert bool(loaded.zooms) == ("." not in tile)


def of_version(number: int, layer: str) -> bytes:
    return encoded([COURT], layer=layer).replace(b"\x78\x02", bytes([0x78, number]))


def read_both(path: Path, layers: str | None) -> tuple[list[str], list[Note], str]:
    """Return the layers, the notes of a scene and the note of a census, which must agree."""
    scene = load(f"{path}:pixels=512" + (f",layers={layers}" if layers else ""))
    names_requested = None if layers is None else tuple(layers.split(","))
    (tile,) = read_tiles(str(path), (0, 1), TileSelection(layers=names_requested))
    loaded = scene.attributes["layer"].to_list()
    assert [layer.name for layer in tile.content.layers if len(layer.polygons)] == loaded
    return loaded, scene.dropped, tile.damage


def test_invalid_layer_is_skipped_and_noted_only_if_requested(tmp_path):
    path = tmp_path / "a.mvt"
    good, bad, nameless = encoded([COURT]), of_version(3, "poi"), of_version(2, "x")
    path.write_bytes(bad + good)
    reason = "cannot be read: layer poi is of version 3, not 1 or 2"
    assert read_both(path, None) == (["land"], [("a.mvt poi", reason)], f"layer poi {reason}")
    assert read_both(path, "land") == (["land"], [], "")
    path.write_bytes(bad + good + bad)
    assert read_both(path, None)[1] == [("a.mvt poi", "cannot be read: layer poi occurs twice")]
    assert read_both(path, "land") == (["land"], [], "")
    path.write_bytes(nameless.replace(b"\x0a\x01x", b"\x32\x01x") + good)
    reason = "cannot be read: a layer has no name"
    assert read_both(path, "land") == (["land"], [("a.mvt", reason)], f"layer {reason}")


def test_write_ahead_log_of_a_database_is_read(tmp_path):
    path = two_tiles(tmp_path, bytes, Compression.NONE)["mbtiles"]
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode=WAL")
        tile = encoded([COURT])
        database.execute("INSERT INTO tiles VALUES (3, 0, 0, ?)", (tile,))
        database.commit()
        scene = load(f"{path}:zoom=3")
        before, size = cut_tiles(path, None).identity, Path(path).stat().st_size
        database.execute("INSERT INTO tiles VALUES (3, 1, 0, ?)", (tile,))
        database.commit()
        assert Path(path).stat().st_size == size
        assert cut_tiles(path, None).identity != before
    assert set(scene.tiling.names) == {"3/4/2", "3/4/3", "3/0/7"}


def test_null_tile_is_damaged(tmp_path):
    path = two_tiles(tmp_path, bytes, Compression.NONE)["mbtiles"]
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("UPDATE tiles SET tile_data = NULL WHERE tile_row = 5")
    scene = load(f"{path}:zoom=3")
    assert scene.tiling.names == ("3/4/3",)
    assert scene.dropped == [("tile 3/4/2", "cannot be read: tile_data is NULL")]
    numbers = compute_first_number(3), compute_first_number(4)
    damaged = {tile.name: tile.damage for tile in read_tiles(path, numbers, TileSelection())}
    assert damaged == {"3/4/2": "cannot be read: tile_data is NULL", "3/4/3": ""}


def test_missing_tiles_of_a_box_are_not_counted(tmp_path):
    path = two_tiles(tmp_path, bytes, Compression.NONE)
    for item in path.values():
        scene = load(f"{item}:zoom=3,tiles=-180,-85,180,85")
        assert scene.notes[0] == "2 of 2 tiles of zoom 3, 2 with polygons"


def test_archive_without_tile_options_is_read_as_a_map():
    heap = load(str(FILE))
    assert heap.tiling is None
    assert heap.units == "m"
    message = "unsupported for map tiles; set the resolution by pixels="
    with pytest.raises(UsageError, match=message):
        make_scene_frame(load("helsinki-tiles:tiles=1"), View(512))


def test_endless_view_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(archives, "QUERY_TIMEOUT_S", 0.2)
    path = tmp_path / "endless.mbtiles"
    with closing(sqlite3.connect(path)) as database, database:
        database.execute("CREATE TABLE metadata (name TEXT, value TEXT)")
        database.execute(
            "CREATE VIEW tiles AS WITH RECURSIVE n(k) AS (SELECT 0 UNION ALL SELECT k + 1 FROM n) "
            "SELECT 3 zoom_level, k tile_column, k tile_row, k tile_data FROM n"
        )
    require_error(r"no row within 0\.2 s; check that tiles is a table", f"{path}:zoom=3")


def test_endless_view_can_be_interrupted(tmp_path, monkeypatch):
    path = two_tiles(tmp_path, bytes, Compression.NONE)["mbtiles"]
    tiles = archives.MBTiles(Path(path))
    endless = "WITH RECURSIVE n(k) AS (SELECT 0 UNION ALL SELECT k + 1 FROM n) SELECT max(k) FROM n"
    signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    with pytest.raises(KeyboardInterrupt):
        list(tiles._query(endless))


def test_duplicate_tile_counts_once(tmp_path):
    path = two_tiles(tmp_path, bytes, Compression.NONE)["mbtiles"]
    with closing(sqlite3.connect(path)) as database, database:
        for _ in range(2):
            database.execute("INSERT INTO tiles SELECT * FROM tiles WHERE tile_row = 4 LIMIT 1")
    scene = load(f"{path}:zoom=3")
    assert scene.notes[0] == "2 of 2 tiles of zoom 3, 2 with polygons"
    assert cut_tiles(path, None).sizes == [2]


def test_uncompressed_tiles_have_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(archives, "MAX_TILE_BYTES", 2**20)
    for name, size in (("large", 2**20), ("zeros", 2**19)):
        (tmp_path / f"{name}.mvt").write_bytes(bytes(size))
    for name, reason in (("large", "1 MiB or more"), ("zeros", "not a vector tile")):
        message = rf"tile {name}\.mvt cannot be read: {reason}"
        require_error(message, f"{tmp_path}/{name}.mvt:pixels=512")


def test_large_directory_is_refused(tmp_path):
    path = pmtiles(tmp_path / "a.pmtiles", gzip.compress(bytes(60 * 2**20)))
    require_error("4 MiB or more, uncompressed", f"{path}:zoom=0")


def test_deeply_nested_metadata_are_ignored(tmp_path):
    nested = gzip.compress(b'{"a":' * 200_000)
    assert PMTiles(Path(pmtiles(tmp_path / "a.pmtiles", b"", metadata=nested))).attribution == ""


def test_archive_without_tiles_is_reported_in_one_line(tmp_path):
    path = pmtiles(tmp_path / "a.pmtiles", b"", min_zoom=3, max_zoom=2)
    for call in (lambda: load(f"{path}:pixels=512"), lambda: cut_tiles(path, None)):
        with pytest.raises(SceneError, match=r"a\.pmtiles holds no tile: give an archive with"):
            call()
    mbtiles = two_tiles(tmp_path, bytes, Compression.NONE)["mbtiles"]
    with closing(sqlite3.connect(mbtiles)) as database, database:
        database.execute("DELETE FROM tiles")
    with pytest.raises(SceneError, match=r"a\.mbtiles holds no tile: give an archive with tiles"):
        cut_tiles(mbtiles, None)
