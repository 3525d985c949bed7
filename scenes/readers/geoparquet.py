"""Reader of GeoParquet, by the optional package pyarrow; conversion of Arrow's tables to pandas."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from scenes.readers.reader import RawChunk, Source
from scenes.readers.wkt import parse_wkb
from scenes.scene import SceneError
from scenes.spec import format_suggestion, import_optional

if TYPE_CHECKING:
    import pandas as pd


def read(source: Source, size: int) -> Iterator[RawChunk]:
    """Yield the geometries of a column, by default the primary geometry column, encoded as WKB."""
    with import_parquet(source).ParquetFile(source.path) as file:
        column, crs, notes = find_geometry_column(source, file.schema_arrow)
        index = file.schema_arrow.names.index(column)
        for start, batch in _read_batches(file, source.rows, size):
            labels = [f"row {start + i}" for i in range(batch.num_rows)]
            table, more_notes = to_pandas(batch.remove_column(index), exact=source.rows is not None)
            geometries, dropped, repaired = parse_wkb(batch.column(index).to_pylist(), labels)
            raw = RawChunk(
                geometries, labels, table, crs, "units", dropped, repaired, notes + more_notes
            )
            yield raw.without_dropped()


def import_parquet(source: Source) -> Any:
    """Import and return pyarrow.parquet; raises SceneError with the command that installs it."""
    return import_optional("pyarrow.parquet", source.path, "geoparquet")


def _read_batches(file: Any, rows: tuple[int, int] | None, size: int) -> Iterator[tuple[int, Any]]:
    """Yield (index of the first row, batch of Arrow) for the rows (first, stop), or all if None."""
    sizes = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
    ends = np.cumsum(sizes, dtype=np.int64)
    first, last = rows or (0, file.metadata.num_rows)
    # The row groups that contain the rows; earlier rows of the first group are skipped.
    groups = [i for i, end in enumerate(ends) if end > first and end - sizes[i] < last]
    start = int(ends[groups[0]] - sizes[groups[0]]) if groups else 0
    for batch in file.iter_batches(batch_size=size, row_groups=groups):
        low, high = max(first - start, 0), min(last - start, batch.num_rows)
        if low < high:
            yield start + low, batch.slice(low, high - low)
        start += batch.num_rows
        if start >= last:
            return


def find_geometry_column(source: Source, schema: Any) -> tuple[str, str | None, tuple[str, ...]]:
    """Return name and reference system of the geometry column to read, and notes on others."""
    geo = json.loads((schema.metadata or {}).get(b"geo", b"null"))
    if not geo:
        raise SceneError(
            f"{source.path} has no geometry column in its GeoParquet metadata: "
            "write the file with a program that supports GeoParquet"
        )
    columns = geo["columns"]
    column = source.layer or geo["primary_column"]
    if column not in columns:
        raise SceneError(
            f"{source.path} has no geometry column {column!r}; "
            + format_suggestion(column, columns, "it has")
        )
    metadata = columns[column]
    encoding = metadata["encoding"]
    alternatives = [name for name in columns if name != column]
    notes = (
        (f"geometry column {column} (others: {', '.join(alternatives)})",) if alternatives else ()
    )
    if column not in schema.names or encoding != "WKB":
        raise SceneError(
            f"{source.path}: column {column} has the unsupported encoding {encoding}: write WKB"
        )
    return column, _format_crs(metadata.get("crs", "OGC:CRS84")), notes


def _format_crs(crs: Any) -> str | None:
    """Return a reference system in PROJJSON as "AUTHORITY:CODE", or as text if it has no code."""
    if not isinstance(crs, dict):
        return crs if isinstance(crs, str) else None
    identifier = crs.get("id")
    if isinstance(identifier, dict) and {"authority", "code"} <= identifier.keys():
        return f"{identifier['authority']}:{identifier['code']}"
    return json.dumps(crs)


def to_pandas(batch: Any, *, exact: bool = False) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Return a batch of Arrow as a pandas table, and a note on columns whose text is not UTF-8.

    exact : True for Arrow's types, equal in all slices of a file; in pandas' types, a missing value
        turns integers into floats

    >>> import pyarrow as pa
    >>> latin = pa.array([b"K\\xf6ln", None]).view(pa.string())
    >>> table, notes = to_pandas(pa.RecordBatch.from_arrays([latin], ["name"]))
    >>> table["name"][0], notes
    ('K\ufffdln', ('text of name is not UTF-8: invalid bytes became U+FFFD',))
    """
    import pandas as pd
    import pyarrow as pa

    arrays, invalid = [], []
    for field, column in zip(batch.schema, batch.columns, strict=True):
        try:
            column.validate(full=True)
        except pa.ArrowInvalid:
            invalid.append(field.name)
            column = _replace_invalid_text(column)
        arrays.append(column)
    notes: tuple[str, ...] = ()
    if invalid:
        batch = pa.RecordBatch.from_arrays(arrays, names=batch.schema.names)
        text = f"text of {', '.join(invalid)} is not UTF-8: invalid bytes became U+FFFD"
        notes = (text,)
    return batch.to_pandas(types_mapper=pd.ArrowDtype if exact else None), notes


def _replace_invalid_text(column: Any) -> Any:
    """Return a column of text with invalid UTF-8 replaced; other columns become empty."""
    import pyarrow as pa

    binary = {pa.string(): pa.binary(), pa.large_string(): pa.large_binary()}.get(column.type)
    if binary is None:
        return pa.nulls(len(column))
    texts = column.cast(binary).to_pylist()
    return pa.array([None if text is None else text.decode("utf-8", "replace") for text in texts])
