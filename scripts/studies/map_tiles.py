"""What triangles in map tiles cost in bytes and save in helper lanes: docs/studies/map-tiles.md.

    PYTHONPATH=. python scripts/studies/map_tiles.py --out results/map-tiles [--second FOLDER]

Writes lanes.csv, bytes.csv and views.csv. What is there of a data set and zoom is left alone, so a
study that was stopped goes on. FOLDER holds tiles of a second data set: real-world/sanfrancisco of
npm's @mapbox/mvt-fixtures.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.unknown_fields import UnknownFieldSet
from mapbox_vector_tile.Mapbox import vector_tile_pb2
from numpy.typing import NDArray

from harness.figures.index_bytes import index_data, packers, triangles_of
from harness.frame import SUBPIXEL, Frame, frame_of, view_of
from harness.rasterisers import Options
from harness.rasterisers.reference import predict
from harness.rasterisers.submission_order import submission
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.recipes import parse
from scenes import Scene, load
from scenes.real.helsinki_tiles import FILE, ZOOMS
from scenes.tiles.archive import Archive, Folder, Place
from scenes.tiles.pmtiles import PMTiles
from scenes.tiles.vector_tile import decode
from scenes.tiles.wire import packed

BASE = "ear-clipping"
OPTIMUM = "optimal:half-perimeter"
NAMES = (BASE, "earcut-refine", "flips:l1", OPTIMUM, "optimal:expected-quads")
BACK = "sorted-back"
"""Sorted along rings as the harness runs through them, which is the other way than a tile does."""

ORDERS = ("native", "walk", "vertex-cache", "sorted", BACK)
FIELD = 16
"""Of a tile: the first number that the format leaves to extensions."""

CACHE = 16
SCALES, TURNS = (0.7, 0.85, 1.0, 1.2, 1.4), (0, 30)
PITCHES, TILTED_SCALES = (30, 60), (0.7, 1.0, 1.4)
DISTANCE = 1.5 * 1024
"""Of the camera, in px at full size: MapLibre's, before a viewport of 1024 px."""

DRAWS = 2000
LANES = ("data", "zoom", "triangulator", "tiles", "polygons", "dropped", "triangles", "fragments",
         "quads", "helper_lanes", "ratio", "low", "high")  # fmt: skip
BYTES = ("data", "zoom", "triangulator", "order", "packing", "triangles", "tile_bytes", "added",
         "vertices_shaded")  # fmt: skip
VIEWS = ("data", "zoom", "triangulator", "pitch", "scale", "turn", "helper_lanes", "ratio")


def main() -> None:
    """Read the command line and measure what is missing."""
    given = arguments(__doc__)
    for data, zoom, text, archive in subjects(given.second):
        if not done(given.out / "views.csv", data, zoom):
            scene = load(text)
            _measure(given.out, data, zoom, scene, archive)


def arguments(description: str | None) -> argparse.Namespace:
    """Read the command line: out, a folder, which is made; second, a folder of tiles or None."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--second", type=Path)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    return given


def subjects(second: Path | None) -> list[tuple[str, int, str, Archive]]:
    """Name, zoom, scene and archive of all that is measured; `second` is a folder of tiles."""
    found: list[tuple[str, int, str, Archive]] = [
        ("helsinki", zoom, f"helsinki-tiles:zoom={zoom},tiles=999", PMTiles(FILE)) for zoom in ZOOMS
    ]
    if second:
        archive = Folder(second)
        (zoom,) = archive.zooms
        found.append((second.name, zoom, f"{second}:tiles=999", archive))
    return found


def _measure(out: Path, data: str, zoom: int, scene: Scene, archive: Archive) -> None:
    """Append the rows of one zoom: views.csv last, by which it is known to be done."""
    about = {"data": data, "zoom": zoom}
    frame = frame_of(scene, view_of(scene))
    rows = {}
    for name in NAMES:
        made = triangulate_polygons(parse(name), frame.polygons)
        if any(part is None for part in made.parts):
            raise SystemExit(f"{name} left out polygons of {data}, zoom {zoom}")
        rows[name] = frame.join(made.parts)
    archive.names(zoom)  # the zoom that is read from
    known = {**about, "tiles": len(scene.tiling.names), "polygons": len(frame.source)}
    lanes = [{**known, "dropped": len(scene.dropped), **row} for row in _lanes(frame, rows)]
    sizes = [{**about, **row} for row in _bytes(scene, frame, rows, archive)]
    append(out / "lanes.csv", LANES, lanes)
    append(out / "bytes.csv", BYTES, sizes)
    append(out / "views.csv", VIEWS, [{**about, **row} for row in _views(frame, rows)])
    sys.stdout.write(f"{data}, zoom {zoom}: {len(frame.source)} polygons\n")


def _lanes(frame: Frame, rows: dict[str, NDArray[np.int32]]) -> Iterator[dict[str, Any]]:
    """Counters of each triangulator, and its helper lanes in ratio to the base's."""
    helpers: dict[str, NDArray[np.int64]] = {}
    rng = np.random.default_rng(0)
    for name, triangles in rows.items():
        counted = predict(frame.points, triangles, frame.window)
        tiles = frame.draws(triangles)
        helpers[name] = np.array([counted["helper_lanes"][tile].sum() for tile in tiles])
        ratio = helpers[name].sum() / helpers[BASE].sum()
        low = high = ""
        if len(tiles) > 1:
            drawn = rng.integers(0, len(tiles), (DRAWS, len(tiles)))
            ratios = helpers[name][drawn].sum(axis=1) / helpers[BASE][drawn].sum(axis=1)
            low, high = (f"{each:.4f}" for each in np.percentile(ratios, [2.5, 97.5]))
        sums = {key: int(counted[key].sum()) for key in ("fragments", "quads", "helper_lanes")}
        interval = {"ratio": f"{ratio:.4f}", "low": low, "high": high}
        yield {"triangulator": name, "triangles": len(triangles), **sums, **interval}


