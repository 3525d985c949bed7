"""What was drawn, kept beside the counters, so that a report can show where it cost."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, View
from harness.results.run_folder import Record, Run, Store, read_arrays

FOLDER = "frames"

_TRIANGLES = "triangles "

_COLUMNS = ("points", "offsets", "source", "ring_ends")


@dataclass(frozen=True)
class Geometry:
    """A frame's polygons and what the triangulators made of them, as read back.

    points : (n, 2) int32, all polygons' vertices one after another, in 1/256 px, y up
    offsets : (p + 1,) int64; polygon k owns points[offsets[k]:offsets[k + 1]]
    source : (p,) int64, for each polygon its number in the scene
    ring_ends : (r,) int64, where in `points` each ring ends
    triangles : triangulator -> (m, 3) int32 rows of `points`, polygon by polygon
    """

    points: NDArray[np.int32]
    offsets: NDArray[np.int64]
    source: NDArray[np.int64]
    ring_ends: NDArray[np.int64]
    triangles: dict[str, NDArray[np.int32]]


def write(store: Store, frame: Frame, triangles: Mapping[str, NDArray[np.int32]]) -> None:
    """Keep the frame and each triangulator's (m, 3) rows of `frame.points` in the run folder.

    Triangulations that the run kept before, of the same frame, stay.
    """
    before = read(Run(store.path, {}, []), frame.view)
    if before is not None and np.array_equal(before.points, frame.points):
        triangles = {**before.triangles, **triangles}
    columns: dict[str, NDArray[Any]] = {name: getattr(frame, name) for name in _COLUMNS}
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
    return Geometry(**{name: arrays[name] for name in _COLUMNS}, triangles=triangles)


def view_of(record: Record) -> View:
    """Return the view a record was measured in."""
    return View(record["resolution"], record["rotation"], record.get("fit", "box"))


def name_of(view: View) -> str:
    """Return the name of a view's file: 1024px-30deg-box."""
    return f"{view.resolution}px-{view.rotation:g}deg-{view.fit}"
