"""Runs batches on a device, and leaves to the CPU what a device that fails has not done.

An OpenGL context belongs to the thread that made it current. One thread of this module owns all
devices, so whoever else draws with OpenGL in this process is not disturbed, and batches may come
from any thread; they are done one after the other.
"""

import logging
import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from triangulators.gpu.device_context import (
    MAX_GROUPS,
    Compute,
    DeviceFailed,
    Storage,
    open_context,
)
from triangulators.gpu.rings import KINDS, MOST, ON_CPU, SIZES, Rings, place, prepare
from triangulators.optimum.many_rings import Batch

NONE = (1 << 30) - 1
"""Cost of a ring that has no triangulation, as shaders have it."""

LANES = 32
"""Of a workgroup; twice as many for rings of more than 32 corners."""

CHUNK = 1 << 18
"""Corners that are on the device at a time: 2 MiB go there and 1 MiB comes back."""

_LOG = logging.getLogger(__name__)


class Task(NamedTuple):
    """Rings that are wanted of the p polygons of a batch.

    wanted (p,); most: up to so many corners; worst: whether the longest diagonals are looked for.
    """

    batch: Batch
    wanted: np.ndarray
    most: int
    worst: bool


_said: set[str] = set()


def attempt(name: str, task: Task) -> None:
    """Do what the device can, and mark it in `task.batch.done`; what is not done is for the CPU.

    One line is logged where that is a failure.
    """
    try:
        wrong = _owner().submit(_run, name, task).result()
    except Exception as error:  # drivers and their bindings raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        _say(f"{name} failed, and the CPU does the rest: {reason}")
        return
    if wrong:
        _say(f"{name}: {wrong:,} results are wrong, and the CPU does them")


def _say(line: str) -> None:
    """Log a line as a warning, once: a file's polygons come in many batches."""
    if line not in _said:
        _said.add(line)
        _LOG.warning(line)


def describe(name: str) -> tuple[str, str]:
    """Open a device, if it is not yet; return its driver's names of renderer and version.

    Raises `device_context.DeviceFailed`.
    """
    compute = _owner().submit(_opened, name).result().compute
    return compute.renderer, compute.version


def close_all() -> None:
    """Close all devices and forget what was said of them; the next batch opens its own anew."""
    _owner().submit(_close_all).result()
    _said.clear()


@cache
def _owner() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, thread_name_prefix="triangulators-gpu")


_open: dict[str, "Engine"] = {}  # touched by that thread alone
_drivers: set[int] = set()
"""Processes that have loaded a driver, this one or those that it was forked from."""


def _opened(name: str) -> "Engine":
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


def _close_all() -> None:
    while _open:
        _open.popitem()[1].compute.close()


def _run(name: str, task: Task) -> int:
    """Do a batch; return how many results were no triangulations of the cost they came with.

    A device that raises is closed: after a lost context nothing that it held can be used.
    """
    engine = _opened(name)
    try:
        return engine.do(task)
    except BaseException:
        del _open[name]
        try:
            engine.compute.close()
        except Exception:  # it is lost anyway
            _LOG.debug("%s cannot even be closed", name, exc_info=True)
        raise


class Engine:
    """An open device with its programs and buffers, for the thread that owns it."""

    def __init__(self, name: str) -> None:
        self.compute: Compute = open_context(name)
        self._corners, self._jobs, self._bases = (Storage(self.compute, n) for n in range(3))

    def do(self, task: Task) -> int:
        """Do a batch, chunk after chunk; return how many results were wrong."""
        batch, rings = task.batch, Rings.of(task.batch.begins)
        prepare(batch.coordinates, task.wanted, min(task.most, MOST), rings)
        bases = np.zeros(len(rings.corners), dtype=np.uint32)
        wrong = 0
        for first, last in pairwise(chunk_bounds(batch.begins)):
            which = first + np.flatnonzero(rings.kind[first:last] != ON_CPU)
            if len(which):
                self._compute_chunk(rings, first, last, task.worst, bases)
                place(which, bases, task.worst, rings, batch)
                found = bases[rings.begins[which]] != NONE
                wrong += int(np.count_nonzero(found & ~batch.done[which]))
        return wrong

    def _compute_chunk(
        self, rings: Rings, first: int, last: int, worst: bool, bases: np.ndarray
    ) -> None:
        """Fill the part of bases (n,) of polygons first..last - 1, a workgroup a ring."""
        own = slice(rings.begins[first], rings.begins[last])
        self._corners.write(rings.corners[own])
        self._bases.reserve(bases[own].nbytes)
        for kind in range(KINDS):
            jobs = jobs_of(rings, first, last, kind)
            if len(jobs):
                self._jobs.write(jobs)
                for buffer in (self._corners, self._jobs, self._bases):
                    buffer.bind()
                most = SIZES[kind // 2]
                wide = {"WIDE": 1} if kind % 2 else {}
                constants = {"MOST": most, "LANES": max(LANES, most), **wide}
                program = self.compute.program("exact.glsl", "small.glsl", **constants)
                program["number"], program["worst"] = len(jobs), int(worst)
                columns = min(len(jobs), MAX_GROUPS)
                self.compute.run(program, columns, -(-len(jobs) // columns))
        self.compute.check("computing rings")
        self._bases.read_into(bases[own])
        self.compute.check("reading rings")


def jobs_of(rings: Rings, first: int, last: int, kind: int) -> np.ndarray:
    """Return (k, 4) int32: first corner in the chunk, corners, w + h and 0 of rings of a kind."""
    which = first + np.flatnonzero(rings.kind[first:last] == kind)
    begin = rings.begins[which]
    jobs = np.zeros((len(which), 4), dtype=np.int32)
    jobs[:, 0] = begin - rings.begins[first]
    jobs[:, 1] = rings.begins[which + 1] - begin
    jobs[:, 2] = rings.longest[which]
    return jobs


def chunk_bounds(begins: np.ndarray, corners: int = CHUNK) -> list[int]:
    """Return where to cut polygons into chunks of about `corners` corners, one polygon at least."""
    marks = np.arange(0, int(begins[-1]), corners)
    cuts = np.searchsorted(begins, marks, side="left")
    return [int(cut) for cut in np.unique(np.r_[cuts, len(begins) - 1])]
