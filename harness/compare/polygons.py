"""Polygons whose cost grew most between two runs, with heatmaps."""

import base64
import io
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from harness.compare.matching import Match, match
from harness.compare.model import Comparison
from harness.frame import Frame, frame_of_grid
from harness.grid import SUBPIXEL
from harness.results import drawings
from harness.results.record import Record
from harness.results.run_folder import Run, read_arrays, select_latest
from harness.settings import COST_COUNTERS

MOST = 3
"""Polygons that are shown, of all cases that regressed."""

QUAD = 2 * SUBPIXEL
"""A polygon that is moved by whole quads shades the same."""


@dataclass(frozen=True)
class Grown:
    """A polygon of a case that costs more in HEAD.

    case : the case, for people; metric : what is counted, in BASE and in HEAD
    polygon : its number in the scene
    frame : one of this polygon alone; triangles : (m, 3) of its vertices in BASE and in HEAD
    """

    case: str
    metric: str
    base: int
    head: int
    polygon: int
    frame: Frame
    triangles: dict[str, NDArray[np.int32]]

    def picture(self) -> str:
        """Return heatmaps of BASE and HEAD side by side, as the address of an image."""
        from harness.heatmaps import draw_heatmaps

        content = io.BytesIO()
        draw_heatmaps(self.frame, self.triangles, content)
        return f"data:image/png;base64,{base64.b64encode(content.getvalue()).decode()}"


def most_grown(base: Run, head: Run, comparison: Comparison) -> list[Grown]:
    """Return the polygons that grew most in the cases that regressed, the worst first.

    Only where both runs kept what they counted of each polygon, and what they drew.
    """
    names = {case.id for case in comparison.regressed() if case.status == "compared"}
    base, head = select_latest(base), select_latest(head)
    matches = match(base, head, across_devices=comparison.settings.across_devices)
    candidates = [
        (found, *each)
        for found in matches
        if found.id in names
        for each in _growth(base, head, found)
    ]
    candidates.sort(key=lambda each: each[3] - each[4])
    made = (_grown(base, head, *each) for each in candidates[:MOST])
    return [each for each in made if each is not None]


def _growth(base: Run, head: Run, found: Match) -> Iterator[tuple[str, int, int, int]]:
    """Yield the largest growths of a case's polygons: of what, at which place, from and to."""
    if found.base is None or found.head is None:
        return
    before, after = _counted(base, found.base), _counted(head, found.head)
    for metric in COST_COUNTERS:
        if metric in before and metric in after and len(before[metric]) == len(after[metric]):
            both = np.stack([before[metric], after[metric]], axis=1)
            for place in np.argsort(both[:, 0] - both[:, 1], kind="stable")[:MOST].tolist():
                old, new = both[place].tolist()
                if new > old:
                    yield metric, place, old, new
            return


def _counted(run: Run, record: Record) -> dict[str, NDArray[np.int64]]:
    """Return what was counted of each polygon, (p,) each; one polygon's are the totals."""
    columns = read_arrays(run, record.key)
    if columns is None and record.polygons == 1:
        columns = {name: np.array([value]) for name, value in record.counters.items()}
    return {
        name: column.astype(np.int64)
        for name, column in (columns or {}).items()
        if name in COST_COUNTERS and column.ndim == 1 and np.issubdtype(column.dtype, np.number)
    }


def _grown(
    base: Run, head: Run, found: Match, metric: str, place: int, old: int, new: int
) -> Grown | None:
    triangles, alone = {}, None
    for side, run, record in (("BASE", base, found.base), ("HEAD", head, found.head)):
        assert record is not None  # only matched cases grow
        geometry = drawings.read(run, record.id.view)
        rows = None if geometry is None else geometry.triangles.get(record.name)
        if geometry is None or rows is None or place >= len(geometry.source):
            return None
        first, last = geometry.grid.vertex_offsets[place : place + 2].tolist()
        own = rows[(rows >= first).all(axis=1) & (rows < last).all(axis=1)] - np.int32(first)
        grid = geometry.grid.take([place])
        points = grid.coords - grid.coords.min(axis=0) // QUAD * QUAD
        side_px = int(points.max()) // SUBPIXEL + 4  # with a margin
        alone = replace(
            frame_of_grid(side_px, replace(grid, coords=points.astype(np.int32))),
            source=geometry.source[place : place + 1],
        )
        triangles[f"{side}: {record.name}"] = own.astype(np.int32)
    assert alone is not None
    return Grown(str(found.id), metric, old, new, int(alone.source[0]), alone, triangles)
