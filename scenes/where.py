"""`where` for files that GDAL does not read: the same SQL conditions, evaluated by SQLite."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from scenes.scene import SceneError


def matching(table: pd.DataFrame | None, condition: str, path: str) -> NDArray[np.int64]:
    """Numbers of the rows that meet the condition, ascending.

    Raises SceneError if the file has no attributes, or the condition is not valid for them.

    >>> matching(pd.DataFrame({"h": [3, 8, 12]}), "h > 5", "town.parquet").tolist()
    [1, 2]
    """
    if table is None or not table.shape[1]:
        raise SceneError(f"{path} has no attributes: where={condition!r} cannot be met")
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


def _plain(value: Any) -> Any:
    """A value that SQLite can hold."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str, bytes)):
        return value
    return None if value is pd.NA or value is pd.NaT else str(value)
