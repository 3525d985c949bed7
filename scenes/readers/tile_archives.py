"""Archives of map tiles with one interface: folders of files, MBTiles, PMTiles.

The tiles of an archive are numbered consecutively, zoom by zoom. Archives list runs of equal tiles,
because one entry of a PMTiles directory may stand for a million equal tiles of the sea.
"""

import gzip
import io
import json
import re
import sqlite3
import time
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from scenes.readers import guard
from scenes.scene import SceneError
from scenes.spec import import_optional

MAX_TILE_BYTES = 64 * 2**20  # uncompressed; usual tiles have some hundred kilobytes
MAX_DIRECTORY_BYTES = 4 * 2**20  # uncompressed; usual directories of PMTiles have 16 KiB
QUERY_TIMEOUT_S = 60.0  # for the next row of SQLite, because `tiles` may be an endless view
_CLOCK_INTERVAL = 100_000  # instructions that SQLite executes between two checks of the clock
_MAX_ZOOM = 30
_NUMBER = r"(0|[1-9]\d{0,9})"
# Path of a tile's file. Groups: zoom, column and row, absent unless the path is like z/x/y.mvt;
# numbers with leading zeros, as in the date 2024/01/02, are not a position.
_FILE = re.compile(
    rf"(?:(?:^|/)([12]?\d|30)[/_-]{_NUMBER}[/_-]{_NUMBER}(?!\d))?[^/]*\.(mvt|pbf)(\.gz)?$",
    re.IGNORECASE,
)
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


class TileRun(NamedTuple):
    """Consecutive equal tiles: number of the first, count, and stored bytes of one of them."""

    first: int
    repeats: int
    size: int


class Archive(ABC):
    """An archive of map tiles, which can be listed without being read.

    zooms : ascending; () for a folder whose paths do not contain the positions of tiles
    attribution : attribution that the data require, or ""
    """

    zooms: tuple[int, ...] = ()
    attribution: str = ""

    @abstractmethod
    def list_tile_runs(
        self, zoom: int | None, first: int = 0, last: int | None = None
    ) -> Iterator[TileRun]:
        """Yield the runs of equal tiles of a zoom, ascending, cut to range(first, last)."""

    def list_tile_keys(self, zoom: int | None) -> list[Any]:
        """Return the keys of all tiles of a zoom, by ascending tile number."""
        runs = self.list_tile_runs(zoom)
        return [self.get_tile_key(run.first + k) for run in runs for k in range(run.repeats)]

    @abstractmethod
    def get_tile_key(self, number: int) -> Any:
        """Return a tile's key, given the tile's number: a `TilePosition`, or a file's path."""

    @abstractmethod
    def read_stored(self, key: Any) -> bytes | None:
        """Return the stored bytes of a tile, or None if it does not exist."""

    def select_zooms(self, path: str, requested: tuple[int, int] | None) -> Sequence[int | None]:
        """Return the zooms in the range (first, last) or all, or (None,) if zooms are unknown."""
        if not self.zooms:
            if requested is not None:
                raise SceneError(f"the zoom of the tiles in {path} is unknown: leave zoom= out")
            return (None,)
        first, last = requested or (self.zooms[0], self.zooms[-1])
        zooms = [zoom for zoom in self.zooms if first <= zoom <= last]
        if not zooms:
            problem = f"zoom {first}" if first == last else f"zooms {first} to {last}"
            available = f"it has {self.zooms[0]} to {self.zooms[-1]}"
            raise SceneError(f"{path} has no {problem}; {available}")
        return zooms

    def get_zoom(self, number: int) -> int | None:
        """Return the zoom of a tile, given its number, or None if paths contain no positions."""
        return ((3 * number + 1).bit_length() - 1) // 2

    def read(self, key: Any) -> bytes | None:
        """Return the uncompressed bytes of a tile; raises ValueError if they are invalid."""
        data = self.read_stored(key)
        return None if data is None else decompress(data)


def open_archive(path: Path) -> Archive:
    """Return the archive at a path; raises SceneError if the path contains no tiles."""
    if path.is_dir():
        return Folder(path)
    kinds: dict[str, Callable[[Path], Archive]] = {".pmtiles": PMTiles, ".mbtiles": MBTiles}
    return kinds.get(path.suffix.lower(), Folder)(path)


