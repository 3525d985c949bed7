"""Polygons of a user's file, whole or in chunks, in metres if they are in degrees."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.cleaning.projection import Projection, is_geographic, off_globe, system, units
from scenes.cleaning.repair import Cleaned, clean
from scenes.readers.guard import existing
from scenes.readers.reader import GDAL, Raw, Source, reader_of
from scenes.scene import Note, Scene, SceneError

if TYPE_CHECKING:
    import pandas as pd

CHUNK = 50_000
"""Features a chunk holds unless asked otherwise."""


@dataclass(frozen=True)
class Chunk:
    """A part of a file: valid polygons, their attributes, and notes on the rest.

    `crs` is the file's reference system. If the polygons were projected from longitude and
    latitude, `projection` is their map, which also leads back. `notes` say what was done to the
    file as a whole; each is in the first chunk that it is true of. `credit` names whose data they
    are, where that has to be told. `labels` name its features, which
    `cleaned.source` numbers; () where they have no names.
    """

    cleaned: Cleaned
    attributes: pd.DataFrame | None
    units: str
    crs: str | None = None
    projection: Projection | None = None
    notes: tuple[str, ...] = ()
    credit: str = ""
    labels: Sequence[str] = ()


def read(
    path: str,
    *,
    layer: str | None = None,
    where: str | None = None,
    limit: int | None = None,
    project: bool | None = None,
    attributes: bool = True,
) -> Scene:
    """All polygons of a file, as a scene.

    Each part of a multi-polygon becomes a polygon and heights are dropped. Longitude and latitude
    are projected to metres, by default if the file's reference system is geographic: see
    `scenes.cleaning.projection`. `project=False` keeps degrees, `project=True` takes coordinates
    without a known reference system as those of WGS 84. `limit` stops after that many polygons.
    Without `attributes`, GDAL reads none.

    Raises SceneError if the file is missing, cannot be read, or holds no polygon.
    """
    if limit is not None and limit < 1:
        raise SceneError(f"limit={limit} leaves no polygon of {path}: give 1 or more")
    polygons: list[Any] = []
    tables: list[Any] = []
    dropped: list[Note] = []
    repaired: list[Note] = []
    notes: list[str] = []
    units = "units"
    size = CHUNK if limit is None else min(CHUNK, max(1000, 2 * limit))
    chunks = read_chunks(
        path, layer=layer, where=where, project=project, size=size, attributes=attributes
    )
    for chunk in chunks:
        polygons.extend(chunk.cleaned.polygons)
        tables.append(chunk.attributes)
        dropped += chunk.cleaned.dropped
        repaired += chunk.cleaned.repaired
        notes += chunk.notes
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
        notes=tuple(notes),
    )
    return scene if limit is None else scene.head(limit)


def read_chunks(
    path: str,
    *,
    layer: str | None = None,
    where: str | None = None,
    project: bool | None = None,
    size: int = CHUNK,
    rows: tuple[int, int] | None = None,
    attributes: bool = True,
) -> Iterator[Chunk]:
    """The polygons of a file, about `size` features at a time, so that memory stays bounded.

    `rows` are the first feature to read and the one after the last, in files that
    `scenes.slices` cuts. All chunks are on the same map, chosen by the first, so they fit together.
    Raises SceneError as `read` does, but a file without polygons yields chunks without polygons.
    """
    source = Source(existing(path), layer, where, rows, attributes)
    raws = _raws(source, size)
    if rows is None:  # a file may have no feature at all
        raws = chain([next(raws, Raw([], []))], raws)
    units, crs, projection = "units", None, None
    decided, said = False, set[str]()
    for raw in raws:
        given = np.empty(len(raw.geometries), dtype=object)
        given[:] = raw.geometries
        notes = [*raw.notes, *["heights (Z) dropped"] * bool(shapely.has_z(given).any())]
        coordinates, owner = shapely.get_coordinates(given, return_index=True)
        off = np.zeros(len(given), dtype=bool)
        off[owner[off_globe(coordinates)]] = True
        if not decided:
            crs = raw.crs
            if len(coordinates):
                decided = True
                # one bad vertex makes no plane of a file of degrees; GDAL gives EPSG:4326 to every
                # GeoJSON without `crs`, so where many features are off the globe, it is a plane
                some = len(np.unique(owner))
                few = off.sum() <= max(1, FEW_OFF * some) and off.sum() < some
                globe = given[~off] if few else None
                units, crs, projection, told = _placing(path, raw, globe, project)
                notes += told
        fresh = tuple(note for note in notes if note not in said)
        said.update(fresh)
        placed = replace(raw, geometries=given)
        if projection is not None:
            placed = _projected(placed, off, projection)
        cleaned = clean(
            placed.geometries, placed.labels, projection.inverse if projection else None
        )
        cleaned.dropped[:0] = placed.dropped
        cleaned.repaired[:0] = placed.repaired
        table = placed.attributes
        if table is not None:
            table = table.iloc[cleaned.source].reset_index(drop=True)
        yield Chunk(cleaned, table, units, crs, projection, fresh, labels=placed.labels)


def _raws(source: Source, size: int) -> Iterator[Raw]:
    """What the file's reader yields, filtered by `where` if the reader cannot do that itself."""
    reader = reader_of(source.path)
    for raw in reader(source, size):
        if source.where is None or reader is GDAL:
            yield raw
        else:
            yield raw.rows(matching(raw.attributes, source.where, str(source.path)))


