"""STL, binary and text: corners at the same place are one vertex."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.models.mesh import Mesh, Part, tolerance_of
from harness.models.text_file import TextFile, numbered, text_step, text_tolerance, write_bytes

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD = 84
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)
_END = re.compile(rb"\bendsolid\b", re.IGNORECASE)


class StlModel:
    """An STL file. Normals stay where they are: on a flat face they are all the same."""

    def __init__(self, path: Path) -> None:
        self._text = TextFile(path)
        self.left: Counter[str] = Counter()
        data = self._text.data
        self._records: NDArray[np.void] | None = None
        count = int.from_bytes(data[_HEAD - 4 : _HEAD], "little")
        if len(data) == _HEAD + count * _RECORD.itemsize:
            self._records = np.frombuffer(data, _RECORD, offset=_HEAD).copy()
            return
        self._found = [match.span(1) + match.span(3) for match in _VERTEX.finditer(data)]
        if data.lstrip()[:5].lower() != b"solid" or len(self._found) % 3 or not self._found:
            raise ValueError(f"{len(data):,} bytes, {count:,} triangles")
        words = (data[span[0] : span[3]].split() for span in self._found)
        self._corners = np.array([[float(word) for word in three] for three in words])

    def groups(self) -> Iterator[list[Part]]:
        """Yield all parts together: binary triangles of one attribute, or those of one solid."""
        if self._records is not None:
            corners = self._records["corners"].reshape(-1, 3)
            owner = self._records["attribute"].astype(np.int64)
        else:
            corners = self._corners
            ends = [match.start() for match in _END.finditer(self._text.data)]
            owner = np.searchsorted(ends, [span[0] for span in self._found[::3]])
        yield [self._part(corners, np.flatnonzero(owner == value)) for value in np.unique(owner)]

    def _part(self, corners: NDArray[np.floating], rows: NDArray[np.int64]) -> Part:
        own = corners.reshape(-1, 3, 3)[rows].reshape(-1, 3)
        first, number = numbered(own)
        with np.errstate(invalid="ignore"):
            positions = own[first].astype(np.float64)
        none = np.empty((len(positions), 0))
        if self._records is not None:
            tolerance = tolerance_of(positions)
        else:
            data = self._text.data
            step = text_step(data[span[0] : span[3]].split()[0] for span in self._found)
            tolerance = text_tolerance(positions, step)
        mesh = Mesh(positions, number.reshape(-1, 3), none, none, tolerance)
        return Part(mesh, (rows, first))

    def replace(self, part: Part, triangles: NDArray[np.int64]) -> None:
        """Give a part other triangles (m, 3)."""
        rows, first = part.source
        if self._records is not None:
            corners = self._records["corners"][rows].reshape(-1, 3)
            self._records["corners"][rows] = corners[first][triangles]
            return
        spans = np.array(self._found, dtype=np.int64).reshape(-1, 3, 4)[rows][:, :, [0, 3]]
        places = spans.reshape(-1, 2)[first].tolist()
        words = [self._text.data[begin:end] for begin, end in places]
        self._text.replace(spans, part.mesh.triangles, triangles, words)

    def write(self, out: Path) -> list[Path]:
        """Write the model; returns the files."""
        if self._records is None:
            return self._text.write(out)
        return write_bytes(out, self._text.data[:_HEAD] + self._records.tobytes())