def compute_first_number(zoom: int) -> int:
    """Return the number of the first tile of a zoom, if all tiles of the world are numbered.

    >>> [compute_first_number(zoom) for zoom in range(4)]
    [0, 1, 5, 21]
    """
    return int(4**zoom - 1) // 3


def decompress(data: bytes, limit: int | None = None) -> bytes:
    """Return a tile's uncompressed bytes, less than `limit`; raises ValueError for invalid data."""
    limit = limit or MAX_TILE_BYTES
    if data[:4] == _ZSTD:
        raise ValueError("compressed by zstd, which is unsupported: use gzip")
    if data[:2] == b"\x1f\x8b":
        try:
            data = gzip.GzipFile(fileobj=io.BytesIO(data)).read(limit)
        except EOFError:
            raise ValueError("truncated compressed data") from None
    elif data[:1] == b"\x78" and int.from_bytes(data[:2]) % 31 == 0:  # zlib, but never a tile
        unpacker = zlib.decompressobj()
        data = unpacker.decompress(data, limit)
        if not unpacker.eof and len(data) < limit:
            raise ValueError("truncated compressed data")
    if len(data) >= limit:
        raise ValueError(f"{limit // 2**20} MiB or more, uncompressed")
    return data


def parse_attribution(metadata: bytes) -> str:
    """Return the attribution in the JSON metadata of an archive, or "" if there is none."""
    with suppress(ValueError, AttributeError, RecursionError):
        return str(json.loads(metadata).get("attribution") or "")
    return ""


class Folder(Archive):
    """A file of one tile, or a folder of such files, named z/x/y.mvt or z-x-y.pbf."""

    def __init__(self, path: Path) -> None:
        files: dict[Any, Path] = {}
        folder = path if path.is_dir() else path.parent
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            name: Any = file.relative_to(folder).as_posix()
            match = _FILE.search(name)
            if not (match and file.is_file()):
                continue
            if match[1]:
                position = TilePosition(*map(int, match.groups()[:3]))
                name = position if max(position.x, position.y) < 2**position.zoom else name
            if name in files:
                raise SceneError(f"{files[name]} and {file} are both tile {name}: remove one")
            files[name] = file
        if not files:
            raise SceneError(
                f"{path} holds no tiles: zoom=, layers=, tiles= and pixels= are for .pmtiles, "
                ".mbtiles, .mvt and .pbf files, and folders of these"
            )
        self._files = files
        positions = [name for name in files if isinstance(name, TilePosition)]
        self._names: list[Any] = list(files)
        if len(positions) == len(files):
            self.zooms = tuple(sorted({position.zoom for position in positions}))
            self._names = sorted(positions, key=lambda position: position.zoom)
        with suppress(OSError):
            self.attribution = parse_attribution((path / "metadata.json").read_bytes())

    def list_tile_runs(
        self, zoom: int | None, first: int = 0, last: int | None = None
    ) -> Iterator[TileRun]:
        """Yield a run of one tile for each file; files are not compared."""
        for number, name in enumerate(self._names[first:last], first):
            if zoom is None or name[0] == zoom:
                yield TileRun(number, 1, self._files[name].stat().st_size)

    def get_zoom(self, number: int) -> int | None:
        """Return the zoom in the path, or None unless all paths have a zoom."""
        return self._names[number].zoom if self.zooms else None

    def get_tile_key(self, number: int) -> Any:
        """Return a tile's key: its position, or the path in the folder."""
        return self._names[number]

    def read_stored(self, key: Any) -> bytes | None:
        """Return a file's bytes, up to the limit of a tile."""
        if key not in self._files:
            return None
        with self._files[key].open("rb") as stream:
            return stream.read(MAX_TILE_BYTES)


