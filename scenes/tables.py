"""Attribute tables of Arrow as pandas has them, whatever bytes their texts hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


def to_pandas(batch: Any) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """A batch of Arrow as a table, and a note on columns whose text is not UTF-8.

    Old Shapefiles and exports of databases have such text; what cannot be read becomes U+FFFD.
    """
    try:
        return batch.to_pandas(), ()
    except UnicodeDecodeError:
        pass
    import pyarrow as pa

    arrays, broken = [], []
    for field, column in zip(batch.schema, batch.columns, strict=True):
        try:
            column.to_pandas()
        except UnicodeDecodeError:
            broken.append(field.name)
            wide = pa.types.is_large_string(field.type)
            texts = column.cast(pa.large_binary() if wide else pa.binary()).to_pylist()
            column = pa.array([t if t is None else t.decode("utf-8", "replace") for t in texts])
        arrays.append(column)
    table = pa.RecordBatch.from_arrays(arrays, names=batch.schema.names).to_pandas()
    note = f"text of {', '.join(broken)} is not UTF-8: what cannot be read became U+FFFD"
    return table, (note,)
