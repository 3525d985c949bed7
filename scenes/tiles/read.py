"""Polygons of map tiles, each tile a view of its own, in the tile's own whole coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import shapely

from scenes.readers import guard
from scenes.readers.guard import existing
from scenes.scene import Note, Scene, SceneError, Tiling
from scenes.spec import suggestion
from scenes.tiles.archives import Archive, Place, Run, column_and_row, opened
from scenes.tiles.tile import PIXELS, check_pixels, parts_of, rounding

USUAL = 16
"""Tiles that are read unless asked otherwise."""

MOST = 100_000
"""Tiles of one scene."""


@dataclass
class _Found:
    """What was read so far: for each polygon its tile, its layer, its name in messages.

    absent : tiles that the archive has not
    """

    polygons: list[shapely.Polygon] = field(default_factory=list)
    layers: list[str] = field(default_factory=list)
    tiles: list[str] = field(default_factory=list)
    first: list[int] = field(default_factory=lambda: [0])
    dropped: list[Note] = field(default_factory=list)
    repaired: list[Note] = field(default_factory=list)
    extents: set[int] = field(default_factory=set)
    known: dict[str, None] = field(default_factory=dict)
    absent: int = 0


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
    check_pixels(pixels)
    found = _Found()
    file = existing(path)
    with guard.clear_errors(path, "map tiles"):
        archive = opened(file)
        zoom = _zoom(path, archive, zoom)
        runs = list(archive.runs(zoom))
        there = sum(run.times for run in runs)
        chosen = _chosen(archive, runs, tiles, zoom)
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
        notes=_notes(found, len(chosen) - found.absent, there, zoom, pixels),
        tiling=Tiling(pixels, tuple(found.tiles), np.array(found.first, np.int64)),
    )
    return scene if limit is None else scene.head(limit)


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


def _chosen(archive: Archive, runs: Sequence[Run], tiles: str, zoom: int | None) -> Sequence[Any]:
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
    ends = np.cumsum([run.times for run in runs], dtype=np.int64)
    there = int(ends[-1]) if len(ends) else 0
    count = min(int(tiles), there)
    # the middle of each of `count` equal parts: a larger number does not begin at the first tile
    middles = [(2 * k + 1) * there // (2 * count) for k in range(count)]
    of = np.searchsorted(ends, middles, side="right").tolist()
    lasts = [runs[k].number + runs[k].times - int(ends[k]) for k in of]
    return [archive.name_of(last + middle) for last, middle in zip(lasts, middles, strict=True)]


def _add(found: _Found, archive: Archive, name: Any, layers: str | None, pixels: int) -> None:
    """Read one tile: add what is usable, in px, and note what is not."""
    wanted = None if layers is None else layers.split(",")
    parts = parts_of(archive, name, wanted, pixels)
    found.absent += parts.absent
    found.known |= dict.fromkeys(parts.known)
    before = len(found.polygons)
    for layer, extent, own in parts.layers:
        place = f"{name} {layer}"
        found.extents.add(extent)
        found.dropped += [(f"{place} {which}", why) for which, why in own.dropped]
        found.repaired += [(f"{place} {which}", why) for which, why in own.repaired]
        found.polygons += list(own.polygons)
        found.layers += [layer] * len(own.polygons)
    found.dropped += [(f"{name} {layer}".strip(), why) for layer, why in parts.damaged]
    if parts.damage:
        found.dropped.append((f"tile {name}", parts.damage))
    if len(found.polygons) > before:
        found.tiles.append(str(name))
        found.first.append(len(found.polygons))


def _table(found: _Found) -> pd.DataFrame:
    tiles = np.repeat(np.array(found.tiles, dtype=object), np.diff(found.first))
    return pd.DataFrame({"tile": tiles, "layer": found.layers})


def _notes(
    found: _Found, chosen: int, there: int, zoom: int | None, pixels: int
) -> tuple[str, ...]:
    """What was chosen, and whether pixels are exact."""
    at = "" if zoom is None else f" of zoom {zoom}"
    notes = [f"{chosen} of {there} tiles{at}, {len(found.tiles)} with polygons"]
    notes.append(f"layers {', '.join(dict.fromkeys(found.layers))}")
    return (*notes, *rounding(found.extents, pixels))


def _nothing(path: str, found: _Found, layers: str | None, tiles: str) -> str:
    """Why there is no polygon, in one line."""
    unknown = [each for each in (layers or "").split(",") if each and each not in found.known]
    if unknown and found.known:
        return (
            f"{path} has no layer {unknown[0]!r}; {suggestion(unknown[0], found.known, 'it has')}"
        )
    if found.dropped:
        which, why = found.dropped[0]
        more = f" (and {len(found.dropped) - 1} more)" if len(found.dropped) > 1 else ""
        return f"{path} holds no usable polygon: {which} {why}{more}"
    return f"{path} holds no polygon in what tiles={tiles} choose: give more, or another zoom"