def _bytes(
    scene: Scene, frame: Frame, rows: dict[str, NDArray[np.int32]], archive: Archive
) -> Iterator[dict[str, Any]]:
    """Bytes that triangles add to real tiles, for each order and packing."""
    numbering = _of_the_tile(frame)
    tiles = [archive.read(_name(each, archive)) or b"" for each in scene.tiling.names]
    _check_numbering(scene, frame, numbering, tiles)
    pack = {"none": bytes, **packers()}
    plain = {way: sum(len(function(tile)) for tile in tiles) for way, function in pack.items()}
    for name, triangles in rows.items():
        for order in ORDERS:
            if order == BACK:
                ordered = numbering[in_order(frame, triangles, "sorted")]
            else:
                ordered = in_order(frame, numbering[triangles], order)
            full = []
            assert frame.tiles is not None
            shaded = 0
            for number, each in enumerate(frame.draws(ordered)):
                offsets = frame.offsets[frame.tiles[number] : frame.tiles[number + 1] + 1]
                index = index_data(ordered[each], offsets)
                full.append(with_index(tiles[number], index))
                if not np.array_equal(
                    triangles_of(index_of(full[-1]), offsets), by_polygon(ordered[each], offsets)
                ):
                    raise SystemExit(f"{name}, {order}: a tile has other triangles when read back")
                shaded += vertices_shaded(ordered[each])
            for way, function in pack.items():
                added = sum(len(function(tile)) for tile in full) - plain[way]
                yield {
                    "triangulator": name,
                    "order": order,
                    "packing": way,
                    "triangles": len(triangles),
                    "tile_bytes": plain[way],
                    "added": added,
                    "vertices_shaded": shaded,
                }


def in_order(frame: Frame, triangles: NDArray[np.int32], order: str) -> NDArray[np.int32]:
    """Triangles in one of `ORDERS`, tile by tile.

    Sorted is by the numbers of vertices, each triangle turned so that its least comes first.
    """
    if order != "sorted":
        return submission(frame, triangles, Options(order=order))
    least = triangles.argmin(axis=1)[:, None]
    turned = np.take_along_axis(triangles, (least + np.arange(3)) % 3, axis=1)
    return turned[np.lexsort(turned.T[::-1])]


def _name(text: str, archive: Archive) -> Any:
    return Place(*map(int, text.split("/"))) if archive.zooms else text


def _of_the_tile(frame: Frame) -> NDArray[np.int32]:
    """(n,) where each of the frame's points is in its tile, which has y down.

    So a ring runs the other way there, from the same vertex.
    """
    ends = frame.ring_ends
    starts = np.concatenate([[0], ends[:-1]])
    sizes = ends - starts
    place = np.arange(len(frame.points)) - np.repeat(starts, sizes)
    return (np.repeat(starts, sizes) + -place % np.repeat(sizes, sizes)).astype(np.int32)


