"""Polygons of a user's file, whole or in chunks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scenes.cleaning.clean import Cleaned, clean
from scenes.cleaning.projection import Projection
from scenes.readers.map_placement import Placing
from scenes.readers.opening import existing
from scenes.readers.reader import GDAL, Raw, Source, reader_of
from scenes.readers.where import matching
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
    are, where that has to be told.
    """

    cleaned: Cleaned
    attributes: pd.DataFrame | None
    units: str
    crs: str | None = None
    projection: Projection | None = None
    notes: tuple[str, ...] = ()
    credit: str = ""


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
    placing = Placing(path, project)
    for raw in _raws(source, size):
        placed, notes = placing.place(raw)
        cleaned = clean(placed.geometries, placed.labels, placing.back)
        cleaned.dropped[:0] = placed.dropped
        cleaned.repaired[:0] = placed.repaired
        table = placed.attributes
        if table is not None:
            table = table.iloc[cleaned.source].reset_index(drop=True)
        yield Chunk(cleaned, table, placing.units, placing.crs, placing.projection, notes)


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
        more = f" and {len(dropped) - 1} more" if len(dropped) > 1 else ""
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

    return pd.concat(known, ignore_index=True)
