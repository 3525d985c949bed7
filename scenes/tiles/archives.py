"""Where map tiles lie: folders of files, MBTiles, PMTiles; all list and give tiles in one way.

Tiles have numbers, those of a zoom in a row. What lists them gives runs: an archive may say in one
entry that a million tiles of the sea are the same.
"""

import gzip
import io
import json
import math
import re
import sqlite3
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from scenes.readers import guard
from scenes.scene import SceneError
from scenes.spec import install

MOST_BYTES = 64 * 2**20
"""Of an unpacked tile; clients expect some hundred kilobytes."""

MOST_IN_DIRECTORY = 4 * 2**20
"""Bytes of a directory or the metadata of PMTiles, unpacked; writers make some ten kilobytes."""

ANSWER_S = 60.0
"""Longest wait for a row of an SQLite database, in which a view may never end."""

_STEPS = 100_000  # of SQLite's machine, some milliseconds, from one look at the clock to the next
_DEEPEST = 30
_NUMBER = r"(0|[1-9]\d{0,9})"
_FILE = re.compile(
    rf"(?:(?:^|/)([12]?\d|30)[/_-]{_NUMBER}[/_-]{_NUMBER}(?!\d))?[^/]*\.(mvt|pbf)(\.gz)?$",
    re.IGNORECASE,
)
"""A tile's file, and its zoom, column and row if its path tells them; no date with zeros does."""

_ZSTD = b"\x28\xb5\x2f\xfd"


class Place(NamedTuple):
    """A tile's zoom, column from the west and row from the north."""

    zoom: int
    x: int
    y: int

    def __str__(self) -> str:
        return "/".join(map(str, self))


class Run(NamedTuple):
    """Tiles that follow each other in an archive and have the same bytes: mostly one.

    number : of the first, as the archive numbers its tiles, those of a zoom in a row
    times : how many they are
    size : bytes of one, as it is stored
    """

    number: int
    times: int
    size: int


class Archive(ABC):
    """Tiles that can be counted before any is read.

    zooms : that there are, in order; () for files that do not say where they belong
    attribution : what the archive says of whose data they are
    """

    zooms: tuple[int, ...] = ()
    attribution: str = ""

    @abstractmethod
    def __init__(self, path: Path) -> None:
        """Look at what the path holds; raises SceneError where that is no tiles."""

    @abstractmethod
    def runs(self, zoom: int | None, first: int = 0, last: int | None = None) -> Iterator[Run]:
        """The tiles of a zoom, by growing numbers, one by one: there may be many millions.

        `first` to before `last` are the numbers that are wanted. Neighbours are near each other.
        """

    def names(self, zoom: int | None) -> list[Any]:
        """What all tiles of a zoom are called, in order."""
        runs = self.runs(zoom)
        return [self.name_of(run.number + k) for run in runs for k in range(run.times)]

    @abstractmethod
    def name_of(self, number: int) -> Any:
        """What a tile is called: its `Place`, or a file's path."""

    @abstractmethod
    def packed(self, name: Any) -> bytes | None:
        """A tile's bytes as they are stored; None if there is no such tile."""

    def zooms_of(self, path: str, wanted: tuple[int, int] | None) -> Sequence[int | None]:
        """Those that there are from the first wanted to the last; (None,) where none is known.

        Raises SceneError, which names `path`, where there is none of these.
        """
        if not self.zooms:
            if wanted is not None:
                raise SceneError(
                    f"{path} does not say at which zoom its tiles are: leave zoom= out"
                )
            return (None,)
        first, last = wanted or (self.zooms[0], self.zooms[-1])
        found = [zoom for zoom in self.zooms if first <= zoom <= last]
        if not found:
            which = f"zoom {first}" if first == last else f"zooms {first} to {last}"
            there = f"it has {self.zooms[0]} to {self.zooms[-1]}"
            raise SceneError(f"{path} has no {which}; {there}")
        return found

    def zoom_of(self, number: int) -> int | None:
        """The zoom of a tile, by its number; None for files that do not say."""
        return ((3 * number + 1).bit_length() - 1) // 2

    def read(self, name: Any) -> bytes | None:
        """A tile's bytes, unpacked; raises ValueError where they cannot be."""
        data = self.packed(name)
        return None if data is None else unpacked(data)


