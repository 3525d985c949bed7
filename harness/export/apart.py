"""Triangulates a batch; a user's triangulator does it in a process of its own, and is verified.

What crashes there, or is no triangulation, costs its polygon, and neither the others nor the
command.
"""

from __future__ import annotations

import atexit
import multiprocessing
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

import triangulators
from harness.measuring.serving import TaskFailed
from harness.triangulating import recipes
from harness.triangulating.result import check_triangles
from triangulators import parse
from triangulators.batch import Triangulations
from triangulators.polygon_arrays import PolygonArray, offsets_of
from triangulators.verify import find_unconfirmed

if TYPE_CHECKING:
    from harness.measuring.worker import Worker

CRASHES = 10
"""Polygons that are found to crash it one by one; then a part that crashes fails as a whole."""

_workers: dict[str, Worker] = {}


def triangulate_many(
    polygons: Sequence[Polygon] | NDArray[Any] | PolygonArray, name: str, **more: Any
) -> Triangulations:
    """Return what `triangulators.triangulate_many` returns, verified; `more` are its parameters.

    `failed` are, too, polygons whose triangles are not a triangulation, and those on which a user's
    triangulator ends its process.

    Raises
    ------
    UsageError
        if a user's triangulator is not there, or cannot be imported
    TaskFailed
        if importing it ends the process
    """
    arrays = polygons if isinstance(polygons, PolygonArray) else PolygonArray.from_shapely(polygons)
    if parse(name).entry.builtin or multiprocessing.parent_process() is not None:
        return _verified(arrays, triangulators.triangulate_many(polygons, name, **more))
    worker = _worker(name)
    worker.call(recipes.parse(name).load)
    task = partial(triangulators.triangulate_many, **more)
    pieces: list[NDArray[np.int32]] = []
    failed: dict[int, str] = {}
    # What is left to do, the next last: a part that crashes is cut in two, down to one polygon.
    parts = [(0, len(polygons))]
    crashes = 0
    while parts:
        first, last = parts.pop()
        given = arrays[first:last]
        try:
            done = worker.call(task, given, name)
        except TaskFailed as error:
            if last - first > 1 and crashes < CRASHES:
                middle = (first + last) // 2
                parts += [(middle, last), (first, middle)]
                continue
            crashes += 1
            many = f"; after {CRASHES} crashes, polygons near another fail with it"
            reason = str(error) + many * (last - first > 1)
            done = Triangulations(
                np.empty((0, 3), np.int32),
                np.zeros(last - first + 1, np.int64),
                dict.fromkeys(range(last - first), reason),
            )
        pieces += list(done)
        failed |= {first + number: reason for number, reason in done.failed.items()}
    return _verified(arrays, _stacked(pieces, failed, np.zeros(len(pieces), np.bool_)))


def _stacked(
    pieces: list[NDArray[np.int32]], failed: dict[int, str], compiled: NDArray[np.bool_]
) -> Triangulations:
    triangles = np.concatenate([np.empty((0, 3), np.int32), *pieces])
    return Triangulations(triangles, offsets_of([len(each) for each in pieces]), failed, compiled)


def _verified(polygons: PolygonArray, done: Triangulations) -> Triangulations:
    """Return the triangulations, without triangles that are not a triangulation: those failed."""
    pieces = list(done)
    known = {number: piece for number, piece in enumerate(pieces) if number not in done.failed}
    failed = {}
    for number in find_unconfirmed(polygons, known):
        _, problem = check_triangles(polygons[number], pieces[number])
        if problem:
            failed[number] = problem
            pieces[number] = np.empty((0, 3), np.int32)
    return _stacked(pieces, {**done.failed, **failed}, done.compiled) if failed else done


def _worker(name: str) -> Worker:
    """Return the process of a user's triangulator, which is kept until this one ends."""
    if name not in _workers:
        # Imported where it is needed: most commands need no process of their own.
        from harness.measuring.processes import foreign_limits
        from harness.measuring.worker import Worker

        _workers[name] = Worker(f"triangulator {name}", limits=foreign_limits())
        atexit.register(_workers[name].close, at_once=True)
    return _workers[name]
