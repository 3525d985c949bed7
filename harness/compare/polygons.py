"""Polygons with the largest growth of cost between two runs, with heatmaps."""

import base64
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from harness.compare.matching import Match, match_cases
from harness.compare.model import Comparison
from harness.frame import Frame, make_grid_frame
from harness.grid import SUBPIXEL
from harness.results.record import Record
from harness.results.run_folder import Run, read_arrays, read_geometry, select_latest
from harness.settings import COST_COUNTERS

MAX_GROWN = 3  # maximum number of polygons shown of all regressed cases

QUAD = 2 * SUBPIXEL  # side of a quad in grid steps; translation by quads preserves all counters


@dataclass(frozen=True)
class GrownPolygon:
    """A polygon of a case that costs more in HEAD; `polygon` is the index in the scene.

    frame : frame of this polygon alone
    triangles : (m, 3) vertex indices in BASE and in HEAD
    """

    case: str
    metric: str
    base: int
    head: int
    polygon: int
    frame: Frame
    triangles: dict[str, NDArray[np.int32]]

    def draw_picture(self) -> str:
        """Return heatmaps of BASE and HEAD next to each other, as a data URL."""
        from harness.heatmaps import draw_heatmaps

        picture = draw_heatmaps(self.frame, self.triangles)
        return f"data:image/png;base64,{base64.b64encode(picture).decode()}"


def find_largest_growth(base: Run, head: Run, comparison: Comparison) -> list[GrownPolygon]:
    """Return the regressed cases' polygons with the largest growth, if both runs stored them."""
    names = {case.id for case in comparison.list_regressed_cases() if case.status == "compared"}
    base, head = select_latest(base), select_latest(head)
    matches = match_cases(base, head, across_devices=comparison.settings.across_devices)
    candidates = [
        (match, *growth)
        for match in matches
        if match.id in names
        for growth in _find_growths(base, head, match)
    ]
    candidates.sort(key=lambda candidate: candidate[3] - candidate[4])
    polygons = (_read_polygon(base, head, *candidate) for candidate in candidates[:MAX_GROWN])
    return [polygon for polygon in polygons if polygon is not None]


def _find_growths(base: Run, head: Run, match: Match) -> Iterator[tuple[str, int, int, int]]:
    """Yield (counter, polygon, BASE's value, HEAD's value), the largest growth first."""
    if match.base is None or match.head is None:
        return
    before, after = _read_counters(base, match.base), _read_counters(head, match.head)
    for metric in COST_COUNTERS:
        if metric in before and metric in after and len(before[metric]) == len(after[metric]):
            pairs = np.stack([before[metric], after[metric]], axis=1)
            for index in np.argsort(pairs[:, 0] - pairs[:, 1], kind="stable")[:MAX_GROWN].tolist():
                old, new = pairs[index].tolist()
                if new > old:
                    yield metric, index, old, new
            return


def _read_counters(run: Run, record: Record) -> dict[str, NDArray[np.int64]]:
    """Return the (p,) counters per polygon; for a single polygon these are the totals."""
    columns = read_arrays(run, record.key)
    if columns is None and record.polygons == 1:
        columns = {name: np.array([value]) for name, value in record.counters.items()}
    return {
        name: column.astype(np.int64)
        for name, column in (columns or {}).items()
        if name in COST_COUNTERS and column.ndim == 1 and np.issubdtype(column.dtype, np.number)
    }


def _read_polygon(
    base: Run, head: Run, match: Match, metric: str, index: int, old: int, new: int
) -> GrownPolygon | None:
    """Return a polygon with the triangles of both runs, or None if a run did not store them."""
    triangles, frame = {}, None
    for side, run, record in (("BASE", base, match.base), ("HEAD", head, match.head)):
        assert record is not None  # growth is computed only for cases of both runs
        geometry = read_geometry(run, record.id.view)
        rows = None if geometry is None else geometry.triangles.get(record.name)
        if geometry is None or rows is None or index >= len(geometry.source):
            return None
        first, last = geometry.grid.vertex_offsets[index : index + 2].tolist()
        indices = rows[(rows >= first).all(axis=1) & (rows < last).all(axis=1)] - np.int32(first)
        grid = geometry.grid.take([index])
        points = grid.coords - grid.coords.min(axis=0) // QUAD * QUAD
        side_px = int(points.max()) // SUBPIXEL + 4  # with a margin
        frame = replace(
            make_grid_frame(side_px, replace(grid, coords=points.astype(np.int32))),
            source=geometry.source[index : index + 1],
        )
        triangles[f"{side}: {record.name}"] = indices.astype(np.int32)
    assert frame is not None
    return GrownPolygon(str(match.id), metric, old, new, int(frame.source[0]), frame, triangles)
