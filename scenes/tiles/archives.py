"""Archives of map tiles with one interface: folders of files, MBTiles, PMTiles.

Tiles are numbered, those of a zoom consecutively. Archives list runs of equal tiles: one entry may
stand for a million tiles of the sea.
"""

import gzip
import io
import json
import math
import re
import sqlite3
import time
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import closing, suppress
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from scenes.readers import guard
from scenes.scene import SceneError
from scenes.spec import format_install_command

MAX_TILE_BYTES = 64 * 2**20
"""Maximum size of an uncompressed tile; clients expect some hundred kilobytes."""

MAX_DIRECTORY_BYTES = 4 * 2**20
"""Maximum size of an uncompressed directory of PMTiles; writers make some ten kilobytes."""

QUERY_TIMEOUT_S = 60.0
"""Maximum wait for a row of an SQLite database, in which a view may be endless."""

_STEPS = 100_000  # of SQLite's machine, some milliseconds, from one look at the clock to the next
_DEEPEST = 30
_NUMBER = r"(0|[1-9]\d{0,9})"
_FILE = re.compile(
    rf"(?:(?:^|/)([12]?\d|30)[/_-]{_NUMBER}[/_-]{_NUMBER}(?!\d))?[^/]*\.(mvt|pbf)(\.gz)?$",
    re.IGNORECASE,
)
"""A tile's file, and its zoom, column and row if its path has them; dates have leading zeros."""

_ZSTD = b"\x28\xb5\x2f\xfd"
_VECTOR_FORMATS = ("pbf", "mvt", "application/x-protobuf", "application/vnd.mapbox-vector-tile")
"""Names of the vector tile format in the metadata of MBTiles."""


class TilePosition(NamedTuple):
    """A tile's zoom, column from the west and row from the north."""

    zoom: int
    x: int
    y: int

    def __str__(self) -> str:
        return "/".join(map(str, self))


class Run(NamedTuple):
    """Consecutive tiles of an archive with the same bytes; in most cases one tile.

    number : number of the first tile in the archive
    times : number of tiles
    size : stored bytes of one tile
    """

    number: int
    times: int
    size: int


class Archive(ABC):
    """Tiles that can be counted before any is read.

    zooms : zooms in the archive, in order; () for files without a position
    attribution : attribution of the data, or ""
    """

    zooms: tuple[int, ...] = ()
    attribution: str = ""

    @abstractmethod
    def __init__(self, path: Path) -> None:
        """Open the path; raises SceneError if it contains no tiles."""

    @abstractmethod
    def runs(self, zoom: int | None, first: int = 0, last: int | None = None) -> Iterator[Run]:
        """Yield the tiles of a zoom in ascending order; there may be many millions.

        Numbers are limited to `first` to before `last`. Tiles with near numbers are neighbours.
        """

    def names(self, zoom: int | None) -> list[Any]:
        """Return the names of all tiles of a zoom, in order."""
        runs = self.runs(zoom)
        return [self.name_of(run.number + k) for run in runs for k in range(run.times)]

    @abstractmethod
    def name_of(self, number: int) -> Any:
        """Return the name of a tile: its `TilePosition`, or a file's path."""

    @abstractmethod
    def packed(self, name: Any) -> bytes | None:
        """Return the stored bytes of a tile, or None if it does not exist."""

    def zooms_of(self, path: str, wanted: tuple[int, int] | None) -> Sequence[int | None]:
        """Return the zooms from the first wanted to the last, or (None,) if none is known.

        Raises SceneError, which names `path`, if the archive has none of these.
        """
        if not self.zooms:
            if wanted is not None:
                raise SceneError(
                    f"{path} does not say at which zoom its tiles are: leave zoom= out"
                )
            return (None,)
        first, last = wanted or (self.zooms[0], self.zooms[-1])
        zooms = [zoom for zoom in self.zooms if first <= zoom <= last]
        if not zooms:
            which = f"zoom {first}" if first == last else f"zooms {first} to {last}"
            there = f"it has {self.zooms[0]} to {self.zooms[-1]}"
            raise SceneError(f"{path} has no {which}; {there}")
        return zooms

    def zoom_of(self, number: int) -> int | None:
        """Return the zoom of a tile by its number, or None for files without a position."""
        return ((3 * number + 1).bit_length() - 1) // 2

    def read(self, name: Any) -> bytes | None:
        """Return the uncompressed bytes of a tile; raises ValueError if they are invalid."""
        data = self.packed(name)
        return None if data is None else decompress(data)


def open_archive(path: Path) -> Archive:
    """Return the archive at a path; raises SceneError if it is none."""
    return KINDS.get("" if path.is_dir() else path.suffix.lower(), Folder)(path)


