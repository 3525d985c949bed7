"""Polygons of any file a user has: which reader serves which suffix."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import shapely
from numpy.typing import NDArray

from scenes.clean import Cleaned, clean
from scenes.projection import is_geographic, mean_direction, to_metres
from scenes.scene import Note, Scene, SceneError
from scenes.where import matching

if TYPE_CHECKING:
    import pandas as pd

CHUNK = 50_000
"""Features a chunk holds unless asked otherwise."""


@dataclass(frozen=True)
class Source:
    """A file and the part of it that is wanted.

    `layer` is a layer's name; `where` an SQL condition on attributes, as GDAL understands it.
    """

    path: Path
    layer: str | None = None
    where: str | None = None


@dataclass(frozen=True)
class Raw:
    """What a reader yields: geometries as they stand in the file, and what is known of them.

    `geometries` are shapely geometries or None; `labels` name them for messages; `attributes` has
    one row a geometry; `crs` is a reference system as pyogrio reports it; `dropped` are items that
    did not even become a geometry, `repaired` those that did only after a mend.
    """

    geometries: NDArray[Any] | list[Any]
    labels: list[str]
    attributes: pd.DataFrame | None = None
    crs: str | None = None
    units: str = "units"
    dropped: list[Note] = field(default_factory=list)
    repaired: list[Note] = field(default_factory=list)


@dataclass(frozen=True)
class Chunk:
    """A part of a file: valid polygons, their attributes, and notes on the rest.

    `crs` is the file's reference system. If the polygons were projected from longitude and
    latitude, `centre` is the centre of that projection, as `scenes.projection` takes it.
    """

    cleaned: Cleaned
    attributes: pd.DataFrame | None
    units: str
    crs: str | None = None
    centre: tuple[float, float] | None = None


_MESHES = (".obj", ".ply", ".gltf", ".glb", ".stl", ".off", ".3mf", ".dae")
_READERS: dict[str, str] = {
    **dict.fromkeys(_MESHES, "scenes.mesh:read"),
    **dict.fromkeys((".parquet", ".geoparquet", ".pq"), "scenes.geoparquet:read"),
    **dict.fromkeys((".wkt", ".ewkt"), "scenes.wkt:read_text"),
    ".wkb": "scenes.wkt:read_binary",
    ".svg": "scenes.svg:read",
    ".cityjson": "scenes.cityjson:read",
}
"""Suffix to "module:function"; everything else goes to GDAL."""

_GDAL = "scenes.vector:read"


def read(
    path: str,
    *,
    layer: str | None = None,
    where: str | None = None,
    limit: int | None = None,
    project: bool | None = None,
) -> Scene:
    """All polygons of a file, as a scene.

    Multi-polygons become one polygon a part, heights are dropped, and longitude and latitude are
    projected to metres about the data's centre (`project=False` keeps degrees). `limit` stops
    after that many polygons. Raises SceneError if the file is missing, cannot be read, or holds no
    polygon.
    """
    if limit is not None and limit < 1:
        raise SceneError(f"limit={limit} leaves no polygon of {path}: give 1 or more")
    polygons: list[Any] = []
    tables: list[Any] = []
    dropped: list[Note] = []
    repaired: list[Note] = []
    units = "units"
    size = CHUNK if limit is None else min(CHUNK, max(1000, 2 * limit))
    for chunk in read_chunks(path, layer=layer, where=where, project=project, size=size):
        polygons.extend(chunk.cleaned.polygons)
        tables.append(chunk.attributes)
        dropped += chunk.cleaned.dropped
        repaired += chunk.cleaned.repaired
        units = chunk.units
        if limit is not None and len(polygons) >= limit:
            break
    if not polygons:
        raise SceneError(_nothing(path, dropped, layer, where))
    given = {"layer": layer, "where": where, "limit": limit, "project": project}
    scene = Scene(
        name=Path(path).stem,
        polygons=polygons,
        units=units,
        description=str(path),
        licence="as the file's",
        parameters={k: v for k, v in given.items() if v is not None},
        dropped=dropped,
        repaired=repaired,
        attributes=_stacked(tables),
    )
    return scene if limit is None else scene.head(limit)


def read_chunks(
    path: str,
    *,
    layer: str | None = None,
    where: str | None = None,
    project: bool | None = None,
    size: int = CHUNK,
) -> Iterator[Chunk]:
    """The polygons of a file, about `size` features at a time, so that memory stays bounded.

    All chunks are projected about the centre of the first, so they fit together. Raises SceneError
    as `read` does, save that a file without polygons yields chunks without polygons.
    """
    source = Source(_existing(path), layer, where)
    centre: tuple[float, float] | None = None
    for raw in _raws(source, size):
        cleaned = clean(raw.geometries, raw.labels)
        coordinates = shapely.get_coordinates(cleaned.polygons)
        units = raw.units
        if project is None and len(coordinates):
            project = is_geographic(raw.crs, coordinates)
        if project and len(coordinates):
            units, centre = "m", centre or mean_direction(coordinates)
            cleaned = _projected(cleaned, raw.labels, centre)
        cleaned.dropped[:0] = raw.dropped
        cleaned.repaired[:0] = raw.repaired
        table = raw.attributes
        if table is not None:
            table = table.iloc[cleaned.source].reset_index(drop=True)
        yield Chunk(cleaned, table, units, raw.crs, centre)


def _projected(cleaned: Cleaned, labels: list[str], centre: tuple[float, float]) -> Cleaned:
    """In metres; cleaned again, because a shape may fold where the map of a continent ends."""
    flat = shapely.transform(cleaned.polygons, lambda degrees: to_metres(degrees, centre))
    again = clean(flat, [labels[i] for i in cleaned.source])
    return Cleaned(
        again.polygons,
        cleaned.source[again.source],
        cleaned.dropped + again.dropped,
        cleaned.repaired + again.repaired,
    )


def _existing(path: str) -> Path:
    if "\0" in path:
        raise SceneError("a path cannot hold a NUL character: give another")
    file = Path(path)
    try:
        if not file.exists():
            raise SceneError(f"there is no file {path}: check the path")
        if file.is_file():
            with file.open("rb") as stream:
                if not stream.read(1):
                    raise SceneError(f"{path} is empty (0 bytes): give a file with polygons")
    except OSError as error:
        raise SceneError(f"{path} cannot be opened: {error.strerror or error}") from error
    return file


def _reader(path: Path) -> str:
    """The "module:function" that reads this file."""
    reader = _READERS.get(path.suffix.lower(), _GDAL)
    city = {".json": "scenes.cityjson:read", ".jsonl": "scenes.cityjson:read_sequence"}
    if path.suffix.lower() in city and path.is_file():
        with path.open("rb") as stream:
            # CityJSON requires its type, and writers put it first
            if b'"CityJSON"' in stream.read(4096):
                return city[path.suffix.lower()]
    return reader


def _raws(source: Source, size: int) -> Iterator[Raw]:
    """What the file's reader yields, filtered by `where` if the reader cannot do that itself."""
    spec = _reader(source.path)
    module, function = spec.split(":")
    for raw in getattr(importlib.import_module(module), function)(source, size):
        yield raw if source.where is None or spec == _GDAL else _filtered(raw, source)


