"""What was drawn, kept beside the counters, so that a report can show where it cost."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, View
from harness.results.run_folder import Run, Store, read_arrays
from triangulators.polygon_arrays import PolygonArray

FOLDER = "frames"

_TRIANGLES = "triangles "

_COLUMNS = ("points", "offsets", "source", "ring_ends")
"""Arrays of a file: see docs/reference/files.md."""


@dataclass(frozen=True)
class Geometry:
    """A frame's polygons and what the triangulators made of them, as read back.

    grid : the p polygons, int32 coordinates in 1/256 px, y up
    source : (p,) int64, for each polygon its number in the scene
    triangles : triangulator -> (m, 3) int32 rows of `points`, polygon by polygon
    """

    grid: PolygonArray
    source: NDArray[np.int64]
    triangles: dict[str, NDArray[np.int32]]

    @property
    def points(self) -> NDArray[np.int32]:
        """(n, 2) int32, all polygons' vertices one after another."""
        return self.grid.coords


def write(store: Store, frame: Frame, triangles: Mapping[str, NDArray[np.int32]]) -> None:
    """Keep the frame and each triangulator's (m, 3) rows of `frame.points` in the run folder.

    Triangulations that the run kept before, of the same frame, stay.
    """
    before = read(Run(store.path, {}, []), frame.view)
    if before is not None and np.array_equal(before.points, frame.points):
        triangles = {**before.triangles, **triangles}
    arrays = (frame.points, frame.grid.vertex_offsets, frame.source, frame.grid.ring_offsets[1:])
    columns: dict[str, NDArray[Any]] = dict(zip(_COLUMNS, arrays, strict=True))
    named = {_TRIANGLES + name: rows for name, rows in triangles.items()}
    store.write_arrays(name_of(frame.view), columns | named, FOLDER)


def read(run: Run, view: View) -> Geometry | None:
    """Return what was drawn in `view`, or None where the run did not keep it."""
    arrays = read_arrays(run, name_of(view), FOLDER)
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


def name_of(view: View) -> str:
    """Return the name of a view's file: 1024px-30deg-box."""
    return f"{view.resolution}px-{view.rotation:g}deg-{view.fit}"
