"""NumPy's .npz: plain arrays, for programs."""

from __future__ import annotations

import zipfile
from typing import IO, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from harness.export.indexed_mesh import Mesh
from harness.export.writer import About, append
from harness.stored.output import Output


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
