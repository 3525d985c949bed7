"""Attribute tables of Arrow as pandas tables, even if their texts are not UTF-8."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


def to_pandas(batch: Any, *, exact: bool = False) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """A batch of Arrow as a table, and a note on columns whose text is not UTF-8.

    `exact`: columns keep Arrow's types, so that each part of a file has those of the whole;
    otherwise they become those of pandas, where a missing value makes a float of an integer.

    Old Shapefiles and database exports have text that is not UTF-8; what cannot be read becomes
    U+FFFD. Arrow and pandas do not check the bytes before the text is used.

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
        return _table(batch, exact), ()
    table = _table(pa.RecordBatch.from_arrays(arrays, names=batch.schema.names), exact)
    note = f"text of {', '.join(broken)} is not UTF-8: what cannot be read became U+FFFD"
    return table, (note,)


def _table(batch: Any, exact: bool) -> pd.DataFrame:
    import pandas as pd

    table: pd.DataFrame = batch.to_pandas(types_mapper=pd.ArrowDtype if exact else None)
    return table


def _mended(column: Any) -> Any:
    """A column of text with what is not UTF-8 replaced; other columns become empty."""
    import pyarrow as pa

    binary = {pa.string(): pa.binary(), pa.large_string(): pa.large_binary()}.get(column.type)
    if binary is None:
        return pa.nulls(len(column))
    texts = column.cast(binary).to_pylist()
    return pa.array([None if text is None else text.decode("utf-8", "replace") for text in texts])