def _nothing(path: str, dropped: list[Note], layer: str | None, where: str | None) -> str:
    """Why there is no polygon, in one line."""
    if dropped:
        which, reason = dropped[0]
        more = f" (and {len(dropped) - 1} more)" if len(dropped) > 1 else ""
        return f"{path} holds no usable polygon: {which} {reason}{more}"
    asked = [f"{k}={v}" for k, v in (("layer", layer), ("where", where)) if v is not None]
    if asked:
        return f"{path} holds no polygon for {', '.join(asked)}: widen the filter"
    return f"{path} holds no polygon: give a file with polygons"


def _stacked(tables: list[Any]) -> pd.DataFrame | None:
    known = [table for table in tables if table is not None and table.shape[1]]
    if not known:
        return None
    import pandas as pd  # takes longer to import than most scenes to load

    table: pd.DataFrame = pd.concat(known, ignore_index=True)
    return table


_DEGREES = "OGC:CRS84"
FEW_OFF = 0.2
"""Share of features off the globe, up to which the others are taken for degrees."""

_OFF = "has a vertex off the globe, beyond 90 degrees of latitude or 360 of longitude"
_TORN = "crosses the 180th meridian, where a map of the whole globe ends: cut it there"


def _projected(raw: Raw, off: NDArray[np.bool_], projection: Projection) -> Raw:
    """The chunk on its map; geometries that cannot be on it are named and left out.

    off : which have a vertex off the globe
    """
    torn = projection.torn(np.asarray(raw.geometries)) & ~off
    dropped = [(raw.labels[i], _OFF) for i in np.flatnonzero(off)]
    dropped += [(raw.labels[i], _TORN) for i in np.flatnonzero(torn)]
    kept = raw.rows(np.flatnonzero(~off & ~torn))
    projected = projection.project(kept.geometries)
    return replace(kept, geometries=projected, dropped=raw.dropped + dropped)