def opened(path: Path) -> Archive:
    """The archive that a path is; raises SceneError where it is none."""
    return KINDS.get("" if path.is_dir() else path.suffix.lower(), Folder)(path)


def first_of(zoom: int) -> int:
    """The number of the first tile of a zoom, where all of the world's are numbered by zooms.

    >>> [first_of(zoom) for zoom in range(4)]
    [0, 1, 5, 21]
    """
    return int(4**zoom - 1) // 3


def unpacked(data: bytes, most: int | None = None) -> bytes:
    """A tile as the format defines it; its first bytes say whether gzip has packed it.

    All members of gzip are read. Raises ValueError if one cannot be unpacked, or all have `most`
    bytes (`MOST_BYTES`) or more then.
    """
    most = most or MOST_BYTES
    if data[:4] == _ZSTD:
        raise ValueError("it is packed by zstd, which is not read: pack it by gzip")
    if data[:2] == b"\x1f\x8b":
        try:
            data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(most)
        except EOFError:
            raise ValueError("its packed bytes are cut off") from None
    if len(data) >= most:
        raise ValueError(f"it has {most // 2**20} MiB or more, unpacked")
    return data


def attribution_of(metadata: bytes) -> str:
    """Whose data the tiles are, by an archive's metadata in JSON; "" where it does not say."""
    with suppress(ValueError, AttributeError, RecursionError):
        return str(json.loads(metadata).get("attribution") or "")
    return ""


def needed(package: str) -> Any:
    """An optional package; SceneError where it is not installed."""
    try:
        return import_module(package)
    except ImportError:
        raise SceneError(
            f"these tiles need the package {package.partition('.')[0]}: {install('tiles')}"
        ) from None


class Folder(Archive):
    """A file, or a folder of files named z/x/y.mvt or z-x-y.pbf, or otherwise; packed or not.

    Tiles are numbered zoom by zoom, in the order of their paths.
    """

    def __init__(self, path: Path) -> None:
        found: dict[Any, Path] = {}
        folder = path if path.is_dir() else path.parent
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            name: Any = file.relative_to(folder).as_posix()
            match = _FILE.search(name)
            if not (match and file.is_file()):
                continue
            if match[1]:
                place = Place(*map(int, match.groups()[:3]))
                name = place if max(place.x, place.y) < 2**place.zoom else name
            if name in found:
                raise SceneError(f"{found[name]} and {file} are both tile {name}: keep one of them")
            found[name] = file
        if not found:
            raise SceneError(
                f"{path} holds no tiles: zoom=, layers=, tiles= and pixels= are for .pmtiles, "
                ".mbtiles, .mvt and .pbf files, and folders of these"
            )
        self._files = found
        placed = [name for name in found if isinstance(name, Place)]
        self._names: list[Any] = list(found)
        if len(placed) == len(found):
            self.zooms = tuple(sorted({place.zoom for place in placed}))
            self._names = sorted(placed, key=lambda place: place.zoom)
        with suppress(OSError):
            self.attribution = attribution_of((path / "metadata.json").read_bytes())

    def runs(self, zoom: int | None, first: int = 0, last: int | None = None) -> Iterator[Run]:
        """Each file by itself."""
        for number, name in enumerate(self._names[first:last], first):
            if zoom is None or name[0] == zoom:
                yield Run(number, 1, self._files[name].stat().st_size)

    def zoom_of(self, number: int) -> int | None:
        """That of its path, where all have one."""
        return self._names[number].zoom if self.zooms else None

    def name_of(self, number: int) -> Any:
        """Its place, or its path in the folder."""
        return self._names[number]

    def packed(self, name: Any) -> bytes | None:
        """A file's bytes, of one that is too large not more than show that."""
        if name not in self._files:
            return None
        with self._files[name].open("rb") as stream:
            return stream.read(MOST_BYTES)


