"""What all writers share: what is said of the whole, attributes beside it, values for JSON."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import IO, Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.export.indexed_mesh import Mesh
from harness.stored.output import Output


@dataclass(frozen=True)
class About:
    """What a writer may say of the whole: units, origin of the polygons, and how to place them.

    crs : the reference system of the source's coordinates, as pyogrio names it, or None
    to_source : (n, 2) mesh coordinates to the source's own, where the polygons were projected
    """

    units: str
    triangulator: str
    credit: str = ""
    crs: str | None = None
    to_source: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None

    def in_source(self, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
        """Vertices in the source's coordinates, z as it is."""
        if self.to_source is None:
            return vertices
        return np.column_stack([self.to_source(vertices[:, :2]), vertices[:, 2:]])


class Writer(Protocol):
    """Takes the meshes of one export after another, then finishes the file."""

    def add(self, mesh: Mesh) -> None:
        """Write one more batch."""

    def finish(self) -> None:
        """Write what only the end knows; nothing is added after that."""


def append(target: IO[bytes], spool: IO[bytes]) -> None:
    """Copy a spooled part to the end of a file."""
    spool.seek(0)
    shutil.copyfileobj(spool, target, 1 << 20)


class AttributeTable:
    """Attributes beside a format that holds none: NAME.attributes.csv, one row per polygon."""

    def __init__(self, output: Output) -> None:
        self._output = output
        self._stream: IO[str] | None = None
        self._rows = 0

    def add(self, attributes: pd.DataFrame) -> None:
        """Append rows; `feature` numbers them through all batches."""
        if attributes.shape[1] == 0:
            return
        numbers = range(self._rows, self._rows + len(attributes))
        table = attributes.set_index(pd.Index(numbers, name="feature"))
        first = self._stream is None
        if self._stream is None:
            self._stream = self._output.file(".attributes.csv", "w")
        table.to_csv(self._stream, header=first)
        self._rows += len(attributes)


def plain(value: Any) -> Any:
    """A value that JSON can hold: numbers, text, booleans, None; NaN becomes None."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(each) for each in value]
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    return None if value is pd.NA or value is pd.NaT else str(value)