class MBTiles(Archive):
    """An SQLite database of tiles, numbered column by column; rows count from the south."""

    def __init__(self, path: Path) -> None:
        guard.check_truncation(path)
        self._path = path
        self._uri = f"{path.resolve().as_uri()}?mode=ro"
        log = Path(f"{path.resolve()}-wal")
        if not (log.is_file() and log.stat().st_size):  # with "immutable" SQLite ignores the log
            self._uri += "&immutable=1"
        metadata = dict(self._query("SELECT name, value FROM metadata"))
        kind = str(metadata.get("format") or "pbf")
        if kind.lower() not in _VECTOR_FORMATS:
            raise SceneError(f"{path} holds tiles of format {kind}: give vector tiles")
        self.attribution = str(metadata.get("attribution") or "")
        rows = self._query(
            "SELECT DISTINCT zoom_level FROM tiles WHERE zoom_level BETWEEN 0 AND 30 ORDER BY 1"
        )
        self.zooms = tuple(int(zoom) for (zoom,) in rows)
        if not self.zooms:
            raise SceneError(f"{path} holds no tile: give an archive with tiles")

    def _query(self, query: str, values: tuple[Any, ...] = ()) -> Iterator[Any]:
        """Yield the rows of a query; raises SceneError if a row takes over `QUERY_TIMEOUT_S`.

        SQLite calls a progress handler, so that Python can raise KeyboardInterrupt for Ctrl-C.
        """
        start = time.monotonic()
        with closing(sqlite3.connect(self._uri, uri=True)) as database:
            database.set_progress_handler(
                lambda: time.monotonic() - start > QUERY_TIMEOUT_S, _CLOCK_INTERVAL
            )
            rows: Iterator[Any] | None = None
            while True:
                start = time.monotonic()
                try:
                    rows = database.execute(query, values) if rows is None else rows
                    row = next(rows, None)
                except sqlite3.OperationalError as error:
                    if "interrupted" not in str(error):
                        raise
                    if time.monotonic() - start <= QUERY_TIMEOUT_S:
                        raise KeyboardInterrupt from None
                    raise SceneError(
                        f"{self._path}: SQLite returned no row within {QUERY_TIMEOUT_S:g} s; "
                        "check that tiles is a table, not a view without end"
                    ) from None
                if row is None:
                    return
                yield row

    def list_tile_runs(
        self, zoom: int | None, first: int = 0, last: int | None = None
    ) -> Iterator[TileRun]:
        """Yield a run of one tile for each tile inside the world; equal tiles are not joined."""
        assert zoom is not None
        side, offset = 2**zoom, compute_first_number(zoom)
        last = compute_first_number(zoom + 1) if last is None else last
        query = (
            "SELECT tile_column, tile_row, max(length(tile_data)) FROM tiles WHERE zoom_level = ? "
            "AND tile_column BETWEEN ? AND ? AND tile_row BETWEEN 0 AND ? "
            "GROUP BY 1, 2 ORDER BY 1, 2 DESC"
        )
        columns = max(first - offset, 0) // side, (last - 1 - offset) // side
        for x, y, size in self._query(query, (zoom, *columns, side - 1)):
            number = offset + x * side + side - 1 - y
            if first <= number < last:
                yield TileRun(number, 1, size or 0)

    def get_tile_key(self, number: int) -> Any:
        """Return a tile's key: its position."""
        zoom = self.get_zoom(number)
        assert zoom is not None
        return TilePosition(zoom, *divmod(number - compute_first_number(zoom), 2**zoom))

    def read_stored(self, key: Any) -> bytes | None:
        """Return the data of a tile; raises ValueError for NULL."""
        values = (key.zoom, key.x, 2**key.zoom - 1 - key.y)
        query = "SELECT tile_data FROM tiles WHERE zoom_level=? AND tile_column=? AND tile_row=?"
        row = next(self._query(query, values), None)
        if row == (None,):
            raise ValueError("tile_data is NULL")
        return bytes(row[0]) if row else None


