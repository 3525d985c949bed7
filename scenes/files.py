"""Polygons of a user's file, all at once or in chunks; degrees are projected to metres."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from decimal import Decimal
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from scenes.projection import Projection, find_system, is_geographic
from scenes.readers.guard import check_path, check_quoted_names
from scenes.readers.reader import GDAL, RawChunk, Source, choose_reader
from scenes.repair import Cleaned, clean
from scenes.scene import Note, Scene, SceneError

if TYPE_CHECKING:
    import pandas as pd

CHUNK_FEATURES = 50_000  # features that are read at a time by default


@dataclass(frozen=True)
class Chunk:
    """The polygons of consecutive features of a file, with attributes and notes.

    projection : projection of longitude and latitude to metres, or None
    notes : notes on the complete file, only in the first chunk to which they apply
    labels : names of the features, by index in `cleaned.source`, or ()
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
    """Return all polygons of a file as a scene.

    Coordinates are projected to metres if the file's reference system is geographic: see
    `scenes.projection`. `project=False` leaves degrees; `project=True` also projects coordinates
    without a known reference system, taken as WGS 84. `where` is an SQL condition on attributes.
    With `attributes=False`, GDAL reads no attributes, which is faster.
    """
    if limit is not None and limit < 1:
        raise SceneError(f"limit={limit} is out of range for {path}: give 1 or more")
    polygons: list[Any] = []
    tables: list[Any] = []
    dropped: list[Note] = []
    repaired: list[Note] = []
    notes: list[str] = []
    units = "units"
    size = CHUNK_FEATURES if limit is None else min(CHUNK_FEATURES, max(1000, 2 * limit))
    chunks = read_chunks(
        path, layer=layer, where=where, project=project, size=size, attributes=attributes
    )
    for chunk in chunks:
        polygons.extend(chunk.cleaned.polygons)
        if chunk.attributes is not None and chunk.attributes.shape[1]:
            tables.append(chunk.attributes)
        dropped += chunk.cleaned.dropped
        repaired += chunk.cleaned.repaired
        notes += chunk.notes
        units = chunk.units
        if limit is not None and len(polygons) >= limit:
            break
    if not polygons:
        filters = [f"{k}={v}" for k, v in (("layer", layer), ("where", where)) if v is not None]
        widen = f" for {', '.join(filters)}: widen the filter"
        raise SceneError(
            explain_empty(path, dropped, widen if filters else ": give a file with polygons")
        )
    table: pd.DataFrame | None = None
    if tables:
        import pandas as pd  # importing pandas takes longer than loading most scenes

        table = pd.concat(tables, ignore_index=True)
    parameters = {"layer": layer, "where": where, "limit": limit, "project": project}
    scene = Scene(
        name=Path(path).stem,
        polygons=polygons,
        units=units,
        description=str(path),
        licence="as the file's",
        parameters={k: v for k, v in parameters.items() if v is not None},
        dropped=dropped,
        repaired=repaired,
        attributes=table,
        notes=tuple(notes),
    )
    return scene if limit is None else scene.head(limit)


