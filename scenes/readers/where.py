"""`where` for files that GDAL does not read: the same SQL conditions, evaluated by SQLite."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scenes.scene import SceneError

if TYPE_CHECKING:
    import pandas as pd


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