def _placing(
    path: str, raw: Raw, globe: NDArray[Any] | None, project: bool | None
) -> tuple[str, str | None, Projection | None, list[str]]:
    """The units, reference system and map of a file, by its first chunk with a geometry, and notes.

    globe : the geometries that are on the globe; None where these are too few for degrees
    project : None: the file's reference system decides; False: never; True: coordinates without a
        known system are longitude and latitude. Raises SceneError if that is not possible.
    """
    known = system(raw.crs)
    geographic = is_geographic(raw.crs) and globe is not None
    if project or (geographic and project is None):
        if known is not None and not known.is_geographic:
            raise SceneError(f"{path} is in {known.name} already: leave project=True out")
        if globe is None:
            raise SceneError(
                f"the coordinates of {path} are not longitude and latitude: leave project=True out"
            )
        crs = raw.crs if geographic and raw.crs else _DEGREES
        projection = Projection.of(crs, globe)
        name = known.name if geographic and known is not None else "taken as WGS 84"
        note = f"longitude and latitude ({name}) projected to metres, {projection}"
        return "m", crs, projection, [note]
    off = known is not None and known.is_geographic and not geographic
    used = None if off else raw.crs
    unit = units(used) or raw.units if raw.units == "units" else raw.units
    if known is not None:
        note = f"coordinates in {known.name}, {unit}"
        if off:
            note = f"coordinates are not degrees as in {known.name}, used as they are"
        return unit, used, None, [note]
    if raw.crs is not None:
        shown = raw.crs if len(raw.crs) <= 40 else f"{raw.crs[:40]}..."
        note = f"the reference system {shown} is not known, coordinates used as they are"
        return unit, used, None, [note]
    can_have_one = Path(path).suffix.lower() in (".shp", ".gpkg", ".fgb")
    note = "no reference system, coordinates used as they are"
    return unit, used, None, [note] * can_have_one


def matching(table: pd.DataFrame | None, condition: str, path: str) -> NDArray[np.int64]:
    """Numbers of the rows that meet the condition, ascending.

    Raises SceneError if the file has no attributes, or the condition is not valid for them. A field
    of a nested column is written with a dot.

    >>> import pandas as pd
    >>> matching(pd.DataFrame({"h": [3, 8, 12]}), "h > 5", "town.parquet").tolist()
    [1, 2]
    >>> boxes = pd.DataFrame({"bbox": [{"xmin": 3.0}, {"xmin": 8.0}]})
    >>> matching(boxes, "bbox.xmin > 5", "town.parquet").tolist()
    [1]
    """
    if table is None or not table.shape[1]:
        raise SceneError(f"{path} has no attributes: where={condition!r} cannot be met")
    table, condition = _unnested(table, condition)
    columns = ", ".join('"' + str(c).replace('"', '""') + '"' for c in table.columns)
    marks = ", ".join("?" * table.shape[1])
    with closing(sqlite3.connect(":memory:")) as database:
        try:
            database.execute(f"CREATE TABLE features ({columns})")
            rows = (tuple(map(_plain, row)) for row in table.itertuples(index=False, name=None))
            database.executemany(f"INSERT INTO features VALUES ({marks})", rows)
            query = f"SELECT rowid - 1 FROM features WHERE ({condition}) ORDER BY rowid"
            found = database.execute(query).fetchall()
        except (sqlite3.Error, sqlite3.Warning, OverflowError, ValueError) as error:
            raise SceneError(f"{path}: condition {condition!r} is not valid: {error}") from error
    return np.array([row for (row,) in found], dtype=np.int64)


_FIELD = re.compile(r"'[^']*'|\"[^\"]*\"|\b([^\W\d]\w*)\.([^\W\d]\w*)\b")
"""A text in quotes, in which nothing is replaced, or a nested column and its field."""


def _unnested(table: pd.DataFrame, condition: str) -> tuple[pd.DataFrame, str]:
    """The columns that the condition names, fields of nested ones beside them, and it rewritten."""
    fields: dict[str, list[Any]] = {}

    def quoted(found: re.Match[str]) -> str:
        name, field = found.groups()
        if name is None or name not in table.columns:
            return found[0]
        rows = (row.get(field) if isinstance(row, dict) else None for row in table[name])
        fields[f"{name}.{field}"] = list(rows)
        return f'"{name}.{field}"'

    rewritten = _FIELD.sub(quoted, condition)
    named = [column for column in table.columns if str(column).lower() in rewritten.lower()]
    nested = {name.partition(".")[0] for name in fields}
    plain = [column for column in named if column not in nested]
    kept = table[plain if plain or fields else list(table.columns[:1])]
    return kept.assign(**fields), rewritten


def _plain(value: Any) -> Any:
    """A value that SQLite can hold."""
    import pandas as pd

    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str, bytes)):
        return value
    return None if value is pd.NA or value is pd.NaT else str(value)