def read_chunks(
    path: str,
    *,
    layer: str | None = None,
    where: str | None = None,
    project: bool | None = None,
    size: int = CHUNK_FEATURES,
    rows: tuple[int, int] | None = None,
    attributes: bool = True,
) -> Iterator[Chunk]:
    """Yield the polygons of a file, about `size` features at a time, in bounded memory.

    `rows` is the range of features (first, stop) to read, in files that `scenes.slices` cuts; see
    `read` for other parameters. The first chunk determines the projection of all chunks.
    """
    source = Source(check_path(path), layer, where, rows, attributes)
    raws = _read_raw_chunks(source, size)
    if rows is None:  # a file without features gives one empty chunk
        raws = chain([next(raws, RawChunk([], []))], raws)
    units, crs, projection = "units", None, None
    is_decided, reported = False, set[str]()
    for raw in raws:
        geometries = np.empty(len(raw.geometries), dtype=object)
        geometries[:] = raw.geometries
        notes = [*raw.notes, *["heights (Z) dropped"] * bool(shapely.has_z(geometries).any())]
        coordinates, owner = shapely.get_coordinates(geometries, return_index=True)
        is_off = np.zeros(len(geometries), dtype=bool)
        is_off[owner[(np.abs(coordinates) > [360.0, 90.0 + 1e-9]).any(axis=1)]] = True
        if not is_decided:
            crs = raw.crs
            if len(coordinates):
                is_decided = True
                # GDAL assigns EPSG:4326 to every GeoJSON without `crs`. Coordinates are planar if
                # many features are off the globe; a few are errors.
                count = len(np.unique(owner))
                limit = min(max(1, MAX_OFF_GLOBE_SHARE * count), count - 1)
                globe = geometries[~is_off] if is_off.sum() <= limit else None
                units, crs, projection, more_notes = _choose_projection(path, raw, globe, project)
                notes += more_notes
        new_notes = tuple(note for note in notes if note not in reported)
        reported.update(new_notes)
        raw = replace(raw, geometries=geometries)
        if projection is not None:
            raw = _project_chunk(raw, is_off, projection)
        cleaned = clean(raw.geometries, raw.labels, projection.inverse if projection else None)
        cleaned.dropped[:0] = raw.dropped
        cleaned.repaired[:0] = raw.repaired
        table = raw.attributes
        if table is not None:
            table = table.iloc[cleaned.source].reset_index(drop=True)
        yield Chunk(cleaned, table, units, crs, projection, new_notes, labels=raw.labels)


def _read_raw_chunks(source: Source, size: int) -> Iterator[RawChunk]:
    reader = choose_reader(source.path)
    for raw in reader(source, size):
        if source.where is None or reader is GDAL:
            yield raw
        else:
            yield raw.select_rows(
                find_matching_rows(raw.attributes, source.where, str(source.path))
            )


def explain_empty(path: str, dropped: list[Note], remedy: str) -> str:
    """Return the message for a file without polygons: the first dropped feature, or a remedy."""
    if not dropped:
        return f"{path} holds no polygon{remedy}"
    which, reason = dropped[0]
    more = f" (and {len(dropped) - 1} more)" if len(dropped) > 1 else ""
    return f"{path} holds no usable polygon: {which} {reason}{more}"


_DEGREES_CRS = "OGC:CRS84"
MAX_OFF_GLOBE_SHARE = 0.2  # of features, in a file of longitude and latitude
_OFF_GLOBE = "has a vertex off the globe, beyond 90 degrees of latitude or 360 of longitude"
_TORN = "crosses the 180th meridian, where a map of the globe ends: split it"


def _project_chunk(raw: RawChunk, is_off: NDArray[np.bool_], projection: Projection) -> RawChunk:
    """Return a chunk projected to metres; geometries off or across the map's edge become notes."""
    torn = projection.find_torn_geometries(np.asarray(raw.geometries)) & ~is_off
    dropped = [(raw.labels[i], _OFF_GLOBE) for i in np.flatnonzero(is_off)]
    dropped += [(raw.labels[i], _TORN) for i in np.flatnonzero(torn)]
    on_map = raw.select_rows(np.flatnonzero(~is_off & ~torn))
    projected = projection.project(on_map.geometries)
    return replace(on_map, geometries=projected, dropped=raw.dropped + dropped)


