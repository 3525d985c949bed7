"""What no triangulation of a frame's polygons goes below, in quads.

Two limits, both exact: the polygons drawn in one piece, and, a little above it, the triangulation
over their own vertices that shades the fewest. The first tells what diagonals cost; the second
what choosing others could still save.
"""

from collections.abc import Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.measuring.pool import MeasuringPool
from harness.metrics.registry import LEAST, OUTLINE
from harness.rasterisers.reference import count_outline_quads, count_quads
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons, warm_up
from harness.workers.pool import result_of
from harness.workers.worker import TaskError

FEWEST = parse("optimal:exact-quads")

MAX_S = 2.0
"""Seconds on one core, by `seconds_of`, for which the fewest quads are looked for in a frame."""

ROW_S = 6e-9
"""Of one row of pixels of one triangle. A table over n vertices looks at n^3 / 6 triangles, each
about as many rows high as half of the polygon (measured: 2 to 6 ns)."""

HOLES_S = 2e-7
"""Of the cube of a vertex, where there are holes and a linear program proves what is found
(measured: 10 to 450 ns, the most for the largest)."""


Begun = dict[str, Future[NDArray[np.int64]]]
"""By limit, its (p,) quads, which a second process computes meanwhile."""


def begin(frame: Frame, parts: Sequence[NDArray[np.int32] | None], pool: MeasuringPool) -> Begun:
    """Begin to compute both limits; `parts` is a triangulation (m, 3) of each, whichever."""
    outline = pool.compute(limits, frame, parts)
    return {OUTLINE: outline, LEAST: pool.compute(fewest, frame, pool.database)}


def collect(begun: Begun) -> dict[str, NDArray[np.int64]]:
    """Return the limits that are known, -1 for each polygon whose limit is not."""
    found = {}
    for name, future in begun.items():
        with suppress(TaskError):  # what is measured is the same without it
            found[name] = result_of(future)
    return found


def limits(frame: Frame, parts: Sequence[NDArray[np.int32] | None]) -> NDArray[np.int64]:
    """Return the quads that each polygon's outline covers (p,), -1 where that is no limit.

    The rest of a view, which has no outline, has those of its triangles. With a depth test, what is
    hidden is not shaded.
    """
    if frame.viewing is None:
        return count_outline_quads(frame, parts)
    if frame.viewing.depths is not None:
        return np.full(len(parts), -1)
    rest = frame.viewing.source == len(frame.viewing.given)
    return np.where(rest, count_quads(frame, parts), count_outline_quads(frame, parts))


def seconds_of(frame: Frame) -> NDArray[np.float64]:
    """Return about how many seconds it takes to find the fewest quads of each polygon, (p,).

    It is infinite for those that a tile's edge cuts.
    """
    cubes = frame.grid.vertex_counts.astype(np.float64) ** 3
    low, high = frame.polygons.bounds()
    simple = cubes / 6 * (1 + (high - low)[:, 1] / 2) * ROW_S
    holes = frame.grid.ring_counts > 1
    seconds: NDArray[np.float64] = np.where(holes, np.maximum(simple, cubes * HOLES_S), simple)
    if frame.scissor is None:
        return seconds
    # what is fewest before a polygon is cut need not be after
    left, bottom, width, height = frame.scissor
    inside = (low >= (left, bottom)) & (high <= (left + width, bottom + height))
    return np.where(inside.all(axis=1), seconds, np.inf)


def fewest(frame: Frame, database: Path | None) -> NDArray[np.int64]:
    """Return the fewest quads of each polygon, -1 where that is not proven; uses compiled code.

    They are looked for in as many polygons as `MAX_S` allows, the quickest first. In views of a
    model they are not: the grid makes no polygon of a face that is seen aslant.
    """
    least = np.full(len(frame.polygons), -1)
    if frame.viewing is not None:
        return least
    seconds = seconds_of(frame)
    order = np.argsort(seconds, kind="stable")
    chosen = np.sort(order[np.cumsum(seconds[order]) <= MAX_S])
    if not len(chosen):
        return least
    warm_up(FEWEST)
    result = triangulate_polygons(FEWEST, frame.polygons.take(chosen), database)
    parts: list[NDArray[np.int32] | None] = [None] * len(least)
    gaps = iter(result.gaps)
    for place, part in zip(chosen.tolist(), result.parts, strict=True):
        if part is not None and next(gaps) == 0.0:
            parts[place] = part
    return np.where([part is not None for part in parts], count_quads(frame, parts), least)
