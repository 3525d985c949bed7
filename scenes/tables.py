"""Attribute tables of Arrow as pandas tables, even if their texts are not UTF-8."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


def to_pandas(batch: Any) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """A batch of Arrow as a table, and a note on columns whose text is not UTF-8.

    Old Shapefiles and database exports have such text; what cannot be read becomes U+FFFD. Arrow
    and pandas do not check the bytes before the text is used.

    >>> import pyarrow as pa
    >>> latin = pa.array([b"K\\xf6ln", None]).view(pa.string())
    >>> table, notes = to_pandas(pa.RecordBatch.from_arrays([latin], ["name"]))
    >>> table["name"][0], notes
    ('K\ufffdln', ('text of name is not UTF-8: what cannot be read became U+FFFD',))
    """
    import pyarrow as pa

    arrays, broken = [], []
    for field, column in zip(batch.schema, batch.columns, strict=True):
        try:
            column.validate(full=True)
        except pa.ArrowInvalid:
            broken.append(field.name)
            column = _mended(column)
        arrays.append(column)
    if not broken:
        return batch.to_pandas(), ()
    table = pa.RecordBatch.from_arrays(arrays, names=batch.schema.names).to_pandas()
    note = f"text of {', '.join(broken)} is not UTF-8: what cannot be read became U+FFFD"
    return table, (note,)


def _mended(column: Any) -> Any:
    """A column of text with what is not UTF-8 replaced; other columns become empty."""
    import pyarrow as pa

    binary = {pa.string(): pa.binary(), pa.large_string(): pa.large_binary()}.get(column.type)
    if binary is None:
        return pa.nulls(len(column))
    texts = column.cast(binary).to_pylist()
    return pa.array([None if text is None else text.decode("utf-8", "replace") for text in texts])
