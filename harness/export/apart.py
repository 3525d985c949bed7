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
from harness.triangulating.frames import check
from triangulators import parse
from triangulators.ragged import Ragged, Triangulations, doubtful, polygon_at, ragged

if TYPE_CHECKING:
    from harness.measuring.worker import Worker

CRASHES = 10
"""Polygons that are found to crash it one by one; then a part that crashes fails as a whole."""

_workers: dict[str, Worker] = {}


def triangulate_many(
    polygons: Sequence[Polygon] | NDArray[Any] | Ragged, name: str, **more: Any
) -> Triangulations:
    """Return what `triangulators.triangulate_many` returns; `more` is what else that takes.

    A polygon under which a user's triangulator ends its process is `failed`, and so is one of which
    it gives no triangulation.

    Raises
    ------
    UsageError
        if a user's triangulator is not there, or cannot be imported
    TaskFailed
        if importing it ends the process
    """
    if parse(name).entry.builtin:
        return triangulators.triangulate_many(polygons, name, **more)
    arrays = polygons if isinstance(polygons, Ragged) else ragged(polygons)
    if multiprocessing.parent_process() is not None:
        done = triangulators.triangulate_many(polygons, name, **more)
        return _verified(arrays, list(done), done.failed)
    worker = _worker(name)
    worker.call(recipes.parse(name).load)
    task = partial(triangulators.triangulate_many, **more)
    if isinstance(polygons, Ragged):
        polygons = [polygon_at(polygons, number) for number in range(len(polygons.polygon_ends))]
    pieces: list[NDArray[np.int32]] = []
    failed: dict[int, str] = {}
    # What is left to do, the next last: a part that crashes is cut in two, down to one polygon.
    parts = [(0, len(polygons))]
    crashes = 0
    while parts:
        first, last = parts.pop()
        given = np.asarray(polygons[first:last], dtype=object)
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
    return _verified(arrays, pieces, failed)


def _verified(
    arrays: Ragged, pieces: list[NDArray[np.int32]], failed: dict[int, str]
) -> Triangulations:
    """Return the triangles of all polygons, but for those that are no triangulation of theirs."""
    known = {number: piece for number, piece in enumerate(pieces) if number not in failed}
    for number in doubtful(arrays, known):
        _, problem = check(polygon_at(arrays, number), pieces[number])
        if problem:
            failed = failed | {number: problem}
            pieces[number] = np.empty((0, 3), np.int32)
    starts = np.r_[0, np.cumsum([len(piece) for piece in pieces])].astype(np.int64)
    triangles = np.concatenate([np.empty((0, 3), np.int32), *pieces])
    return Triangulations(triangles, starts, failed, np.zeros(len(pieces), np.bool_))


def _worker(name: str) -> Worker:
    """Return the process of a user's triangulator, which is kept until this one ends."""
    if name not in _workers:
        # Imported where it is needed: most commands need no process of their own.
        from harness.measuring.processes import foreign_limits
        from harness.measuring.worker import Worker

        _workers[name] = Worker(f"triangulator {name}", limits=foreign_limits())
        atexit.register(_workers[name].close, at_once=True)
    return _workers[name]
