"""Runs batches on a device, and leaves to the CPU what a device that fails has not done.

An OpenGL context belongs to the thread that made it current. One thread of this module owns all
devices, so whoever else draws with OpenGL in this process is not disturbed, and batches may come
from any thread; they are done one after the other.

Transfers and computing overlap: while a chunk is computed, the next one is prepared by other
threads and sent, and the one before is taken down and placed. How far a driver does that at the
same time is its own matter; llvmpipe, which computes when it is told to, does not.
"""

import logging
import os
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from triangulators.gpu.device_context import Compute, DeviceFailed, open_context
from triangulators.gpu.found_triangles import place
from triangulators.gpu.large import LargeRings, large
from triangulators.gpu.rings import LARGE, MOST, ON_CPU, Rings, prepare
from triangulators.gpu.small import CHUNK, SmallRings
from triangulators.optimum.many_rings import Batch

NONE = (1 << 30) - 1
"""Cost of a ring that has no triangulation, as shaders have it."""

_LOG = logging.getLogger(__name__)


class Task(NamedTuple):
    """Rings that are wanted of the p polygons of a batch.

    wanted (p,); most: up to so many corners; worst: whether the longest diagonals are looked for.
    """

    batch: Batch
    wanted: np.ndarray
    most: int
    worst: bool


class Engine:
    """An open device with its programs and buffers, for the thread that owns it."""

    def __init__(self, name: str) -> None:
        self.compute: Compute = open_context(name)
        self.small = SmallRings(self.compute)
        self.large = LargeRings(self.compute)


given_up: set[str] = set()
"""Devices that failed since this process began: they are not used any more unless asked for."""

_said: set[str] = set()


def attempt(name: str, task: Task, threads: int) -> None:
    """Do what the device can, and mark it in `task.batch.done`; what is not done is for the CPU.

    One line is logged where that is a failure, or a ring has more than `task.most` corners.
    """
    try:
        doubtful = _owner().submit(_run, name, task, threads).result()
    except Exception as error:  # drivers and their bindings raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        _say(f"{name} failed, and the CPU does the rest: {reason}")
        given_up.add(name)
        return
    if doubtful:
        _say(f"{name}: {doubtful:,} results are wrong, and the CPU does them")
        given_up.add(name)
    too_large = int(np.count_nonzero(task.wanted & (np.diff(task.batch.begins) > task.most)))
    if too_large:
        _say(f"{name}: {too_large:,} polygons have over {task.most:,} vertices; the CPU does them")


def _say(line: str) -> None:
    """Log a line as a warning, once: a file's polygons come in many batches."""
    if line not in _said:
        _said.add(line)
        _LOG.warning(line)


def describe(name: str) -> tuple[str, str]:
    """Open a device, if it is not yet; return its driver's names of renderer and version.

    Raises `context.DeviceFailed`.
    """
    return _owner().submit(_describe, name).result()


def close_all() -> None:
    """Close all devices and forget their failures; the next batch opens its own anew."""
    _owner().submit(_close_all).result()
    given_up.clear()
    _said.clear()


@cache
def _owner() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, thread_name_prefix="triangulators-gpu")


_open: dict[str, Engine] = {}  # touched by that thread alone
_drivers: set[int] = set()
"""Processes that have loaded a driver, this one or those that it was forked from."""


def _opened(name: str) -> Engine:
    if _drivers - {os.getpid()}:
        raise DeviceFailed("its driver was loaded before this process was forked")
    if name not in _open:
        _drivers.add(os.getpid())
        _open[name] = Engine(name)
    return _open[name]


def _after_fork() -> None:
    """Forget the thread, which a forked process has not; nor has it the driver's own threads."""
    _owner.cache_clear()
    _open.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def _describe(name: str) -> tuple[str, str]:
    compute = _opened(name).compute
    return compute.renderer, compute.version


def _close_all() -> None:
    while _open:
        _open.popitem()[1].compute.close()


def _run(name: str, task: Task, threads: int) -> int:
    """Do a batch; return how many results were no triangulations of the cost they came with.

    A device that raises is given up: after a lost context nothing that it held can be used.
    """
    engine = _opened(name)
    try:
        with ThreadPoolExecutor(threads) as pool:
            return _Run(engine, task, pool).do()
    except BaseException:
        del _open[name]
        try:
            engine.compute.close()
        except Exception:  # it is lost anyway
            _LOG.debug("%s cannot even be closed", name, exc_info=True)
        raise


class _Run:
    """One batch on its way."""

    def __init__(self, engine: Engine, task: Task, pool: ThreadPoolExecutor) -> None:
        self.engine, self.task, self.pool = engine, task, pool
        self.rings = Rings.of(task.batch.begins)
        self.bases = np.zeros(len(self.rings.corners), dtype=np.uint32)
        self.placing: list[Future[None]] = []

    def do(self) -> int:
        self._small()
        which = large(self.rings)
        if len(which):
            self.engine.large.run(self.rings, which, self.task.worst, self.bases)
            self._place(which)
        for future in self.placing:
            future.result()
        tried = self.rings.kind != ON_CPU
        cost = self.bases[np.minimum(self.rings.begins[:-1], len(self.bases) - 1)]
        return int(np.count_nonzero(tried & ~self.task.batch.done & (cost != NONE)))

    def _small(self) -> None:
        task, rings = self.task, self.rings
        chunks = list(pairwise(chunk_bounds(task.batch.begins)))
        ready = [self.pool.submit(self._prepare, *chunk) for chunk in chunks]
        turn, before = 0, None
        for chunk, prepared in zip(chunks, ready, strict=True):
            prepared.result()
            if not self.engine.small.start(turn, rings, *chunk, task.worst):
                continue
            if before is not None:
                self._take_down(turn - 1, *before)
            turn, before = turn + 1, chunk
        if before is not None:
            self._take_down(turn - 1, *before)

    def _prepare(self, first: int, last: int) -> None:
        task = self.task
        most = min(task.most, MOST)
        prepare(first, last, task.batch.coordinates, task.wanted, most, self.rings)

    def _take_down(self, turn: int, first: int, last: int) -> None:
        begins, kind = self.rings.begins, self.rings.kind
        self.engine.small.read(turn, self.bases[begins[first] : begins[last]])
        here = (kind[first:last] != ON_CPU) & (kind[first:last] < LARGE)
        self._place(first + np.flatnonzero(here))

    def _place(self, which: np.ndarray) -> None:
        task, rings = self.task, self.rings
        out = (task.batch.starts, task.batch.triangles, task.batch.done)
        for part in np.array_split(which, -(-len(which) // 4096)):
            self.placing.append(self.pool.submit(place, part, self.bases, task.worst, rings, *out))


def chunk_bounds(begins: np.ndarray, corners: int = CHUNK) -> list[int]:
    """Return where to cut polygons into chunks of about `corners` corners, one polygon at least."""
    marks = np.arange(0, int(begins[-1]), corners)
    cuts = np.searchsorted(begins, marks, side="left")
    return [int(cut) for cut in np.unique(np.r_[cuts, len(begins) - 1])]
