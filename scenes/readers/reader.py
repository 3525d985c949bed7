"""Interface of readers, and the registry of readers by suffix."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scenes.readers import guard
from scenes.scene import Note, SceneError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Source:
    """A file to read, with the selected layer and features.

    `where` is an SQL condition. `rows` is a range of features (first, stop), if the format can be
    read from the middle (see `scenes.slices`); attributes then have Arrow's types. If `attributes`
    is False, GDAL reads no attributes.
    """

    path: Path
    layer: str | None = None
    where: str | None = None
    rows: tuple[int, int] | None = None
    attributes: bool = True


@dataclass(frozen=True)
class RawChunk:
    """A chunk of a file, as a reader yields it: geometries before cleaning, attributes and notes.

    `attributes` has one row per geometry; `crs` is a code, WKT or PROJJSON. `dropped` has notes on
    items without a usable geometry, `repaired` on geometries that the reader changed. `notes` are
    the reader's choices, such as which of several layers was read.
    """

    geometries: NDArray[Any] | list[Any]
    labels: list[str]
    attributes: pd.DataFrame | None = None
    crs: str | None = None
    units: str = "units"
    dropped: list[Note] = field(default_factory=list)
    repaired: list[Note] = field(default_factory=list)
    notes: tuple[str, ...] = ()

    def select_rows(self, numbers: NDArray[np.int64]) -> RawChunk:
        """Return the chunk with only the geometries whose indices are `numbers` (k,)."""
        if len(numbers) == len(self.labels):
            return self
        table = self.attributes
        return replace(
            self,
            geometries=[self.geometries[i] for i in numbers],
            labels=[self.labels[i] for i in numbers],
            attributes=None if table is None else table.iloc[numbers].reset_index(drop=True),
        )

    def without_dropped(self) -> RawChunk:
        """Return the chunk without geometries whose label has a note in `dropped`."""
        names = {name for name, _ in self.dropped}
        return self.select_rows(np.flatnonzero([label not in names for label in self.labels]))


@dataclass(frozen=True)
class Reader:
    """A reader of a file format; call it to read a file in chunks.

    function : "module:function" of a generator of `RawChunk`, given a Source and a chunk's size
    kind : the format's name in messages
    in_memory : True if the complete file is read into memory, so that its size is limited
    """

    function: str
    kind: str
    in_memory: bool = True
    has_layers: bool = False

    def __call__(self, source: Source, size: int) -> Iterator[RawChunk]:
        """Yield a file's chunks of `size` features; raises SceneError for any error."""
        path = str(source.path)
        if source.layer is not None and not self.has_layers:
            raise SceneError(f"{path} is {self.kind}, without layers: leave layer out")
        with guard.raise_scene_errors(path, self.kind):
            if source.path.is_file():
                guard.check_size(source.path, self.in_memory)
                guard.check_truncation(source.path)
            # Imported on first use, because some imports take long.
            yield from resolve_name(self.function)(source, size)


GDAL = Reader(
    "scenes.readers.vector:read", "a file of geometries", in_memory=False, has_layers=True
)
_PARQUET = Reader("scenes.readers.geoparquet:read", "GeoParquet", in_memory=False, has_layers=True)
_CITY = Reader("scenes.readers.cityjson:read", "CityJSON", has_layers=True)
_SEQUENCE = replace(_CITY, function="scenes.readers.cityjson:read_sequence", in_memory=False)
_TILES = Reader("scenes.tiles:read_map", "map tiles", in_memory=False, has_layers=True)
_MESH = Reader("scenes.readers.meshes:read", "a 3D model")
_READERS = {
    **dict.fromkeys((".gltf", ".glb", ".stl", ".off"), _MESH),
    ".obj": Reader("scenes.readers.meshes:read", "OBJ"),
    ".ply": Reader("scenes.readers.meshes:read", "PLY"),
    **dict.fromkeys((".parquet", ".geoparquet", ".pq"), _PARQUET),
    **dict.fromkeys(
        (".wkt", ".ewkt"), Reader("scenes.readers.wkt:read_text", "WKT", in_memory=False)
    ),
    ".wkb": Reader("scenes.readers.wkt:read_binary", "WKB"),
    ".svg": Reader("scenes.readers.svg:read", "SVG"),
    ".cityjson": _CITY,
}
"""Readers by suffix; GDAL reads files with any other suffix."""


def is_model(path: Path) -> bool:
    """Whether a file's suffix is that of a 3D model."""
    reader = _READERS.get(path.suffix.lower())
    return reader is not None and reader.function == _MESH.function


def choose_reader(path: Path) -> Reader:
    """Return the reader for a file, by suffix; for .json, .jsonl and .mbtiles also by content."""
    suffix = path.suffix.lower()
    city = {".json": _CITY, ".jsonl": _SEQUENCE}
    if suffix in city and path.is_file():
        with path.open("rb") as stream:
            # CityJSON must state its type, which writers put at the beginning of the file.
            if b'"CityJSON"' in stream.read(4096):
                return city[suffix]
    if suffix == ".mbtiles" and path.is_file():
        return GDAL if _can_gdal_read(path) else _TILES
    return _READERS.get(suffix, GDAL)


def _can_gdal_read(path: Path) -> bool:
    """Whether GDAL can read an MBTiles archive: its format is "pbf", and its layers are listed."""
    uri = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    with suppress(sqlite3.Error), closing(sqlite3.connect(uri, uri=True)) as database:
        metadata = dict(database.execute("SELECT name, value FROM metadata"))
        return metadata.get("format", "pbf") == "pbf" and "json" in metadata
    return True
