"""GeoParquet, by way of the optional package pyarrow."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import shapely

from scenes.files import Raw, Source
from scenes.scene import Note, SceneError


def read(source: Source, size: int) -> Iterator[Raw]:
    """Geometries of the file's primary column, `size` rows at a time.

    `layer` names another geometry column. Geometries must be encoded as WKB, which is what nearly
    all writers do.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise SceneError(
            f'{source.path} needs pyarrow to be read: pip install "raster-harness[geoparquet]"'
        ) from error
    try:
        with parquet.ParquetFile(source.path) as file:
            column, crs = _geometry_column(source, file.schema_arrow)
            start = 0
            for batch in file.iter_batches(batch_size=size):
                yield _raw(batch, column, crs, start)
                start += batch.num_rows
    except (pa.ArrowException, OSError, UnicodeError) as error:
        reason = " ".join(str(error).split())
        raise SceneError(f"{source.path} cannot be read as Parquet: {reason}") from error


def _geometry_column(source: Source, schema: Any) -> tuple[str, str | None]:
    """Name and reference system of the column to read."""
    try:
        geo = json.loads((schema.metadata or {}).get(b"geo", b"null"))
        column = source.layer or geo["primary_column"]
        about = geo["columns"][column]
        encoding = about["encoding"]
    except (ValueError, TypeError, KeyError) as error:
        what = "no geometry column" + (f" {source.layer!r}" if source.layer else "")
        raise SceneError(f"{source.path} has {what} in its GeoParquet metadata") from error
    if encoding != "WKB" or column not in schema.names:
        raise SceneError(
            f"{source.path}: column {column} is encoded as {encoding}, which is not read: "
            "write it as WKB"
        )
    return column, _code(about.get("crs", "OGC:CRS84"))


def _code(crs: Any) -> str | None:
    """PROJJSON to an authority code, or to the head of WKT that tells degrees from metres."""
    if not isinstance(crs, dict):
        return crs if isinstance(crs, str) else None
    identifier = crs.get("id")
    if isinstance(identifier, dict) and {"authority", "code"} <= identifier.keys():
        return f"{identifier['authority']}:{identifier['code']}"
    return "GEOGCRS" if crs.get("type") == "GeographicCRS" else None


def _raw(batch: Any, column: str, crs: str | None, start: int) -> Raw:
    labels = [f"row {start + i}" for i in range(batch.num_rows)]
    index = batch.schema.names.index(column)
    values = batch.column(index).to_pylist()
    geometries = shapely.from_wkb(np.array([*values, None], dtype=object), on_invalid="ignore")[:-1]
    table = batch.remove_column(index).to_pandas()
    broken = [
        i
        for i, (value, made) in enumerate(zip(values, geometries, strict=True))
        if value and not made
    ]
    dropped: list[Note] = [(labels[i], "geometry cannot be parsed as WKB") for i in broken]
    keep = np.setdiff1d(np.arange(batch.num_rows), broken)
    return Raw(
        geometries[keep],
        [labels[i] for i in keep],
        table.iloc[keep].reset_index(drop=True),
        crs,
        dropped=dropped,
    )
