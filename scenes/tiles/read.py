"""Polygons of map tiles, each tile a view of its own, in the tile's own whole coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mapbox_earcut
import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from scenes.cleaning.clean import clean
from scenes.readers import damage
from scenes.readers.opening import existing
from scenes.scene import Note, Scene, SceneError, Tiling
from scenes.suggestions import suggestion
from scenes.tiles.archive import Archive, Folder, Place, column_and_row
from scenes.tiles.mbtiles import MBTiles
from scenes.tiles.pmtiles import PMTiles
from scenes.tiles.vector_tile import Layer, decode

PIXELS = 512
"""Side of a tile on the screen; 256 on old maps, 1024 where a screen is dense."""

USUAL = 16
"""Tiles that are read unless asked otherwise."""

MOST = 100_000
"""Tiles of one scene."""

_SIDES = (8, 4096)
_GRID = 256


@dataclass
class _Found:
    """What was read so far: for each polygon its tile, its layer, its name in messages."""

    polygons: list[shapely.Polygon] = field(default_factory=list)
    layers: list[str] = field(default_factory=list)
    tiles: list[str] = field(default_factory=list)
    first: list[int] = field(default_factory=lambda: [0])
    dropped: list[Note] = field(default_factory=list)
    repaired: list[Note] = field(default_factory=list)
    extents: set[int] = field(default_factory=set)
    known: dict[str, None] = field(default_factory=dict)


def read(
    path: str,
    *,
    zoom: int | None = None,
    layers: str | None = None,
    tiles: str = str(USUAL),
    pixels: int = PIXELS,
    limit: int | None = None,
    attributes: bool = True,
) -> Scene:
    """The polygons of map tiles, in px of their tile, y up.

    path : a PMTiles or MBTiles archive, a folder of .mvt or .pbf files, or one of these
    zoom : by default the largest there is
    layers : names with commas between them; all by default
    tiles : how many, spread evenly over the archive; or west,south,east,north in degrees
    pixels : a tile's side on the screen, an even number

    Nothing is clipped: polygons reach over their tile's edge as far as the tile holds them.
    Coordinates are exact: an invalid polygon is repaired only where no vertex is added between
    whole units, else dropped; a polygon that reaches further than a tile's side is dropped, too.
    Raises SceneError if the file is missing, cannot be read, or holds no polygon for this.
    """
    if pixels % 2 or not _SIDES[0] <= pixels <= _SIDES[1]:
        raise SceneError(
            f"pixels={pixels} is no even number from {_SIDES[0]} to {_SIDES[1]}: give 256, 512 "
            "or 1024"
        )
    found = _Found()
    file = existing(path)
    with damage.clear_errors(path, "map tiles"):
        archive = _opened(file)
        zoom = _zoom(path, archive, zoom)
        names = archive.names(zoom)
        chosen = _chosen(names, tiles, zoom)
        for name in chosen:
            _add(found, archive, name, layers, pixels)
    if not found.polygons:
        raise SceneError(_nothing(path, found, layers, tiles))
    wanted = {"zoom": zoom, "layers": layers, "tiles": tiles, "pixels": pixels, "limit": limit}
    scene = Scene(
        name=Path(path).stem,
        polygons=found.polygons,
        units="px",
        description=str(path),
        licence="as the file's",
        credit=archive.attribution,
        parameters={key: value for key, value in wanted.items() if value is not None},
        dropped=found.dropped,
        repaired=found.repaired,
        attributes=_table(found) if attributes else None,
        notes=_notes(found, len(chosen), len(names), zoom, pixels),
        tiling=Tiling(pixels, tuple(found.tiles), np.array(found.first, np.int64)),
    )
    return scene if limit is None else scene.head(limit)


def _opened(path: Path) -> Archive:
    kinds: dict[str, type[Archive]] = {".pmtiles": PMTiles, ".mbtiles": MBTiles}
    return kinds.get("" if path.is_dir() else path.suffix.lower(), Folder)(path)


def _zoom(path: str, archive: Archive, zoom: int | None) -> int | None:
    if not archive.zooms:
        if zoom is not None:
            raise SceneError(f"{path} does not say at which zoom its tiles are: leave zoom= out")
        return None
    if zoom is None:
        return archive.zooms[-1]
    if zoom not in archive.zooms:
        raise SceneError(
            f"{path} has no zoom {zoom}; it has {archive.zooms[0]} to {archive.zooms[-1]}"
        )
    return zoom


def _chosen(names: Any, tiles: str, zoom: int | None) -> Sequence[Any]:
    """The names of the tiles that are asked for."""
    wrong = SceneError(
        f"tiles={tiles} is neither a number from 1 to {MOST} nor west,south,east,north in degrees"
    )
    if "," in tiles:
        try:
            west, south, east, north = map(float, tiles.split(","))
        except ValueError:
            raise wrong from None
        if zoom is None or not (-180 <= west < east <= 180 and south < north):
            raise wrong
        (left, top), (right, bottom) = (
            column_and_row(*corner, zoom) for corner in ((west, north), (east, south))
        )
        if (right - left + 1) * (bottom - top + 1) > MOST:
            raise SceneError(f"tiles={tiles} are more than {MOST} tiles: give a smaller box")
        columns, rows = range(left, right + 1), range(top, bottom + 1)
        return [Place(zoom, x, y) for x in columns for y in rows]
    if not tiles.isdecimal() or not 1 <= int(tiles) <= MOST:
        raise wrong
    count = min(int(tiles), len(names))
    # the middle of each of `count` equal parts: a larger number does not begin at the first tile
    return [names[(2 * k + 1) * len(names) // (2 * count)] for k in range(count)]


def _add(found: _Found, archive: Archive, name: Any, layers: str | None, pixels: int) -> None:
    """Read one tile; if it is damaged, note that."""
    before = len(found.polygons)
    with damage.noted(found.dropped, f"tile {name}", "cannot be read"):
        data = archive.read(name)
        if data is None:
            return
        decoded = decode(data)
        found.known |= dict.fromkeys(layer.name for layer in decoded)
        wanted = None if layers is None else layers.split(",")
        for layer in decoded:
            if wanted is None or layer.name in wanted:
                _add_layer(found, str(name), layer, pixels)
    if len(found.polygons) > before:
        found.tiles.append(str(name))
        found.first.append(len(found.polygons))


def _add_layer(found: _Found, tile: str, layer: Layer, pixels: int) -> None:
    """Add what is valid, in px, and note what is not."""
    place = f"{tile} {layer.name}"
    found.dropped += [(f"{place} {which}", why) for which, why in layer.dropped]
    found.extents.add(layer.extent)

    def flipped(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        turned: NDArray[np.float64] = xy * [1, -1] + [0, layer.extent]
        return turned

    up = shapely.transform(layer.polygons, flipped)
    labels = [f"{place} feature {k}" for k in layer.feature.tolist()]
    cleaned = clean(up, [f"{label} #{k}" for k, label in enumerate(labels)], flipped)
    crossing = _between_units(cleaned.polygons, cleaned.source)
    far = _reaching(cleaned.polygons, cleaned.source, layer.extent)
    for which, why in cleaned.dropped:
        found.dropped.append((which.partition(" #")[0], why))
    for which, why in cleaned.repaired:
        label, _, number = which.rpartition(" #")
        if int(number) in crossing:
            drawn = _drawn_by_earcut(up[int(number)])
            found.dropped.append((label, f"{why.partition(';')[0]}; {drawn}"))
        else:
            found.repaired.append((label, why))
    for index in sorted(far - crossing):
        found.dropped.append((labels[index], "reaches further than a tile over its tile's edge"))
    gone = list(crossing | far)
    kept = cleaned.polygons[~np.isin(cleaned.source, gone)]
    scale = pixels / layer.extent
    found.polygons += list(shapely.transform(kept, lambda xy: xy * scale))
    found.layers += [layer.name] * len(kept)


def _between_units(polygons: NDArray[Any], source: NDArray[np.int64]) -> set[int]:
    """Which sources have a polygon with a vertex that a repair put between whole units."""
    points, owner = shapely.get_coordinates(polygons, return_index=True)
    return set(source[owner[(points != np.rint(points)).any(axis=1)]].tolist())


def _reaching(polygons: NDArray[Any], source: NDArray[np.int64], extent: int) -> set[int]:
    """Which sources have a polygon that reaches further than a tile's side over the edge."""
    bounds = shapely.bounds(polygons).reshape(-1, 4)
    out = (bounds[:, :2] < -extent).any(axis=1) | (bounds[:, 2:] > 2 * extent).any(axis=1)
    return set(source[out].tolist())