class PMTiles(Archive):
    """A PMTiles archive, version 3, read by the package pmtiles; numbered along Hilbert's curve."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._format = import_optional("pmtiles.tile", path, "tiles")
        try:
            self.header = self._format.deserialize_header(self._read_bytes(0, 127))
        except (self._format.MagicNumberNotFound, self._format.SpecVersionUnsupported) as error:
            kind = "a PMTiles archive" if "Magic" in type(error).__name__ else "of version 3"
            raise SceneError(f"{path} is not {kind}: give a PMTiles archive of version 3") from None
        header, types = self.header, self._format.TileType
        for part in ("metadata", "leaf_directory", "tile_data"):
            self._read_bytes(header[f"{part}_offset"] + header[f"{part}_length"], 0)
        if header["tile_type"] not in (types.MVT, types.UNKNOWN):
            kind = header["tile_type"].name
            raise SceneError(f"{path} holds {kind} tiles: give Mapbox vector tiles (MVT)")
        compressions = self._format.Compression
        for part in ("tile", "internal"):
            compression = header[f"{part}_compression"]
            if compression not in (compressions.NONE, compressions.GZIP, compressions.UNKNOWN):
                raise SceneError(
                    f"{path} is compressed by {compression.name}, which is unsupported: use gzip"
                )
        self.zooms = tuple(range(header["min_zoom"], min(header["max_zoom"], _MAX_ZOOM) + 1))
        if not self.zooms:
            raise SceneError(f"{path} holds no tile: give an archive with tiles")
        metadata = self._read_decompressed(header["metadata_offset"], header["metadata_length"])
        self.attribution = parse_attribution(metadata)
        self._directory = lru_cache(64)(self._read_directory)

    def _read_bytes(self, start: int, count: int) -> bytes:
        """Return a range of the file's bytes; raises SceneError if the file is truncated."""
        with self._path.open("rb") as stream:
            size = self._path.stat().st_size
            if start + count > size:
                raise guard.make_truncation_error(self._path, f"{size} of {start + count} bytes")
            stream.seek(start)
            return stream.read(count)

    def _read_decompressed(self, start: int, count: int) -> bytes:
        """Return a directory or the metadata, decompressed as the header states."""
        data = self._read_bytes(start, count)
        if self.header["internal_compression"] != self._format.Compression.NONE:
            data = decompress(data, MAX_DIRECTORY_BYTES)
        if len(data) >= MAX_DIRECTORY_BYTES:
            raise ValueError(f"a directory has {MAX_DIRECTORY_BYTES // 2**20} MiB or more")
        return data

    def _read_directory(self, start: int, count: int) -> list[Any]:
        # Compressed again, because the package reads only directories compressed by gzip.
        packed = gzip.compress(self._read_decompressed(start, count), 0)
        return list(self._format.deserialize_directory(packed))

    def _read_entries(self, first: int, last: int) -> Iterator[Any]:
        """Yield the entries of tiles with numbers in range(first, last), from all directories."""
        header = self.header
        stack: list[Any] = [(header["root_offset"], header["root_length"])]
        visited: set[int] = set()
        while stack:
            item = stack.pop()
            if isinstance(item, self._format.Entry):
                yield item
                continue
            if item[0] in visited:
                raise ValueError("a directory contains itself")
            visited.add(item[0])
            entries = self._directory(*item)
            ends = [entry.tile_id for entry in entries[1:]] + [last]
            children: list[Any] = []
            for entry, end in zip(entries, ends, strict=True):
                if entry.run_length and entry.tile_id < last:
                    if first < entry.tile_id + entry.run_length:
                        children.append(entry)
                elif entry.tile_id < last and first < end:
                    children.append((header["leaf_directory_offset"] + entry.offset, entry.length))
            stack += reversed(children)

    def list_tile_runs(
        self, zoom: int | None, first: int = 0, last: int | None = None
    ) -> Iterator[TileRun]:
        """Yield the run of equal tiles of each directory entry; skip invalid, unordered entries."""
        assert zoom is not None
        first = max(first, compute_first_number(zoom))
        last = compute_first_number(zoom + 1) if last is None else last
        previous = -1
        for entry in self._read_entries(first, last):
            start, end = max(entry.tile_id, first), min(entry.tile_id + entry.run_length, last)
            if previous < start < end:
                previous = start
                yield TileRun(start, end - start, entry.length)

    def get_tile_key(self, number: int) -> Any:
        """Return a tile's key: its position."""
        return TilePosition(*self._format.tileid_to_zxy(number))

    def read_stored(self, key: Any) -> bytes | None:
        """Return the data of a tile, or None if absent."""
        tile = self._format.zxy_to_tileid(*key)
        entry = next(self._read_entries(tile, tile + 1), None)
        if entry is None:
            return None
        return self._read_bytes(self.header["tile_data_offset"] + entry.offset, entry.length)
