"""PLY (Stanford polygon format), text and binary: the indices of its triangles.

Source: G. Turk, "The PLY Polygon File Format", 1994.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.models.mesh import Mesh, Part, centred, tolerance_of
from harness.models.text_file import TextFile, text_step, text_tolerance, write_bytes

_KINDS = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_LISTS = ("vertex_indices", "vertex_index")
_LEAST = {
    **dict.fromkeys(("nx", "ny", "nz"), 1e-4),
    **dict.fromkeys(("red", "green", "blue", "alpha"), 1e-4),
    **dict.fromkeys(("s", "t", "u", "v", "texture_u", "texture_v"), 2.0**-18),
}
"""By how much what is interpolated may be off on a flat face, at least; the rest has to agree."""

_UNSHADED = (
    "it holds no normals: a program that makes smooth ones of the triangles round each vertex may "
    "shade other triangles otherwise; store normals first"
)


class _Element(NamedTuple):
    """name, size, and (name, kind) of each property; a list's kind is "count kind"."""

    name: str
    size: int
    properties: list[tuple[str, str]]


class PlyModel:
    """A PLY file whose faces are triangles; raises whatever it meets in another one."""

    def __init__(self, path: Path) -> None:
        self._text = TextFile(path)
        self.left: Counter[str] = Counter()
        self._spans: NDArray[np.int64] | None = None  # of a text: where the indices stand
        self._read()

    def _read(self) -> None:
        data = self._text.data
        head = re.match(rb"ply\r?\n.*?end_header\r?\n", data, re.DOTALL)
        if head is None:
            raise ValueError("it has no header")
        lines = head[0].decode("latin-1").splitlines()
        order = next(_ORDERS[line.split()[1]] for line in lines if line.startswith("format "))
        self._elements: dict[str, _Element] = {}
        last = None
        for words in (line.split() for line in lines):
            if words[:1] == ["element"]:
                last = _Element(words[1], int(words[2]), [])
                self._elements[words[1]] = last
            elif words[:1] == ["property"] and last is not None:
                kinds = [_KINDS[word] for word in words[1:-1] if word != "list"]
                last.properties.append((words[-1], " ".join(kinds)))
        if self._elements["face"].size == 0:
            raise ValueError("it holds no face")
        names = [name for name, _ in self._elements["face"].properties if name in _LISTS]
        if not names:
            raise ValueError(f"its faces have no {_LISTS[0]}")
        self._list = names[0]
        if order:
            self._read_binary(order, head.end())
        else:
            self._read_text(head.end())
        indices = self._indices
        if indices.min() < 0 or indices.max() >= self._elements["vertex"].size:
            raise ValueError(
                f"index {indices.max():,} of {self._elements['vertex'].size:,} vertices"
            )

    def _read_binary(self, order: str, place: int) -> None:
        for element in self._elements.values():
            fields: list[Any] = []
            for name, kind in element.properties:
                count, _, each = kind.rpartition(" ")
                if count and name != self._list:
                    raise ValueError(f"a list of {name}")
                if count:
                    fields.append((f"{name} count", order + count))
                fields.append((name, order + each, 3) if count else (name, order + each))
            kind_of = np.dtype(fields)
            last = place + element.size * kind_of.itemsize
            if last > len(self._text.data):
                raise ValueError(f"{element.name}: it is cut off, or has faces of other corners")
            rows = np.frombuffer(self._text.data, kind_of, element.size, place)
            if element.name == "vertex":
                self._vertices = {name: rows[name] for name, _ in element.properties}
            elif element.name == "face":
                if (rows[f"{self._list} count"] != 3).any():
                    raise ValueError("it has faces that are no triangles")
                self._rows, self._place = rows.copy(), place
                self._indices = rows[self._list].astype(np.int64)
                self._others = {n: rows[n] for n, _ in element.properties if n != self._list}
            place = last
        if place != len(self._text.data):
            raise ValueError(f"{len(self._text.data) - place:,} bytes too many: not all triangles")

    def _read_text(self, place: int) -> None:
        lines = self._text.data[place:].splitlines(keepends=True)
        begins = np.cumsum([place, *map(len, lines)])
        first = 0
        for element in self._elements.values():
            own = lines[first : first + element.size]
            if len(own) < element.size:
                raise ValueError(f"{element.name}: {len(own):,} of {element.size:,} lines")
            if element.name == "vertex":
                self._step = text_step(word for line in own for word in line.split()[:3])
                rows = np.array([line.split() for line in own], dtype=np.float64)
                names = [name for name, _ in element.properties]
                self._vertices = dict(zip(names, rows.T, strict=True))
            elif element.name == "face":
                self._read_faces(element, own, begins[first : first + element.size].tolist())
            first += element.size

    def _read_faces(self, element: _Element, lines: list[bytes], begins: list[int]) -> None:
        if element.properties[0][0] != self._list:
            raise ValueError("a face does not begin with its vertices")
        for name, kind in element.properties[1:]:
            if " " in kind:
                raise ValueError(f"a list of {name}")
        spans, indices, others = [], [], []
        for begin, line in zip(begins, lines, strict=True):
            found = list(re.finditer(rb"\S+", line))
            if int(found[0][0]) != 3:
                raise ValueError("it has faces that are no triangles")
            spans.append([(begin + each.start(), begin + each.end()) for each in found[1:4]])
            indices.append([int(each[0]) for each in found[1:4]])
            others.append([float(each[0]) for each in found[4:]])
        self._spans = np.array(spans, dtype=np.int64)
        self._indices = np.array(indices, dtype=np.int64)
        self._others = {str(n): column for n, column in enumerate(np.array(others).T)}

    def groups(self) -> Iterator[list[Part]]:
        """Yield all parts together: triangles whose own properties are the same."""
        given = self._vertices
        positions = np.column_stack([given[axis] for axis in "xyz"]).astype(np.float64)
        affine, fixed = [np.empty((len(positions), 0))], [np.empty((len(positions), 0))]
        used = np.unique(self._indices)
        for name, values in given.items():
            column = values.astype(np.float64)[:, None]
            least = _LEAST.get(name)
            if name in "xyz":
                continue
            if least is None:
                fixed.append(column)
            else:
                affine.append(column / max(least, tolerance_of(column[used])))
        if self._spans is not None:
            tolerance = text_tolerance(positions[used], self._step)
        elif any(given[axis].dtype.itemsize > 4 for axis in "xyz"):
            tolerance = tolerance_of(centred(positions[used]))
        else:
            tolerance = tolerance_of(positions[used])
        columns = [np.zeros(len(self._indices)), *self._others.values()]
        owner = np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].reshape(-1)
        whole = Mesh(positions, self._indices, np.hstack(affine), np.hstack(fixed), tolerance)
        note = "" if "nx" in given else _UNSHADED
        yield [
            Part(
                whole.with_triangles(self._indices[owner == value]),
                np.flatnonzero(owner == value),
                note=note,
            )
            for value in range(int(owner.max()) + 1)
        ]

    def replace(self, part: Part, triangles: NDArray[np.int64]) -> None:
        """Give a part other triangles (m, 3)."""
        if self._spans is not None:
            words = [b"%d" % number for number in range(len(part.mesh.positions))]
            self._text.replace(self._spans[part.source], part.mesh.triangles, triangles, words)
        else:
            self._rows[self._list][part.source] = triangles

    def write(self, out: Path) -> list[Path]:
        """Write the model; returns the files."""
        if self._spans is not None:
            return self._text.write(out)
        data, rows = self._text.data, self._rows.tobytes()
        return write_bytes(out, data[: self._place] + rows + data[self._place + len(rows) :])
