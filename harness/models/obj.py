"""Editor of the triangles (`f` lines) of Wavefront OBJ files; all else is unchanged.

A vertex is a triple of position, texture coordinate and normal. Materials and groups delimit parts.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from harness.atomic import Output
from harness.models.flat_faces import Floats, Ints, ModelMesh, ModelPart, compute_float32_tolerance
from scenes.scene import SceneError

_WORD = re.compile(rb"\S+")
_NEW_PART = (  # keywords after which a new part begins
    *(b"usemtl", b"usemap", b"mtllib", b"maplib", b"g", b"mg", b"o", b"s"),
    *(b"lod", b"bevel", b"c_interp", b"d_interp", b"shadow_obj", b"trace_obj"),
)
_MIN_TOLERANCE = {b"v": 1e-4, b"vt": 2.0**-18, b"vn": 1e-4}  # on a flat face; v is for colours

MAX_DECIMAL_STEP = 1e-6  # maximum tolerance from the decimals, relative to the size

Triple = tuple[int, int, int]


@dataclass
class _Part:
    """Triangles of a material and group, and the byte range of each vertex in the text."""

    smooth: bool = False
    triples: list[list[Triple]] = field(default_factory=list)
    spans: list[list[tuple[int, int]]] = field(default_factory=list)


class ObjModel:
    """An OBJ file; polygons with more than three vertices and continued lines are not edited."""

    def __init__(self, path: Path) -> None:
        self.unchanged: Counter[str] = Counter()
        self._data = path.read_bytes()
        self._pieces: list[tuple[int, int, bytes]] = []  # (first, last, new text)
        self._values: dict[bytes, list[list[float]]] = {b"v": [], b"vt": [], b"vn": []}
        self._decimals = {b"xyz": 0, b"v": 0, b"vt": 0, b"vn": 0}  # at most; v with colours
        self._parts = [_Part()]
        self._continued: list[bytes] = []  # tokens of a line that the next line continues
        self._largest = [0, 0, 0]  # largest index of v, vt and vn in a face
        self._smooth: list[int] = []  # positions of smoothly shaded vertices without normals
        offset = 0
        for number, line in enumerate(self._data.splitlines(keepends=True), 1):
            try:
                self._read_line(line, offset)
            except ValueError as error:
                text = line.decode(errors="replace").strip()[:60]
                raise SceneError(f"{path} line {number}: not OBJ ({text!r}); correct it") from error
            offset += len(line)
        for largest, (kind, rows) in zip(self._largest, self._values.items(), strict=True):
            if largest > len(rows):
                raise SceneError(
                    f"{path}: invalid OBJ (a face refers to {kind.decode()} line {largest:,}, but "
                    f"the file has {len(rows):,}); correct the file"
                )

    def _read_line(self, line: bytes, offset: int) -> None:
        """Store a vertex or face, or begin a part; offset : byte at which the line starts."""
        text = line.partition(b"#")[0]
        is_single_line = not self._continued
        tokens, self._continued = self._continued, []
        tokens += text.split()  # in place: copies of a line of a million parts take long
        kind = tokens[0] if tokens else b""
        if kind in (*self._values, b"f") and tokens[-1].endswith(b"\\"):
            tokens += tokens.pop()[:-1].split()
            self._continued = tokens
        elif kind in self._values:
            self._read_values(kind, tokens[1:])
        elif kind in _NEW_PART:
            smooth = self._parts[-1].smooth
            if kind == b"s":
                smooth = tokens[1:2] not in ([], [b"off"], [b"0"])
            self._parts.append(_Part(smooth))
        elif kind == b"f":
            self._read_face(tokens[1:], text if is_single_line else b"", offset)

    def _read_values(self, kind: bytes, tokens: list[bytes]) -> None:
        if kind == b"v" and len(tokens) < 3:
            raise ValueError("a vertex with fewer than 3 coordinates")
        self._values[kind].append([float(token) for token in tokens])
        decimals = [len(token.partition(b".")[2]) for token in tokens]
        self._decimals[kind] = max([self._decimals[kind], *decimals])
        if kind == b"v":
            self._decimals[b"xyz"] = max([self._decimals[b"xyz"], *decimals[:3]])

    def _read_face(self, tokens: list[bytes], text: bytes, offset: int) -> None:
        """Read a face; text : the line at byte `offset`, or b"" if the face has several lines."""
        part = self._parts[-1]
        triples = [self._parse_triple(word) for word in tokens]
        if part.smooth:
            self._smooth += [position for position, _, normal in triples if not normal]
        if len(tokens) == 3 and text:
            spans = [match.span() for match in _WORD.finditer(text)]
            part.triples.append(triples)
            part.spans.append([(offset + first, offset + last) for first, last in spans[1:]])
        else:
            self.unchanged["faces that are not triangles, or on several lines"] += 1

    def _parse_triple(self, word: bytes) -> Triple:
        """Return 1-based indices of position, texture coordinate and normal, or 0 for none."""
        result = [0, 0, 0]
        parts = zip(word.split(b"/"), self._values.values(), strict=False)
        for column, (part, rows) in enumerate(parts):
            if part:
                index = int(part)
                result[column] = index if index > 0 else len(rows) + 1 + index
                if index == 0 or result[column] < 1:
                    raise ValueError("an index out of range")
                self._largest[column] = max(self._largest[column], result[column])
        if result[0] == 0:
            raise ValueError("a vertex without a position")
        return result[0], result[1], result[2]

    def iterate_groups(self) -> Iterator[list[ModelPart]]:
        """Yield all parts as a single group, because parts may share vertices."""
        values = {kind: self._make_array(kind) for kind in self._values}
        xyz = values[b"v"][0][:, :3]
        step = 10.0 ** -self._decimals[b"xyz"]
        uses = np.bincount(self._smooth, minlength=len(xyz) + 1)
        parts = []
        for part in self._parts:
            if not part.triples:
                continue
            corners = np.array(part.triples, dtype=np.int64).reshape(-1, 3)
            vertices, number = np.unique(corners, axis=0, return_inverse=True)
            positions = xyz[vertices[:, 0] - 1]
            # A face must not mix vertices with and without texture coordinates or normals.
            fixed = (vertices[:, 1:] > 0).astype(np.float64)
            affine = [values[b"v"][0][vertices[:, 0] - 1, 3:] / values[b"v"][1]]
            for column, kind in ((1, b"vt"), (2, b"vn")):
                rows, row_tolerance = values[kind]
                rows_from_1 = np.vstack([np.zeros((1, rows.shape[1])), rows])
                affine.append(rows_from_1[vertices[:, column]] / row_tolerance)
            tolerance = _compute_tolerance(positions, step)
            part_uses = np.where(vertices[:, 2], 0, uses[vertices[:, 0]]) if part.smooth else None
            triangles = number.reshape(-1, 3)
            mesh = ModelMesh(positions, triangles, np.hstack(affine), fixed, tolerance, part_uses)
            tokens = [_format_word(vertex) for vertex in vertices.tolist()]
            parts.append(ModelPart(mesh, (np.array(part.spans, dtype=np.int64), tokens)))
        yield parts

    def _make_array(self, kind: bytes) -> tuple[Floats, float]:
        """Return the values (n, width) of a kind, with 0 for missing ones, and their tolerance."""
        width = max(map(len, self._values[kind]), default=0)
        rows = [row + [0.0] * (width - len(row)) for row in self._values[kind]]
        tolerance = max(_MIN_TOLERANCE[kind], min(10.0 ** -self._decimals[kind], 1e-3))
        return np.array(rows, dtype=np.float64).reshape(len(rows), width), tolerance

    def replace_triangles(self, part: ModelPart, triangles: Ints) -> None:
        """Replace the triangles of a part by (m, 3) `triangles`."""
        spans, tokens = part.source
        for row in np.flatnonzero((part.mesh.triangles != triangles).any(axis=1)).tolist():
            for span, vertex in zip(spans[row].tolist(), triangles[row].tolist(), strict=True):
                self._pieces.append((*span, tokens[vertex]))

    def write(self, out: Path) -> list[Path]:
        """Write the model; return the files."""
        parts: list[bytes] = []
        done = 0
        for first, last, word in sorted(self._pieces):
            parts += [self._data[done:first], word]
            done = last
        with Output(out) as output:
            with output.open_published() as file:
                file.write(b"".join([*parts, self._data[done:]]))
            return output.publish()


def _format_word(vertex: list[int]) -> bytes:
    """Format a vertex, [position, texture coordinate, normal], as 7, 7/1, 7//3 or 7/1/3."""
    position, texture, normal = (b"%d" % number if number else b"" for number in vertex)
    if normal:
        return b"/".join((position, texture, normal))
    return position + b"/" + texture if texture else position


def _compute_tolerance(positions: Floats, step: float) -> float:
    """Return the flatness tolerance of positions (n, 3) that were read from decimal text.

    Only distances from the part's centre count: decimal text, unlike single precision, is as exact
    far from 0 as near it.
    """
    finite = positions[np.isfinite(positions).all(axis=1)]
    local = finite - (finite.min(axis=0) / 2 + finite.max(axis=0) / 2) if len(finite) else finite
    largest = float(np.abs(local).max(initial=0.0))
    return max(compute_float32_tolerance(local), min(step, MAX_DECIMAL_STEP * largest))