def _drawn_by_earcut(polygon: shapely.Polygon) -> str:
    """What a map client makes of an invalid polygon: the share of its area that earcut draws."""
    rings = [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    points = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    rows = mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3)
    a, b, c = (points[rows[:, k]] for k in range(3))
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    share = np.abs(ux * vy - uy * vx).sum() / 2 / shapely.make_valid(polygon).area
    return f"left out (earcut's triangles have {share:.1%} of its area)"


def _table(found: _Found) -> pd.DataFrame:
    tiles = np.repeat(np.array(found.tiles, dtype=object), np.diff(found.first))
    return pd.DataFrame({"tile": tiles, "layer": found.layers})


def _notes(found: _Found, asked: int, there: int, zoom: int | None, pixels: int) -> tuple[str, ...]:
    """What was chosen, and whether pixels are exact."""
    at = "" if zoom is None else f" of zoom {zoom}"
    notes = [f"{asked} of {there} tiles{at}, {len(found.tiles)} with polygons"]
    notes.append(f"layers {', '.join(dict.fromkeys(found.layers))}")
    notes += [
        f"a unit is 1/{extent} of {pixels} px, which is not on the grid of 1/{_GRID} px: rounded"
        for extent in sorted(found.extents)
        if _GRID * pixels % extent
    ]
    return tuple(notes)


def _nothing(path: str, found: _Found, layers: str | None, tiles: str) -> str:
    """Why there is no polygon, in one line."""
    unknown = [each for each in (layers or "").split(",") if each and each not in found.known]
    if unknown and found.known:
        return (
            f"{path} has no layer {unknown[0]!r}; {suggestion(unknown[0], found.known, 'it has')}"
        )
    if found.dropped:
        which, why = found.dropped[0]
        more = f" and {len(found.dropped) - 1} more" if len(found.dropped) > 1 else ""
        return f"{path} holds no usable polygon: {which} {why}{more}"
    return f"{path} holds no polygon in what tiles={tiles} choose: give more, or another zoom"
