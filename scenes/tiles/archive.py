"""Where map tiles lie: what all archives have, folders of tiles, and one tile in a file."""

from __future__ import annotations

import gzip
import io
import json
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from scenes.scene import SceneError

MOST_BYTES = 64 * 2**20
"""Of an unpacked tile; clients expect some hundred kilobytes."""

_NUMBER = r"(0|[1-9]\d{0,9})"
_FILE = re.compile(
    rf"(?:(?:^|/)([12]?\d|30)[/_-]{_NUMBER}[/_-]{_NUMBER}(?!\d))?[^/]*\.(mvt|pbf)(\.gz)?$",
    re.IGNORECASE,
)
"""A tile's file, and its zoom, column and row if its path tells them; no date with zeros does."""

_ZSTD = b"\x28\xb5\x2f\xfd"
_EXTRA = '.venv/bin/python -m pip install "raster-harness[tiles]"'


class Place(NamedTuple):
    """A tile's zoom, column from the west and row from the north."""

    zoom: int
    x: int
    y: int

    def __str__(self) -> str:
        return "/".join(map(str, self))


def first_of(zoom: int) -> int:
    """The number of the first tile of a zoom, where all of the world's are numbered by zooms.

    >>> [first_of(zoom) for zoom in range(4)]
    [0, 1, 5, 21]
    """
    return (4**zoom - 1) // 3


def zoom_of(number: int) -> int:
    """The zoom of a tile so numbered.

    >>> [zoom_of(number) for number in (0, 1, 4, 5, 20, 21)]
    [0, 1, 1, 2, 2, 3]
    """
    return ((3 * number + 1).bit_length() - 1) // 2


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
    def names(self, zoom: int | None) -> Sequence[Any]:
        """The tiles of a zoom, in an order in which neighbours are near; None for all."""

    @abstractmethod
    def runs(self, zoom: int | None) -> Iterator[Run]:
        """All tiles of a zoom, by growing numbers, one by one: there may be many millions."""

    @abstractmethod
    def between(self, first: int, last: int) -> Iterator[tuple[Any, int]]:
        """The name of the first tile of each run, and how many they are; by number, without `last`.

        Both are of one zoom.
        """

    @abstractmethod
    def packed(self, name: Any) -> bytes | None:
        """A tile's bytes as they are stored; None if there is no such tile."""

    def read(self, name: Any) -> bytes | None:
        """A tile's bytes, unpacked; raises ValueError where they cannot be."""
        data = self.packed(name)
        return None if data is None else unpacked(data)


def unpacked(data: bytes) -> bytes:
    """A tile as the format defines it; its first bytes say whether gzip has packed it.

    All members of gzip are read. Raises ValueError if one cannot be unpacked, or all have
    `MOST_BYTES` or more then.
    """
    if data[:4] == _ZSTD:
        raise ValueError("it is packed by zstd, which is not read: pack it by gzip")
    if data[:2] != b"\x1f\x8b":
        return data
    with suppress(EOFError):
        whole = gzip.GzipFile(fileobj=io.BytesIO(data)).read(MOST_BYTES)
        if len(whole) < MOST_BYTES:
            return whole
    raise ValueError("its packed bytes are cut off, or unpack to more than 64 MiB")


def attribution_of(metadata: bytes) -> str:
    """Whose data the tiles are, by an archive's metadata in JSON; "" where it does not say."""
    with suppress(ValueError, AttributeError):
        return str(json.loads(metadata).get("attribution") or "")
    return ""


def needed(package: str) -> Any:
    """An optional package; SceneError where it is not installed."""
    try:
        return import_module(package)
    except ImportError:
        raise SceneError(
            f"these tiles need the package {package.split('.')[0]}: {_EXTRA}"
        ) from None


class Folder(Archive):
    """A file, or a folder of files named z/x/y.mvt or z-x-y.pbf, or otherwise; packed or not."""

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

    def names(self, zoom: int | None) -> Sequence[Any]:
        """In the order of their paths."""
        if zoom is None:
            return list(self._files)
        return [place for place in self._files if place[0] == zoom]

    def runs(self, zoom: int | None) -> Iterator[Run]:
        """Numbered zoom by zoom, in the order of their paths."""
        for number, name in enumerate(self._names):
            if zoom is None or name[0] == zoom:
                yield Run(number, 1, self._files[name].stat().st_size)

    def between(self, first: int, last: int) -> Iterator[tuple[Any, int]]:
        """One by one."""
        yield from ((name, 1) for name in self._names[first:last])

    def packed(self, name: Any) -> bytes | None:
        """A file's bytes."""
        file = self._files.get(name)
        return None if file is None else file.read_bytes()


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