def _check_numbering(
    scene: Scene, frame: Frame, numbering: NDArray[np.int32], tiles: list[bytes]
) -> None:
    """End the study if a vertex is not the one that the tile has under its number."""
    assert frame.tiles is not None
    assert frame.scissor is not None
    unit, checked = SUBPIXEL * frame.scissor[2] // 4096, 0
    for number, tile in enumerate(tiles):
        found = [polygon for layer in decode(tile) for polygon in layer.polygons]
        rings = [ring for polygon in found for ring in (polygon.exterior, *polygon.interiors)]
        own = np.concatenate([np.asarray(ring.coords)[:-1] for ring in rings])
        first, last = frame.offsets[frame.tiles[number : number + 2]]
        if len(own) != last - first:
            continue  # a polygon was dropped
        points = np.empty((last - first, 2))
        points[numbering[first:last] - first] = frame.points[first:last]
        points = points / unit - SUBPIXEL * frame.scissor[0] // unit
        checked += 1
        if not np.array_equal(points, own * [1, -1] + [0, 4096]):
            raise SystemExit(f"tile {scene.tiling.names[number]} numbers its vertices otherwise")
    sys.stdout.write(f"vertices are numbered as in {checked} of {len(tiles)} tiles\n")


def with_index(tile: bytes, index: bytes) -> bytes:
    """A tile with index data in a field that other readers pass over."""
    return tile + packed(np.array([FIELD << 3 | 2, len(index)])) + index


def index_of(tile: bytes) -> bytes:
    """The index data of a tile, read by protobuf, which must find its layers, too."""
    message = vector_tile_pb2.tile()
    message.ParseFromString(tile)
    if not message.layers:
        raise SystemExit("a tile has lost its layers")
    return next(bytes(each.data) for each in UnknownFieldSet(message) if each.field_number == FIELD)


def by_polygon(rows: NDArray[np.int32], offsets: NDArray[np.int64]) -> NDArray[np.int32]:
    """Triangles polygon by polygon, in their order within each."""
    return rows[np.argsort(np.searchsorted(offsets, rows[:, 0], side="right"), kind="stable")]


def vertices_shaded(rows: NDArray[np.int32]) -> int:
    """Vertices that a cache of `CACHE`, first in, first out, does not find."""
    cache: OrderedDict[int, None] = OrderedDict()
    missed = 0
    for vertex in rows.ravel().tolist():
        if vertex not in cache:
            missed += 1
            cache[vertex] = None
            if len(cache) > CACHE:
                cache.popitem(last=False)
    return missed


def _views(frame: Frame, rows: dict[str, NDArray[np.int32]]) -> Iterator[dict[str, Any]]:
    """Helper lanes of the triangles that were chosen upright at full size, in other views."""
    views = [(0, turn, scale) for turn in TURNS for scale in SCALES]
    views += [(p, turn, scale) for p in PITCHES for turn in TURNS for scale in TILTED_SCALES]
    for pitch, turn, scale in views:
        points = seen(frame, pitch, turn, scale)
        lanes = {n: int(predict(points, r)["helper_lanes"].sum()) for n, r in rows.items()}
        for name, count in lanes.items():
            ratio = f"{count / lanes[BASE]:.4f}"
            row = {"triangulator": name, "pitch": pitch, "scale": scale, "turn": turn}
            yield {**row, "helper_lanes": count, "ratio": ratio}


def seen(frame: Frame, pitch: float, turn: float, scale: float) -> NDArray[np.int32]:
    """(n, 2) where a tile's vertices are in a view, in 1/256 px.

    turn, pitch : degrees, of the map and of the camera that looks at the middle of the tile
    """
    centre = frame.width * SUBPIXEL / 2
    angle, tilt = np.radians([turn, pitch])
    to = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    flat = (frame.points - centre) @ to.T * scale
    away = flat[:, 1] * np.sin(tilt)
    nearer = DISTANCE * SUBPIXEL / (DISTANCE * SUBPIXEL + away)
    projected = flat * [1.0, np.cos(tilt)] * nearer[:, None]
    return np.rint(projected + 2 * centre).astype(np.int32)


def done(path: Path, data: str, zoom: int) -> bool:
    """Whether a table has rows of a zoom."""
    if not path.exists():
        return False
    with path.open() as file:
        return any((row["data"], row["zoom"]) == (data, str(zoom)) for row in csv.DictReader(file))


def append(path: Path, columns: tuple[str, ...], rows: list[dict[str, Any]]) -> None:
    """Add rows to a table; those of a zoom that was stopped half-way are written once more."""
    before: list[dict[str, Any]] = []
    keys = {(row["data"], str(row["zoom"])) for row in rows}
    if path.exists():
        with path.open() as file:
            before = [r for r in csv.DictReader(file) if (r["data"], r["zoom"]) not in keys]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows([*before, *rows])


if __name__ == "__main__":
    main()