def first_number(zoom: int) -> int:
    """Return the number of the first tile of a zoom, in numbering by zooms.

    >>> [first_number(zoom) for zoom in range(4)]
    [0, 1, 5, 21]
    """
    return int(4**zoom - 1) // 3


def decompress(data: bytes, most: int | None = None) -> bytes:
    """Return a tile uncompressed; its first bytes show whether gzip or zlib compressed it.

    Raises ValueError if a member is invalid, or for `most` (`MAX_TILE_BYTES`) bytes or more.
    """
    most = most or MAX_TILE_BYTES
    if data[:4] == _ZSTD:
        raise ValueError("it is packed by zstd, which is not read: pack it by gzip")
    if data[:2] == b"\x1f\x8b":
        try:
            data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(most)
        except EOFError:
            raise ValueError("its packed bytes are cut off") from None
    elif data[:1] == b"\x78" and int.from_bytes(data[:2]) % 31 == 0:  # no field of a tile
        unpacker = zlib.decompressobj()
        data = unpacker.decompress(data, most)
        if not unpacker.eof and len(data) < most:
            raise ValueError("its packed bytes are cut off")
    if len(data) >= most:
        raise ValueError(f"it has {most // 2**20} MiB or more, unpacked")
    return data


def parse_attribution(metadata: bytes) -> str:
    """Return the attribution in an archive's metadata in JSON, or ""."""
    with suppress(ValueError, AttributeError, RecursionError):
        return str(json.loads(metadata).get("attribution") or "")
    return ""