def _filtered(raw: Raw, source: Source) -> Raw:
    rows = matching(raw.attributes, source.where or "", str(source.path))
    return replace(
        raw,
        geometries=[raw.geometries[i] for i in rows],
        labels=[raw.labels[i] for i in rows],
        attributes=None if raw.attributes is None else raw.attributes.iloc[rows],
    )


def feature_count(path: str, layer: str | None = None) -> int | None:
    """How many features a file has, before any filter, where that is known without reading it."""
    import pyogrio

    file = _existing(path)
    try:
        if _reader(file) == _GDAL:
            count = pyogrio.read_info(file, layer=layer)["features"]
            return int(count) if count >= 0 else None
        if _reader(file).startswith("scenes.geoparquet"):
            from pyarrow import parquet

            return int(parquet.read_metadata(file).num_rows)
    except Exception:  # a count is for a progress bar: reading will say what is wrong
        return None
    return None


def _nothing(path: str, dropped: list[Note], layer: str | None, where: str | None) -> str:
    """Why there is no polygon, in one line."""
    if dropped:
        which, reason = dropped[0]
        more = f" and {len(dropped) - 1} more" if len(dropped) > 1 else ""
        return f"{path} holds no usable polygon: {which} {reason}{more}"
    asked = [f"{k}={v}" for k, v in (("layer", layer), ("where", where)) if v is not None]
    if asked:
        return f"{path} holds no polygon for {', '.join(asked)}: widen the filter"
    return f"{path} holds no polygon: give a file with polygons"


def _stacked(tables: list[Any]) -> pd.DataFrame | None:
    import pandas as pd  # takes longer to import than most scenes to load

    known = [table for table in tables if table is not None and table.shape[1]]
    return pd.concat(known, ignore_index=True) if known else None
