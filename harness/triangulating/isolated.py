"""Triangulation of a batch of polygons, with third-party triangulators in a worker process.

If a triangulator crashes or returns an invalid triangulation, only that polygon fails.
"""

from __future__ import annotations

import logging
import multiprocessing
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

import triangulators
from harness.triangulating import recipes
from harness.triangulating.triangulate import check_triangles
from harness.workers.serving import TaskError
from triangulators import parse
from triangulators.polygon_arrays import PolygonArray, Triangulations, offsets_of
from triangulators.verify import find_unconfirmed

_LOG = logging.getLogger(__name__)

MAX_CRASHES = 10  # crashing polygons to single out; further crashing parts fail as a unit


def triangulate_many(
    polygons: Sequence[Polygon] | NDArray[Any] | PolygonArray,
    name: str,
    *,
    conforming: bool = False,
    **more: Any,
) -> Triangulations:
    """Triangulate as `triangulators.triangulate_many` with parameters `more` does, and verify.

    Polygons with invalid triangulations (if `conforming`, also with T-junctions), or on which a
    user's triangulator ends the process, are `failed` as well.

    Raises UsageError, or TaskError if the process ends, when a third-party module is imported.
    """
    arrays = polygons if isinstance(polygons, PolygonArray) else PolygonArray.from_shapely(polygons)
    if parse(name).entry.builtin or multiprocessing.parent_process() is not None:
        return _mark_invalid(
            arrays, triangulators.triangulate_many(polygons, name, **more), conforming
        )
    # Most commands need no worker process, so the modules are loaded here.
    from harness.workers.pool import get_third_party_limits
    from harness.workers.worker import get_shared_worker

    worker = get_shared_worker(f"triangulator {name}", get_third_party_limits)
    worker.call(recipes.parse(name).load)
    task = partial(triangulators.triangulate_many, **more)
    pieces: list[NDArray[np.int32]] = []
    failed: dict[int, str] = {}
    # A stack of slices; a crashing slice is halved, down to one polygon.
    parts = [(0, len(polygons))]
    crashes = 0
    while parts:
        first, last = parts.pop()
        batch = arrays[first:last]
        try:
            done = worker.call(task, batch, name)
        except TaskError as error:
            if last - first > 1 and crashes < MAX_CRASHES:
                _LOG.info("%s: retry in halves: polygons %d to %d", name, first, last - 1)
                middle = (first + last) // 2
                parts += [(middle, last), (first, middle)]
                continue
            crashes += 1
            limit = f"; after {MAX_CRASHES} crashes, a crashing polygon's neighbours fail as well"
            reason = str(error) + limit * (last - first > 1)
            pieces += [np.empty((0, 3), np.int32)] * (last - first)
            failed |= dict.fromkeys(range(first, last), reason)
        else:
            pieces += list(done)
            failed |= {first + number: reason for number, reason in done.failed.items()}
    joined = _join_pieces(pieces, failed, np.zeros(len(pieces), np.bool_))
    return _mark_invalid(arrays, joined, conforming)


def _join_pieces(
    pieces: list[NDArray[np.int32]], failed: dict[int, str], compiled: NDArray[np.bool_]
) -> Triangulations:
    triangles = np.concatenate([np.empty((0, 3), np.int32), *pieces])
    return Triangulations(triangles, offsets_of([len(piece) for piece in pieces]), failed, compiled)


def _mark_invalid(
    polygons: PolygonArray, triangulations: Triangulations, conforming: bool
) -> Triangulations:
    pieces = list(triangulations)
    triangles_by_index = {
        number: piece for number, piece in enumerate(pieces) if number not in triangulations.failed
    }
    failed = {}
    for number in find_unconfirmed(polygons, triangles_by_index):
        junctions, problem = check_triangles(polygons[number], pieces[number])
        if conforming and junctions:
            problem = f"{junctions} T-junction(s): a vertex lies on an edge of a triangle"
        if problem:
            failed[number] = problem
            pieces[number] = np.empty((0, 3), np.int32)
    if not failed:
        return triangulations
    return _join_pieces(pieces, {**triangulations.failed, **failed}, triangulations.compiled)