def _choose_projection(
    path: str, raw: RawChunk, globe: NDArray[Any] | None, project: bool | None
) -> tuple[str, str | None, Projection | None, list[str]]:
    """Return units, reference system, projection and notes of a file, by its first coordinates.

    globe : the geometries with all vertices in the range of longitude and latitude; None if so few
        are in that range that coordinates cannot be degrees
    """
    datum = find_system(raw.crs)
    geographic = is_geographic(raw.crs) and globe is not None
    if project or (geographic and project is None):
        if datum is not None and not datum.is_geographic:
            raise SceneError(f"{path} is in {datum.name} already: leave project=True out")
        if globe is None or (datum is not None and not geographic):
            raise SceneError(
                f"the coordinates of {path} are not longitude and latitude in degrees: "
                "leave project=True out"
            )
        crs = raw.crs if geographic and raw.crs else _DEGREES_CRS
        projection = Projection.fit(crs, globe)
        name = datum.name if geographic and datum is not None else "taken as WGS 84"
        note = f"longitude and latitude ({name}) projected to metres, {projection}"
        return "m", crs, projection, [note]
    is_planar = datum is not None and datum.is_geographic and not geographic
    file_crs = None if is_planar else raw.crs
    unit = raw.units
    if unit == "units" and datum is not None and datum.axis_info and not is_planar:
        unit = {"metre": "m"}.get(datum.axis_info[0].unit_name, datum.axis_info[0].unit_name)
    if datum is not None:
        note = f"coordinates in {datum.name}, {unit}"
        if is_planar:
            note = f"coordinates are not degrees as in {datum.name}; used unchanged"
        return unit, file_crs, None, [note]
    if raw.crs is not None:
        name = raw.crs if len(raw.crs) <= 40 else f"{raw.crs[:40]}..."
        note = f"the reference system {name} is unknown; coordinates used unchanged"
        return unit, file_crs, None, [note]
    is_format_with_system = Path(path).suffix.lower() in (".shp", ".gpkg", ".fgb", ".zip")
    note = "no reference system; coordinates used unchanged"
    if globe is not None:
        note += "; if they are longitude and latitude, add project=true"
    return unit, file_crs, None, [note] * is_format_with_system


def find_matching_rows(table: pd.DataFrame | None, condition: str, path: str) -> NDArray[np.int64]:
    """Return the indices of the rows that meet an SQL condition, ascending.

    >>> import pandas as pd
    >>> find_matching_rows(pd.DataFrame({"h": [3, 8, 12]}), "h > 5", "town.parquet").tolist()
    [1, 2]
    >>> boxes = pd.DataFrame({"bbox": [{"xmin": 3.0}, {"xmin": 8.0}]})
    >>> find_matching_rows(boxes, "bbox.xmin > 5", "town.parquet").tolist()
    [1]
    """
    if table is None or not table.shape[1]:
        raise SceneError(f"{path} has no attributes: leave where={condition!r} out")
    check_quoted_names(path, condition, map(str, table.columns))
    table, condition = _flatten_fields(table, condition)
    columns = ", ".join('"' + str(c).replace('"', '""') + '"' for c in table.columns)
    marks = ", ".join("?" * table.shape[1])
    with closing(sqlite3.connect(":memory:")) as database:
        try:
            database.execute(f"CREATE TABLE features ({columns})")
            rows = (tuple(map(_to_sqlite, row)) for row in table.itertuples(index=False, name=None))
            database.executemany(f"INSERT INTO features VALUES ({marks})", rows)
            query = f"SELECT rowid - 1 FROM features WHERE ({condition}) ORDER BY rowid"
            numbers = database.execute(query).fetchall()
        except (sqlite3.Error, sqlite3.Warning, OverflowError, ValueError) as error:
            raise SceneError(f"{path}: invalid condition {condition!r}: {error}") from error
    return np.array([row for (row,) in numbers], dtype=np.int64)


_FIELD = re.compile(r"'[^']*'|\"[^\"]*\"|\b([^\W\d]\w*)\.([^\W\d]\w*)\b")
"""Quoted text, or a nested column and a field."""


def _flatten_fields(table: pd.DataFrame, condition: str) -> tuple[pd.DataFrame, str]:
    """Return the columns that a condition uses, and the condition; nested fields become columns."""
    fields: dict[str, list[Any]] = {}

    def quote(match: re.Match[str]) -> str:
        name, field = match.groups()
        if name is None or name not in table.columns:
            return match[0]
        rows = (row.get(field) if isinstance(row, dict) else None for row in table[name])
        fields[f"{name}.{field}"] = list(rows)
        return f'"{name}.{field}"'

    rewritten = _FIELD.sub(quote, condition)
    columns_used = [column for column in table.columns if str(column).lower() in rewritten.lower()]
    nested = {name.partition(".")[0] for name in fields}
    plain = [column for column in columns_used if column not in nested]
    columns = table[plain if plain or fields else list(table.columns[:1])]
    return columns.assign(**fields), rewritten


def _to_sqlite(value: Any) -> Any:
    import pandas as pd

    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str, bytes)):
        return value
    if isinstance(value, Decimal):  # as text, it would exceed every number
        return float(value)
    return None if value is pd.NA or value is pd.NaT else str(value)
