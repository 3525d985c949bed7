"""Map tiles in slices that are read apart from each other, by different machines.

A slice is a run of tiles of one zoom, by their numbers in the archive. To cut an archive takes its
directory alone, a piece at a time; to read a slice takes its own tiles alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from scenes.readers import damage
from scenes.readers.opening import existing
from scenes.scene import SceneError
from scenes.slices import Slices, edges, identity_of
from scenes.spec import arguments_for, exists, parsed
from scenes.tiles.archive import Archive, Place, Run
from scenes.tiles.opening import opened
from scenes.tiles.tile import Parts, parts_of
from scenes.tiles.usable import PIXELS, check_pixels

MOST_TILES, MOST_BYTES = 4096, 2**21
"""Of a slice, where it has several tiles: bytes as they are stored."""

_TILE = re.compile(r"\.mvt(\.gz)?$", re.IGNORECASE)
_ARCHIVE = re.compile(r"\.(pmtiles|mbtiles)$", re.IGNORECASE)


@dataclass(frozen=True)
class Chosen:
    """What of an archive is read.

    zooms : the first and the last; None for all
    layers : their names; None for all
    pixels : a tile's side on the screen
    """

    zooms: tuple[int, int] | None = None
    layers: tuple[str, ...] | None = None
    pixels: int = PIXELS


def chosen(text: str) -> tuple[str, Chosen] | None:
    """A file, folder or pattern of map tiles and what is asked for; None where it is none.

    Raises SceneError for a parameter that cannot be.

    >>> chosen("berlin.pmtiles:zoom=12-16,layers=water")
    ('berlin.pmtiles', Chosen(zooms=(12, 16), layers=('water',), pixels=512))
    >>> chosen("berlin.gpkg") is None
    True
    """
    name, given = parsed(text)
    archives = any(_ARCHIVE.search(each.name) for each in [Path(name), *_inside(name)])
    asked = not {"zoom", "layers", "pixels"}.isdisjoint(given)
    if not (asked or archives or _TILE.search(name) or is_folder(name)):
        return None
    return name, _chosen(**arguments_for(name, _chosen, given))


def _chosen(*, zoom: str | None = None, layers: str | None = None, pixels: int = PIXELS) -> Chosen:
    check_pixels(pixels)
    names = None if layers is None else tuple(layers.split(","))
    if zoom is None:
        return Chosen(None, names, pixels)
    match = re.fullmatch(r"(\d{1,2})(?:-(\d{1,2}))?", zoom)
    first, last = map(int, (match[1], match[2] or match[1])) if match else (1, 0)
    if first > last:
        raise SceneError(f"zoom={zoom} is no zoom nor a range: give zoom=14 or zoom=12-16")
    return Chosen((first, last), names, pixels)


def is_folder(name: str) -> bool:
    """Whether this is a folder of tiles, by what lies in it: zooms, or tiles."""
    return any(
        _TILE.search(each.name) or (each.name.isdecimal() and each.is_dir())
        for each in _inside(name)
    )


def _inside(name: str) -> list[Path]:
    return list(Path(name).iterdir()) if exists(name) and Path(name).is_dir() else []


def cut(path: str, zooms: tuple[int, int] | None) -> Slices:
    """Cut an archive into slices; sizes are in tiles, of which a run of equal ones is one.

    Raises SceneError if it is missing, cannot be read, or has no tile of these zooms.
    """
    file = existing(path)
    rows: list[tuple[int, int] | None] = []
    sizes: list[int] = []
    with damage.clear_errors(path, "map tiles"):
        archive = opened(file)
        for zoom in _zooms(path, archive, zooms):
            for first, last, size in _cut(archive.runs(zoom)):
                rows.append((first, last))
                sizes.append(size)
    if not rows:
        raise SceneError(f"{path} holds no tile of what is asked for: give another zoom")
    return Slices(identity_of(file, _content(file)), rows, sizes)


def _zooms(path: str, archive: Archive, zooms: tuple[int, int] | None) -> Iterable[int | None]:
    if not archive.zooms:
        if zooms is not None:
            raise SceneError(f"{path} does not say at which zoom its tiles are: leave zoom= out")
        return (None,)
    first, last = zooms or (archive.zooms[0], archive.zooms[-1])
    found = [zoom for zoom in archive.zooms if first <= zoom <= last]
    if not found:
        which = f"zoom {first}" if first == last else f"zooms {first} to {last}"
        there = f"it has {archive.zooms[0]} to {archive.zooms[-1]}"
        raise SceneError(f"{path} has no {which}; {there}")
    return found


def _cut(runs: Iterable[Run]) -> Iterator[tuple[int, int, int]]:
    """First number, the one after the last, and runs, of slices of a zoom."""
    first = last = tiles = size = 0
    for run in runs:
        if tiles and (tiles == MOST_TILES or size + run.size > MOST_BYTES):
            yield first, last, tiles
            tiles = size = 0
        if not tiles:
            first = run.number
        last, tiles, size = run.number + run.times, tiles + 1, size + run.size
    if tiles:
        yield first, last, tiles


def _content(file: Path) -> bytes:
    """What changes with a file's content, or with that of the files of a folder."""
    if not file.is_dir():
        return edges(file)
    about = ((each, each.stat()) for each in sorted(file.rglob("*")) if each.is_file())
    lines = (f"{each.relative_to(file)} {s.st_size} {int(s.st_mtime)}" for each, s in about)
    return "\n".join(lines).encode()


class Tile(NamedTuple):
    """What was read of a tile.

    zoom : None where the archive does not say
    times : tiles in a row that have the same bytes
    """

    name: str
    zoom: int | None
    times: int
    parts: Parts

    @property
    def damage(self) -> str:
        """Why it, or layers of it, cannot be read; "" where all can."""
        layers = (f"layer {name}".strip() + f" {why}" for name, why in self.parts.damaged)
        return "; ".join(filter(None, (*layers, self.parts.damage)))


def read_tiles(path: str, numbers: tuple[int, int], what: Chosen) -> Iterator[Tile]:
    """Read the tiles of a slice one by one; of a layer that is damaged, nothing is kept.

    Raises SceneError if the file is missing or cannot be read.
    """
    with damage.clear_errors(path, "map tiles"):
        archive = opened(existing(path))
        for name, times in archive.between(*numbers):
            zoom = name.zoom if archive.zooms and isinstance(name, Place) else None
            parts = parts_of(archive, name, what.layers, what.pixels)
            yield Tile(str(name), zoom, times, parts)
