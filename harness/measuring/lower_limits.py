"""Lower bounds of the quads that a triangulation of a polygon shades, for a frame's polygons.

Two bounds are computed exactly: the quads that the undivided polygon covers, and the minimum of
quads over all triangulations, which is slightly higher. A triangulation's excess over the first
bound is the cost of its diagonals; its excess over the second could be saved by other diagonals.
"""

from collections.abc import Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.measuring.pool import MeasuringPool
from harness.metrics.registry import MIN_QUADS, OUTLINE
from harness.rasterisers.reference import count_outline_quads, count_quads
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons, warm_up
from harness.workers.pool import wait_for_result
from harness.workers.worker import TaskError

EXACT_QUADS = parse("optimal:exact-quads")

MAX_SEARCH_S = 2.0
"""Time budget per frame for minimum quad counts: maximum sum of `estimate_search_seconds`."""

ROW_S = 6e-9
"""Seconds to count the quads of a triangle, per row of pixels (measured: 2 to 6 ns). The dynamic
program over n vertices counts n^3 / 6 triangles, on average half as high as the polygon."""

HOLES_S = 2e-7
"""Seconds to solve a polygon with holes by a linear program, divided by the cube of the vertex
count (measured: 10 to 450 ns; the largest polygons have the largest quotients)."""

Pending = dict[str, Future[NDArray[np.int64]]]
"""Results that another process is computing: name of the bound -> quads of each polygon, (p,)."""


def start_bounds(
    frame: Frame, parts: Sequence[NDArray[np.int32] | None], pool: MeasuringPool
) -> Pending:
    """Start computing lower bounds of each polygon's quads in the pool's second process.

    parts : for each polygon any triangulation (m, 3) that uses every vertex, or None

    Returns futures by name: `OUTLINE`, and `MIN_QUADS`, the minimum over all triangulations.
    """
    outline = pool.compute_in_second_process(compute_outline_bounds, frame, parts)
    return {
        OUTLINE: outline,
        MIN_QUADS: pool.compute_in_second_process(compute_min_quads, frame, pool.database),
    }


def collect_bounds(pending: Pending) -> dict[str, NDArray[np.int64]]:
    """Wait for lower bounds; return name -> quads of each polygon, (p,), -1 if unknown.

    A bound that fails to compute is omitted.
    """
    bounds = {}
    for name, future in pending.items():
        with suppress(TaskError):  # measurements do not depend on the bounds
            bounds[name] = wait_for_result(future)
    return bounds


def compute_outline_bounds(
    frame: Frame, parts: Sequence[NDArray[np.int32] | None]
) -> NDArray[np.int64]:
    """Return the quads that each polygon's outline covers, (p,), or -1 if unknown.

    A model's triangles outside its polygons (`is_loose`) have no outline, so their bound is the
    quads that they shade. With a depth test all are -1, because hidden quads are not shaded.
    """
    if frame.viewing is None:
        return count_outline_quads(frame, parts)
    if frame.viewing.depths is not None:
        return np.full(len(parts), -1)
    is_loose = frame.viewing.source == len(frame.viewing.polygon_triangles)
    return np.where(is_loose, count_quads(frame, parts), count_outline_quads(frame, parts))


def estimate_search_seconds(frame: Frame) -> NDArray[np.float64]:
    """Return the estimated seconds to find the minimum quad count of each polygon, (p,).

    The estimate is infinite for polygons that a tile's edge cuts, as these are not solved.
    """
    cubes = frame.grid.vertex_counts.astype(np.float64) ** 3
    low, high = frame.polygons.bounds()
    simple = cubes / 6 * (1 + (high - low)[:, 1] / 2) * ROW_S
    holes = frame.grid.ring_counts > 1
    seconds: NDArray[np.float64] = np.where(holes, np.maximum(simple, cubes * HOLES_S), simple)
    if frame.scissor is None:
        return seconds
    # A triangulation with minimum quads for a polygon need not be minimal for its visible part.
    x, y, width, height = frame.scissor
    inside = (low >= (x, y)) & (high <= (x + width, y + height))
    return np.where(inside.all(axis=1), seconds, np.inf)


def compute_min_quads(frame: Frame, database: Path | None) -> NDArray[np.int64]:
    """Return the proven minimum quads of each polygon, (p,), -1 if unknown; loads compiled code.

    Polygons are solved in order of the estimated time, up to `MAX_SEARCH_S`. Views of a model are
    not solved: a face seen at an angle is not a valid polygon on the grid.
    """
    unknown = np.full(len(frame.polygons), -1)
    if frame.viewing is not None:
        return unknown
    seconds = estimate_search_seconds(frame)
    order = np.argsort(seconds, kind="stable")
    solvable = np.sort(order[np.cumsum(seconds[order]) <= MAX_SEARCH_S])
    if not len(solvable):
        return unknown
    warm_up(EXACT_QUADS)
    result = triangulate_polygons(EXACT_QUADS, frame.polygons.take(solvable), database)
    parts: list[NDArray[np.int32] | None] = [None] * len(unknown)
    gaps = iter(result.gaps)
    for index, part in zip(solvable.tolist(), result.parts, strict=True):
        if part is not None and next(gaps) == 0.0:
            parts[index] = part
    return np.where([part is not None for part in parts], count_quads(frame, parts), unknown)