class MBTiles(Archive):
    """An SQLite database of tiles, whose rows count from the south; numbered column by column."""

    def __init__(self, path: Path) -> None:
        guard.check_cut_off(path)
        self._path = path
        self._uri = f"{path.resolve().as_uri()}?mode=ro"
        log = Path(f"{path.resolve()}-wal")
        if not (log.is_file() and log.stat().st_size):  # what was written last is in it
            self._uri += "&immutable=1"
        facts = dict(self._ask("SELECT name, value FROM metadata"))
        kind = facts.get("format", "pbf")
        if kind != "pbf":
            raise SceneError(f"{path} holds tiles of format {kind}: give one of vector tiles")
        self.attribution = str(facts.get("attribution") or "")
        rows = self._ask(
            "SELECT DISTINCT zoom_level FROM tiles WHERE zoom_level BETWEEN 0 AND 30 ORDER BY 1"
        )
        self.zooms = tuple(int(zoom) for (zoom,) in rows)
        if not self.zooms:
            raise SceneError(f"{path} holds no tile: give an archive with tiles")

    def _ask(self, query: str, values: tuple[Any, ...] = ()) -> Iterator[Any]:
        """The rows of an answer; SceneError where one takes longer than `ANSWER_S`.

        SQLite runs without Python, which then hears no Ctrl-C. So it looks at the clock now and
        then; what Python raises there, SQLite takes as a wish to be interrupted.
        """
        begun = time.monotonic()
        with closing(sqlite3.connect(self._uri, uri=True)) as database:
            database.set_progress_handler(lambda: time.monotonic() - begun > ANSWER_S, _STEPS)
            rows: Iterator[Any] | None = None
            while True:
                begun = time.monotonic()
                try:
                    rows = database.execute(query, values) if rows is None else rows
                    row = next(rows, None)
                except sqlite3.OperationalError as error:
                    if "interrupted" not in str(error):
                        raise
                    if time.monotonic() - begun <= ANSWER_S:
                        raise KeyboardInterrupt from None
                    raise SceneError(
                        f"{self._path} gives no answer within {ANSWER_S:g} s: it is damaged, or a "
                        "view in it never ends"
                    ) from None
                if row is None:
                    return
                yield row

    def runs(self, zoom: int | None, first: int = 0, last: int | None = None) -> Iterator[Run]:
        """Each tile by itself, once; what lies beyond the map is no tile."""
        assert zoom is not None
        side, begin = 2**zoom, first_of(zoom)
        last = first_of(zoom + 1) if last is None else last
        query = (
            "SELECT tile_column, tile_row, max(length(tile_data)) FROM tiles WHERE zoom_level = ? "
            "AND tile_column BETWEEN ? AND ? AND tile_row BETWEEN 0 AND ? "
            "GROUP BY 1, 2 ORDER BY 1, 2 DESC"
        )
        columns = max(first - begin, 0) // side, (last - 1 - begin) // side
        for x, y, size in self._ask(query, (zoom, *columns, side - 1)):
            number = begin + x * side + side - 1 - y
            if first <= number < last:
                yield Run(number, 1, size or 0)

    def name_of(self, number: int) -> Any:
        """Its place."""
        zoom = self.zoom_of(number)
        assert zoom is not None
        return Place(zoom, *divmod(number - first_of(zoom), 2**zoom))

    def packed(self, name: Any) -> bytes | None:
        """What the database has for a place; ValueError if that is NULL."""
        place = (name.zoom, name.x, 2**name.zoom - 1 - name.y)
        query = "SELECT tile_data FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?"
        found = next(self._ask(query, place), None)
        if found == (None,):
            raise ValueError("its tile_data is NULL")
        return bytes(found[0]) if found else None