def import_optional(package: str) -> Any:
    """Return an optional package; raises SceneError if it is not installed."""
    try:
        return import_module(package)
    except ImportError:
        raise SceneError(
            f"these tiles need the package {package.partition('.')[0]}: "
            f"{format_install_command('tiles')}"
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
                place = TilePosition(*map(int, match.groups()[:3]))
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
        placed = [name for name in found if isinstance(name, TilePosition)]
        self._names: list[Any] = list(found)
        if len(placed) == len(found):
            self.zooms = tuple(sorted({place.zoom for place in placed}))
            self._names = sorted(placed, key=lambda place: place.zoom)
        with suppress(OSError):
            self.attribution = parse_attribution((path / "metadata.json").read_bytes())

    def runs(self, zoom: int | None, first: int = 0, last: int | None = None) -> Iterator[Run]:
        """Yield each file separately."""
        for number, name in enumerate(self._names[first:last], first):
            if zoom is None or name[0] == zoom:
                yield Run(number, 1, self._files[name].stat().st_size)

    def zoom_of(self, number: int) -> int | None:
        """Return the zoom in its path, or None unless all paths have one."""
        return self._names[number].zoom if self.zooms else None

    def name_of(self, number: int) -> Any:
        """Return its place, or its path in the folder."""
        return self._names[number]

    def packed(self, name: Any) -> bytes | None:
        """Return a file's bytes, up to the limit of a tile."""
        if name not in self._files:
            return None
        with self._files[name].open("rb") as stream:
            return stream.read(MAX_TILE_BYTES)


class MBTiles(Archive):
    """An SQLite database of tiles, whose rows count from the south; numbered column by column."""

    def __init__(self, path: Path) -> None:
        guard.check_truncation(path)
        self._path = path
        self._uri = f"{path.resolve().as_uri()}?mode=ro"
        log = Path(f"{path.resolve()}-wal")
        if not (log.is_file() and log.stat().st_size):  # what was written last is in it
            self._uri += "&immutable=1"
        facts = dict(self._ask("SELECT name, value FROM metadata"))
        kind = str(facts.get("format") or "pbf")
        if kind.lower() not in _VECTOR_FORMATS:
            raise SceneError(f"{path} holds tiles of format {kind}: give one of vector tiles")
        self.attribution = str(facts.get("attribution") or "")
        rows = self._ask(
            "SELECT DISTINCT zoom_level FROM tiles WHERE zoom_level BETWEEN 0 AND 30 ORDER BY 1"
        )
        self.zooms = tuple(int(zoom) for (zoom,) in rows)
        if not self.zooms:
            raise SceneError(f"{path} holds no tile: give an archive with tiles")

    def _ask(self, query: str, values: tuple[Any, ...] = ()) -> Iterator[Any]:
        """Yield the rows of a query; raises SceneError if one takes longer than `QUERY_TIMEOUT_S`.

        Python does not receive Ctrl-C while SQLite runs. So SQLite calls a progress handler now
        and then, which checks the clock; an exception there interrupts SQLite.
        """
        begun = time.monotonic()
        with closing(sqlite3.connect(self._uri, uri=True)) as database:
            database.set_progress_handler(
                lambda: time.monotonic() - begun > QUERY_TIMEOUT_S, _STEPS
            )
            rows: Iterator[Any] | None = None
            while True:
                begun = time.monotonic()
                try:
                    rows = database.execute(query, values) if rows is None else rows
                    row = next(rows, None)
                except sqlite3.OperationalError as error:
                    if "interrupted" not in str(error):
                        raise
                    if time.monotonic() - begun <= QUERY_TIMEOUT_S:
                        raise KeyboardInterrupt from None
                    raise SceneError(
                        f"{self._path} gives no answer within {QUERY_TIMEOUT_S:g} s: a view in it "
                        "may be endless"
                    ) from None
                if row is None:
                    return
                yield row

    def runs(self, zoom: int | None, first: int = 0, last: int | None = None) -> Iterator[Run]:
        """Yield each tile once, separately; tiles outside the world are ignored."""
        assert zoom is not None
        side, begin = 2**zoom, first_number(zoom)
        last = first_number(zoom + 1) if last is None else last
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
        """Return its place."""
        zoom = self.zoom_of(number)
        assert zoom is not None
        return TilePosition(zoom, *divmod(number - first_number(zoom), 2**zoom))

    def packed(self, name: Any) -> bytes | None:
        """Return the data of a place; raises ValueError if they are NULL."""
        place = (name.zoom, name.x, 2**name.zoom - 1 - name.y)
        query = "SELECT tile_data FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?"
        found = next(self._ask(query, place), None)
        if found == (None,):
            raise ValueError("its tile_data is NULL")
        return bytes(found[0]) if found else None


class PMTiles(Archive):
    """A PMTiles archive, version 3, read by the package pmtiles; numbered along Hilbert's curve.

    header : as that package returns it
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._format = import_optional("pmtiles.tile")
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
        self.attribution = parse_attribution(metadata)
        self._directory = lru_cache(64)(self._read_directory)

    def _bytes(self, start: int, count: int) -> bytes:
        with self._path.open("rb") as stream:
            size = self._path.stat().st_size
            if start + count > size:
                where = f"it has {size} bytes, and byte {start + count} is asked for"
                raise guard.truncation_error(self._path, where)
            stream.seek(start)
            return stream.read(count)

    def _inner(self, start: int, count: int) -> bytes:
        """Return a directory or the metadata, uncompressed as the header states."""
        data = self._bytes(start, count)
        if self.header["internal_compression"] != self._format.Compression.NONE:
            data = decompress(data, MAX_DIRECTORY_BYTES)
        if len(data) >= MAX_DIRECTORY_BYTES:
            raise ValueError(f"a directory of it has {MAX_DIRECTORY_BYTES // 2**20} MiB or more")
        return data

    def _read_directory(self, start: int, count: int) -> list[Any]:
        # The package reads directories compressed by gzip only.
        packed = gzip.compress(self._inner(start, count), 0)
        return list(self._format.deserialize_directory(packed))

    def _entries(self, first: int, last: int) -> Iterator[Any]:
        """Yield the entries of tiles from `first` to before `last`, through all directories."""
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
        """Yield the tiles of each entry; entries out of order are invalid and skipped."""
        assert zoom is not None
        first = max(first, first_number(zoom))
        last = first_number(zoom + 1) if last is None else last
        before = -1
        for entry in self._entries(first, last):
            start, end = max(entry.tile_id, first), min(entry.tile_id + entry.run_length, last)
            if before < start < end:
                before = start
                yield Run(start, end - start, entry.length)

    def name_of(self, number: int) -> Any:
        """Return its place."""
        return TilePosition(*self._format.tileid_to_zxy(number))

    def packed(self, name: Any) -> bytes | None:
        """Return the data of a place, or None."""
        tile = self._format.zxy_to_tileid(*name)
        entry = next(self._entries(tile, tile + 1), None)
        if entry is None:
            return None
        return self._bytes(self.header["tile_data_offset"] + entry.offset, entry.length)


KINDS: dict[str, type[Archive]] = {".pmtiles": PMTiles, ".mbtiles": MBTiles}
"""Classes of archives by the suffix of their file."""


def locate_tile(longitude: float, latitude: float, zoom: int) -> tuple[int, int]:
    """Return the tile of a position in web Mercator; latitudes outside are those of its edge.

    >>> locate_tile(24.94, 60.17, 14)
    (9327, 4742)
    """
    side = 2**zoom
    sine = math.sin(math.radians(min(max(latitude, -85.0511), 85.0511)))
    x = (longitude / 360.0 + 0.5) * side
    y = (0.5 - math.atanh(sine) / (2.0 * math.pi)) * side
    return min(max(int(x), 0), side - 1), min(max(int(y), 0), side - 1)
