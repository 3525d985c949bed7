"""Wavefront OBJ: the triangles of its `f` lines, part by part as materials and groups change.

A vertex is a triple of position, texture coordinate and normal.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.models.mesh import Mesh, Part
from harness.models.text_file import TextFile, numbered, text_step, text_tolerance

_WORD = re.compile(rb"\S+")
_NEW_PART = (b"usemtl", b"g", b"o", b"s", b"mtllib")
_LEAST = {b"v": 1e-4, b"vt": 2.0**-18, b"vn": 1e-4}
"""By how much colours, texture coordinates and normals may be off on a flat face, at least."""

Triple = tuple[int, int, int]


class ObjModel:
    """An OBJ file; faces of more than three corners, and lines that go on, stay as they are."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._text = TextFile(path)
        self._lines: dict[bytes, list[list[bytes]]] = {b"v": [], b"vt": [], b"vn": []}
        self._parts: list[tuple[list[list[Triple]], list[list[tuple[int, int]]]]] = [([], [])]
        place = 0
        for number, line in enumerate(self._text.data.splitlines(keepends=True), 1):
            try:
                self._read(line, place)
            except ValueError as error:
                text = line.decode(errors="replace").strip()[:60]
                raise UsageError(f"{path} line {number} is not OBJ: {text!r}") from error
            place += len(line)

    def _read(self, line: bytes, place: int) -> None:
        words = line.split()
        kind = words[0] if words else b""
        if kind in self._lines:
            self._lines[kind].append(words[1:])
        elif kind in _NEW_PART and self._parts[-1][0]:
            self._parts.append(([], []))
        elif kind == b"f" and not line.rstrip().endswith(b"\\"):
            found = [
                (match.start(), match.end()) for match in _WORD.finditer(line.partition(b"#")[0])
            ]
            if len(found) == 4:
                triples, spans = self._parts[-1]
                triples.append([self._triple(line[first:last]) for first, last in found[1:]])
                spans.append([(place + first, place + last) for first, last in found[1:]])

    def _triple(self, word: bytes) -> Triple:
        """Return 1 + the index of position, texture coordinate and normal, 0 for none."""
        result = [0, 0, 0]
        for column, (part, lines) in enumerate(
            zip(word.split(b"/"), self._lines.values(), strict=False)
        ):
            if part:
                given = int(part)
                result[column] = given if given > 0 else len(lines) + 1 + given
                if not 1 <= result[column] <= len(lines):
                    raise ValueError("an index that is of nothing")
        if result[0] == 0:
            raise ValueError("a corner without a position")
        return result[0], result[1], result[2]

    def groups(self) -> Iterator[list[Part]]:
        """Yield all parts together."""
        values = {kind: self._values(kind, lines) for kind, lines in self._lines.items()}
        xyz = values[b"v"][0][:, :3]
        step = text_step(word for line in self._lines[b"v"] for word in line[:3])
        parts = []
        for triples, spans in self._parts:
            if not triples:
                continue
            corners = np.array(triples, dtype=np.int64).reshape(-1, 3)
            first, number = numbered(corners)
            vertices = corners[first]
            positions = xyz[vertices[:, 0] - 1]
            # what has no texture coordinate, or no normal, agrees with nothing that has one
            fixed = (vertices[:, 1:] > 0).astype(np.float64)
            affine = [values[b"v"][0][vertices[:, 0] - 1, 3:] / values[b"v"][1]]
            for column, kind in ((1, b"vt"), (2, b"vn")):
                found, off = values[kind]
                given = np.vstack([np.zeros((1, found.shape[1])), found])
                affine.append(given[vertices[:, column]] / off)
            tolerance = text_tolerance(positions, step)
            mesh = Mesh(positions, number.reshape(-1, 3), np.hstack(affine), fixed, tolerance)
            words = [_word(vertex) for vertex in vertices.tolist()]
            parts.append(Part(mesh, (np.array(spans, dtype=np.int64), words)))
        yield parts

    def _values(self, kind: bytes, lines: list[list[bytes]]) -> tuple[NDArray[np.float64], float]:
        """(n, width) numbers of lines, and by how much they may be off."""
        width = max((len(line) for line in lines), default=0)
        try:
            rows = [[float(word) for word in line] + [0.0] * (width - len(line)) for line in lines]
        except ValueError as error:
            raise UsageError(
                f"{self._path} is not OBJ: {error} in a line of {kind.decode()}"
            ) from error
        if kind == b"v" and lines and min(map(len, lines)) < 3:
            raise UsageError(f"{self._path} is not OBJ: a vertex with fewer than 3 coordinates")
        step = text_step(word for line in lines for word in line)
        return np.array(rows, dtype=np.float64).reshape(len(rows), width), max(
            _LEAST[kind], min(step, 1e-3)
        )

    def replace(self, part: Part, triangles: NDArray[np.int64]) -> None:
        """Give a part other triangles (m, 3)."""
        spans, words = part.source
        self._text.replace(spans, part.mesh.triangles, triangles, words)

    def write(self, out: Path) -> list[Path]:
        """Write the model; returns the files."""
        return self._text.write(out)


def _word(vertex: list[int]) -> bytes:
    """Write a triple: 7, 7/1, 7//3 or 7/1/3."""
    position, texture, normal = (b"%d" % number if number else b"" for number in vertex)
    if normal:
        return b"/".join((position, texture, normal))
    return position + b"/" + texture if texture else position
