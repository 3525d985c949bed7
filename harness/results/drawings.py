"""Frames and triangulations stored in a run folder, for heatmaps and measuring pages."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, View
from harness.results.run_folder import Run, read_arrays
from harness.results.run_writer import RunFolder
from triangulators.polygon_arrays import PolygonArray

FOLDER = "frames"
_TRIANGLES = "triangles "
_COLUMNS = ("points", "offsets", "source", "ring_ends")  # docs/reference/files.md


@dataclass(frozen=True)
class Geometry:
    """A frame's polygons and their triangulations."""

    grid: PolygonArray  # int32 coordinates in 1/256 px, y up
    source: NDArray[np.int64]  # (p,) numbers of the polygons in the scene
    triangles: dict[str, NDArray[np.int32]]  # triangulator -> (m, 3) rows of `points`, by polygon

    @property
    def points(self) -> NDArray[np.int32]:
        """Vertices of all polygons, (n, 2) int32."""
        return self.grid.coords


def write(writer: RunFolder, frame: Frame, triangles: Mapping[str, NDArray[np.int32]]) -> None:
    """Store a frame and triangulations (m, 3) by name; others of the same frame are retained."""
    stored = read(Run(writer.path, {}, []), frame.view)
    if stored is not None and np.array_equal(stored.points, frame.points):
        triangles = {**stored.triangles, **triangles}
    arrays = (frame.points, frame.grid.vertex_offsets, frame.source, frame.grid.ring_offsets[1:])
    columns: dict[str, NDArray[Any]] = dict(zip(_COLUMNS, arrays, strict=True))
    named = {_TRIANGLES + name: rows for name, rows in triangles.items()}
    writer.write_arrays(get_view_file_stem(frame.view), columns | named, FOLDER)


def read(run: Run, view: View) -> Geometry | None:
    """Return the polygons of a view and their triangulations.

    Parameters
    ----------
    run : Run
        A run read from a folder.
    view : View
        A view of the run's plan.

    Returns
    -------
    Geometry or None
        None if the geometry is not stored, or damaged.
    """
    arrays = read_arrays(run, get_view_file_stem(view), FOLDER)
    if arrays is None or not {*_COLUMNS} <= set(arrays):
        return None
    triangles = {
        name.removeprefix(_TRIANGLES): rows
        for name, rows in arrays.items()
        if name.startswith(_TRIANGLES)
    }
    points, offsets, source, ring_ends = (arrays[name] for name in _COLUMNS)
    ring_offsets = np.append(0, ring_ends).astype(np.int64)
    grid = PolygonArray(points, ring_offsets, np.searchsorted(ring_offsets, offsets))
    return Geometry(grid, source, triangles)


def get_view_file_stem(view: View) -> str:
    """Return the file name of a view, without suffix: 1024px-30deg-box."""
    return f"{view.resolution}px-{view.rotation:g}deg-{view.fit}"
