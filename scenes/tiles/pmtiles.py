"""PMTiles: an archive of map tiles that is read a directory at a time."""

from __future__ import annotations

import gzip
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from scenes.readers import cut_off
from scenes.scene import SceneError
from scenes.tiles.archive import (
    Archive,
    Place,
    Run,
    attribution_of,
    first_of,
    needed,
    unpacked,
)

_DEEPEST = 30


class PMTiles(Archive):
    """A PMTiles archive, version 3, read by the package pmtiles a directory at a time.

    header : as that package gives it
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._format = needed("pmtiles.tile")
        try:
            self.header = self._format.deserialize_header(self._bytes(0, 127))
        except (self._format.MagicNumberNotFound, self._format.SpecVersionUnsupported) as error:
            why = "is no PMTiles archive" if "Magic" in type(error).__name__ else "is not version 3"
            raise SceneError(f"{path} {why}: give one, or write it again") from None
        header, kinds = self.header, self._format.TileType
        for part in ("metadata", "leaf_directory", "tile_data"):
            self._bytes(header[f"{part}_offset"] + header[f"{part}_length"], 0)
        if header["tile_type"] not in (kinds.MVT, kinds.UNKNOWN):
            kind = header["tile_type"].name
            raise SceneError(f"{path} holds {kind} tiles: give one of Mapbox vector tiles (MVT)")
        packings = self._format.Compression
        read = (packings.NONE, packings.GZIP, packings.UNKNOWN)
        for part in ("tile", "internal"):
            if header[f"{part}_compression"] not in read:
                name = header[f"{part}_compression"].name
                raise SceneError(f"{path} is packed by {name}, which is not read: pack it by gzip")
        self.zooms = tuple(range(header["min_zoom"], min(header["max_zoom"], _DEEPEST) + 1))
        metadata = self._inner(header["metadata_offset"], header["metadata_length"])
        self.attribution = attribution_of(metadata)

    def _inner(self, start: int, count: int) -> bytes:
        """A directory or the metadata, unpacked as the header says of these."""
        data = self._bytes(start, count)
        plain = self.header["internal_compression"] == self._format.Compression.NONE
        return data if plain else unpacked(data)

    def _bytes(self, start: int, count: int) -> bytes:
        with self._path.open("rb") as stream:
            size = self._path.stat().st_size
            if start + count > size:
                where = f"it has {size} bytes, and byte {start + count} is asked for"
                raise cut_off.error(self._path, where)
            stream.seek(start)
            return stream.read(count)

    def names(self, zoom: int | None) -> Sequence[Any]:
        """Along the Hilbert curve, as the archive numbers them."""
        zoom = self.zooms[-1] if zoom is None else zoom
        return self._chosen(first_of(zoom), first_of(zoom + 1))

    def _chosen(self, first: int, last: int) -> _Runs:
        self._runs = _Runs(self._entries(first, last), first, last, self._format)
        return self._runs

    def runs(self, zoom: int | None) -> Iterator[Run]:
        """Numbered along the Hilbert curve."""
        assert zoom is not None
        first, last = first_of(zoom), first_of(zoom + 1)
        for entry, start, end in _within(self._entries(first, last), first, last):
            yield Run(start, end - start, entry.length)

    def between(self, first: int, last: int) -> Iterator[tuple[Any, int]]:
        """The tiles of an entry are a run."""
        for start, count in self._chosen(first, last).starts():
            yield Place(*self._format.tileid_to_zxy(start)), count

    def _entries(self, first: int, last: int) -> Iterator[Any]:
        """The entries of tiles from `first` to before `last`, in order, through all directories."""
        header = self.header
        todo: list[Any] = [(header["root_offset"], header["root_length"])]
        seen: set[int] = set()
        while todo:
            place = todo.pop()
            if isinstance(place, self._format.Entry):
                yield place
                continue
            if place[0] in seen:
                raise ValueError("a directory of it is within itself")
            seen.add(place[0])
            # The package takes directories packed by gzip alone.
            entries = self._format.deserialize_directory(gzip.compress(self._inner(*place), 0))
            ends = [entry.tile_id for entry in entries[1:]] + [last]
            found: list[Any] = []
            for entry, end in zip(entries, ends, strict=True):
                if entry.tile_id >= last or (entry.run_length == 0 and end <= first):
                    continue
                if entry.run_length:
                    found.append(entry)
                else:
                    found.append((header["leaf_directory_offset"] + entry.offset, entry.length))
            todo += reversed(found)

    def packed(self, name: Any) -> bytes | None:
        """What the archive has for a place of the zoom whose names were asked for last."""
        entry = self._runs.entry_of(self._format.zxy_to_tileid(*name))
        if entry is None:
            return None
        return self._bytes(self.header["tile_data_offset"] + entry.offset, entry.length)


def _within(entries: Iterable[Any], first: int, last: int) -> Iterator[tuple[Any, int, int]]:
    """Entries with a tile from `first` to before `last`, that tile, and the one after their last.

    An entry that does not begin after the one before it is damage, and left out.
    """
    before = -1
    for entry in entries:
        start, end = max(entry.tile_id, first), min(entry.tile_id + entry.run_length, last)
        if before < start < end:
            before = start
            yield entry, start, end


class _Runs(Sequence[Place]):
    """Tiles of a PMTiles archive, of which a run of many may be one entry."""

    def __init__(self, entries: Iterator[Any], first: int, last: int, form: Any) -> None:
        self._form = form
        self._entries: list[Any] = []
        self._starts: list[int] = []
        self._before = [0]
        for entry, start, end in _within(entries, first, last):
            self._entries.append(entry)
            self._starts.append(start)
            self._before.append(self._before[-1] + end - start)

    def starts(self) -> Iterator[tuple[int, int]]:
        """The first tile of each run, and how many tiles it has."""
        counts = (after - before for before, after in pairwise(self._before))
        yield from zip(self._starts, counts, strict=True)

    def __len__(self) -> int:
        return self._before[-1]

    def __getitem__(self, number: Any) -> Any:
        if not 0 <= number < len(self):
            raise IndexError(number)
        run = bisect_right(self._before, number) - 1
        tile = self._starts[run] + number - self._before[run]
        return Place(*self._form.tileid_to_zxy(tile))

    def entry_of(self, tile: int) -> Any:
        """The entry that holds a tile, by its number; None if none does."""
        run = bisect_right(self._starts, tile) - 1
        if run < 0 or tile - self._entries[run].tile_id >= self._entries[run].run_length:
            return None
        return self._entries[run]