class PMTiles(Archive):
    """A PMTiles archive, version 3, whose parts the package pmtiles reads; along Hilbert's curve.

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
        for part in ("tile", "internal"):
            packing = header[f"{part}_compression"]
            if packing not in (packings.NONE, packings.GZIP, packings.UNKNOWN):
                raise SceneError(
                    f"{path} is packed by {packing.name}, which is not read: pack it by gzip"
                )
        self.zooms = tuple(range(header["min_zoom"], min(header["max_zoom"], _DEEPEST) + 1))
        if not self.zooms:
            raise SceneError(f"{path} holds no tile: give an archive with tiles")
        metadata = self._inner(header["metadata_offset"], header["metadata_length"])
        self.attribution = attribution_of(metadata)
        self._directory = lru_cache(64)(self._read_directory)

    def _bytes(self, start: int, count: int) -> bytes:
        with self._path.open("rb") as stream:
            size = self._path.stat().st_size
            if start + count > size:
                where = f"it has {size} bytes, and byte {start + count} is asked for"
                raise guard.cut_off(self._path, where)
            stream.seek(start)
            return stream.read(count)

    def _inner(self, start: int, count: int) -> bytes:
        """A directory or the metadata, unpacked as the header says of these."""
        data = self._bytes(start, count)
        if self.header["internal_compression"] != self._format.Compression.NONE:
            data = unpacked(data, MOST_IN_DIRECTORY)
        if len(data) >= MOST_IN_DIRECTORY:
            raise ValueError(f"a directory of it has {MOST_IN_DIRECTORY // 2**20} MiB or more")
        return data

    def _read_directory(self, start: int, count: int) -> list[Any]:
        # the package takes directories packed by gzip alone
        packed = gzip.compress(self._inner(start, count), 0)
        return list(self._format.deserialize_directory(packed))

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
            entries = self._directory(*place)
            ends = [entry.tile_id for entry in entries[1:]] + [last]
            found: list[Any] = []
            for entry, end in zip(entries, ends, strict=True):
                if entry.run_length and entry.tile_id < last:
                    if first < entry.tile_id + entry.run_length:
                        found.append(entry)
                elif entry.tile_id < last and first < end:
                    found.append((header["leaf_directory_offset"] + entry.offset, entry.length))
            todo += reversed(found)

    def runs(self, zoom: int | None, first: int = 0, last: int | None = None) -> Iterator[Run]:
        """The tiles of an entry; one that is not after the entry before it is damage, left out."""
        assert zoom is not None
        first = max(first, first_of(zoom))
        last = first_of(zoom + 1) if last is None else last
        before = -1
        for entry in self._entries(first, last):
            start, end = max(entry.tile_id, first), min(entry.tile_id + entry.run_length, last)
            if before < start < end:
                before = start
                yield Run(start, end - start, entry.length)

    def name_of(self, number: int) -> Any:
        """Its place."""
        return Place(*self._format.tileid_to_zxy(number))

    def packed(self, name: Any) -> bytes | None:
        """What the archive has for a place."""
        tile = self._format.zxy_to_tileid(*name)
        entry = next(self._entries(tile, tile + 1), None)
        if entry is None:
            return None
        return self._bytes(self.header["tile_data_offset"] + entry.offset, entry.length)


KINDS: dict[str, type[Archive]] = {".pmtiles": PMTiles, ".mbtiles": MBTiles}
"""Archives in a file, by its suffix."""


def column_and_row(longitude: float, latitude: float, zoom: int) -> tuple[int, int]:
    """The tile of a place, in web Mercator; latitudes beyond it are those of its edge.

    >>> column_and_row(24.94, 60.17, 14)
    (9327, 4742)
    """
    side = 2**zoom
    sine = math.sin(math.radians(min(max(latitude, -85.0511), 85.0511)))
    x = (longitude / 360.0 + 0.5) * side
    y = (0.5 - math.atanh(sine) / (2.0 * math.pi)) * side
    return min(max(int(x), 0), side - 1), min(max(int(y), 0), side - 1)
