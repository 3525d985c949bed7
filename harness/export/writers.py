"""What all writers share, and the formats that need no more than that: OBJ and NumPy's .npz."""

from __future__ import annotations

import shutil
import zipfile
from dataclasses import dataclass
from itertools import pairwise
from typing import IO, Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.export.mesh import Mesh, with_z
from harness.stored.atomic import Output
from scenes.cleaning.projection import Projection


@dataclass(frozen=True)
class About:
    """What a writer may say of the whole: units, origin of the polygons, and how to place them.

    crs : the reference system of the source's coordinates, as pyogrio names it, or None
    projection : the map that the polygons were projected to, if they were
    """

    triangulator: str
    units: str
    credit: str = ""
    crs: str | None = None
    projection: Projection | None = None

    def in_source(self, vertices: NDArray[np.float64]) -> NDArray[np.float64]:
        """Vertices in the source's coordinates, z as it is."""
        if self.projection is None:
            return vertices
        # eleven decimals are a micrometre, and give most sources back the very numbers they had
        degrees = np.round(self.projection.inverse(vertices[:, :2]), 11)
        return np.column_stack([degrees, vertices[:, 2:]])


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


class ObjWriter:
    """Groups are called feature_0, feature_1, ...; attributes go to a CSV file beside.

    Coordinates are the source's own, to the last digit.
    """

    def __init__(self, output: Output, about: About) -> None:
        self._stream = output.file(mode="w")
        self._stream.write(f"# raster-harness, {about.triangulator}, units: {about.units}\n")
        if about.credit:
            self._stream.write(f"# {about.credit}\n")
        self._table = AttributeTable(output)
        self._vertices = 0
        self._features = 0

    def add(self, mesh: Mesh) -> None:
        """Write one more batch."""
        points = with_z(mesh.vertices).tolist()
        self._stream.write("".join([f"v {x!r} {y!r} {z!r}\n" for x, y, z in points]))
        faces = (mesh.triangles + 1 + self._vertices).tolist()
        starts = mesh.triangle_starts.tolist()
        lines = []
        for number, (start, end) in enumerate(pairwise(starts)):
            lines.append(f"g feature_{self._features + number}\n")
            lines += [f"f {a} {b} {c}\n" for a, b, c in faces[start:end]]
        self._stream.write("".join(lines))
        self._table.add(mesh.attributes)
        self._vertices += len(points)
        self._features += mesh.polygons

    def finish(self) -> None:
        """Nothing is left to write."""


class NpzWriter:
    """Arrays, for p polygons, n vertices and m triangles in all:

    vertices (n, 2 or 3) float64; triangles (m, 3) int64, indices into them; vertex_starts and
    triangle_starts (p + 1,) int64, where each polygon's begin; attribute_NAME (p,) for each
    attribute, text unless it is a number or a truth value; triangulator, units, credit.
    """

    def __init__(self, output: Output, about: About) -> None:
        self._output = output
        self._about = about
        self._spools: dict[str, tuple[IO[bytes], np.dtype[Any], tuple[int, ...]]] = {}
        self._lengths: dict[str, int] = {}
        self._tables: list[pd.DataFrame] = []
        self._totals = np.zeros(2, dtype=np.int64)

    def add(self, mesh: Mesh) -> None:
        """Write one more batch."""
        vertices, triangles = self._totals.tolist()
        first = not self._spools
        self._spool("vertices", mesh.vertices)
        self._spool("triangles", mesh.triangles + vertices)
        skip = 0 if first else 1  # a batch begins where the last one ends
        self._spool("vertex_starts", mesh.vertex_starts[skip:] + vertices)
        self._spool("triangle_starts", mesh.triangle_starts[skip:] + triangles)
        self._tables.append(mesh.attributes)
        self._totals += np.array([len(mesh.vertices), len(mesh.triangles)], dtype=np.int64)

    def finish(self) -> None:
        """Pack the spooled arrays."""
        with zipfile.ZipFile(self._output.file(), "w", allowZip64=True) as archive:
            for name, (spool, kind, shape) in self._spools.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    header = {
                        "descr": np.lib.format.dtype_to_descr(kind),
                        "fortran_order": False,
                        "shape": (self._lengths[name], *shape),
                    }
                    np.lib.format.write_array_header_1_0(member, header)
                    append(member, spool)
            for name, array in self._small().items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, array, allow_pickle=False)

    def _spool(self, name: str, array: NDArray[Any]) -> None:
        if name not in self._spools:
            self._spools[name] = (self._output.spool(name), array.dtype, array.shape[1:])
        self._spools[name][0].write(np.ascontiguousarray(array).tobytes())
        self._lengths[name] = self._lengths.get(name, 0) + len(array)

    def _small(self) -> dict[str, NDArray[Any]]:
        about = self._about
        arrays = {"triangulator": np.array(about.triangulator), "units": np.array(about.units)}
        arrays["credit"] = np.array(about.credit)
        if self._tables:
            table = pd.concat(self._tables, ignore_index=True)
            for name in table:
                column = table[name]
                values: NDArray[Any] = column.to_numpy()
                if values.dtype.kind not in "biufM":
                    words = [
                        "" if missing else str(v)
                        for v, missing in zip(column, column.isna(), strict=True)
                    ]
                    values = np.array(words, dtype=np.str_)
                arrays[f"attribute_{name}".replace("/", "_")] = values
        return arrays
