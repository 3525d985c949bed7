"""Runs batches on a device, and leaves to the CPU what a device that fails has not done.

An OpenGL context belongs to the thread that made it current. One thread of this module owns all
devices, so whoever else draws with OpenGL in this process is not disturbed, and batches may come
from any thread; they are done one after the other.
"""

import logging
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.resources import files
from itertools import pairwise
from typing import Any

import numpy as np

from triangulators.batch import Batch
from triangulators.devices import LLVMPIPE, matches
from triangulators.gpu.rings import KINDS, MOST, ON_CPU, SIZES, Rings, place, prepare

VERSION = 430
"""Of OpenGL: the first with compute shaders and storage buffers."""

MAX_DEVICES = 32
MAX_GROUPS = 65535
"""Workgroups that every device takes in one dimension of a dispatch."""

NONE = (1 << 30) - 1
"""Cost of a ring that has no triangulation, as shaders have it."""

LANES = 32
"""Of a workgroup; twice as many for rings of more than 32 corners."""

CHUNK = 1 << 18
"""Corners that are on the device at a time: 2 MiB go there and 1 MiB comes back."""

_LOG = logging.getLogger(__name__)


class DeviceError(Exception):
    """A device could not be opened, or gave up; the message says why."""


class Compute:
    """An open context, for the one thread that opened it."""

    def __init__(self, ctx: Any) -> None:
        self.ctx = ctx
        self.renderer = str(ctx.info["GL_RENDERER"])
        self.version = str(ctx.info["GL_VERSION"])
        self._programs: dict[tuple[Any, ...], Any] = {}

    def program(self, *names: str, **constants: int) -> Any:
        """Return the compute shader of some files in shaders/, with macros defined; built once."""
        key = (names, *sorted(constants.items()))
        if key not in self._programs:
            lines = [f"#version {VERSION} core"]
            lines += [f"#define {name} {value}" for name, value in constants.items()]
            source = "\n".join([*lines, *(_shader(name) for name in names)])
            self._programs[key] = self.ctx.compute_shader(source)
        return self._programs[key]

    def run(self, program: Any, columns: int, rows: int = 1) -> None:
        """Start columns x rows workgroups, which see what those before them wrote."""
        program.run(columns, rows)
        self.ctx.memory_barrier()

    def check(self, doing: str) -> None:
        """Raise `DeviceError` if OpenGL has noted an error since the last check."""
        error = self.ctx.error
        if error != "GL_NO_ERROR":
            raise DeviceError(f"OpenGL error {error} while {doing}")

    def close(self) -> None:
        """Free the context and what is in it."""
        self.ctx.release()


class Storage:
    """A storage buffer that grows when more is put into it than it holds."""

    def __init__(self, owner: Compute, binding: int) -> None:
        self._owner, self._binding = owner, binding
        self._buffer = owner.ctx.buffer(reserve=4, dynamic=True)

    def reserve(self, count: int) -> None:
        """Have room for at least `count` bytes; what was in it may be lost."""
        if self._buffer.size < count:
            self._buffer.orphan(count)
            self._owner.check(f"taking {count:,} bytes")

    def write(self, array: np.ndarray) -> None:
        """Upload an array (C-contiguous) to the buffer's beginning."""
        self.reserve(array.nbytes)
        self._buffer.write(array)

    def read_into(self, array: np.ndarray) -> None:
        """Wait for the device and fill `array` (C-contiguous) from the buffer's beginning."""
        self._buffer.read_into(array, size=array.nbytes)

    def bind(self) -> None:
        """Let shaders see it."""
        self._buffer.bind_to_storage_buffer(self._binding)


def open_context(name: str) -> Compute:
    """Open llvmpipe, gpu0, gpu1, ... (see `devices.check_name`) in the calling thread.

    Raises `DeviceError` if there is none of that name, or its driver fails.
    """
    try:
        import moderngl
    except ImportError as error:
        raise DeviceError(f"{name}: {error}") from error
    number = 0 if name == LLVMPIPE else int(name[3:])
    passed, problems = 0, list[str]()
    for backend in _contexts(problems):
        try:
            ctx = moderngl.create_context(context=backend, require=VERSION)
        except Exception as error:  # moderngl raises plain Exception
            problems.append(str(error))
            continue
        compute = Compute(ctx)
        if matches(name, compute.renderer):
            if passed == number:
                return compute
            passed += 1
        compute.close()
    reason = f" ({problems[0]})" if problems else ""
    raise DeviceError(f"there is no {name} with compute shaders here{reason}")


def _contexts(problems: list[str]) -> Iterator[Any]:
    """Yield a bare context on each of EGL's devices; append why one could not be opened."""
    import glcontext

    for index in range(MAX_DEVICES):
        try:
            yield glcontext.get_backend_by_name("egl")(
                mode="standalone",
                glversion=VERSION,
                device_index=index,
                libgl="libGL.so.1",
                libegl="libEGL.so.1",
            )
        except Exception as error:  # glcontext raises plain Exception
            if "but found" in str(error):  # "requested device index 2, but found 2 devices"
                return
            problems.append(str(error))


@cache
def _shader(name: str) -> str:
    return files("triangulators.gpu").joinpath("shaders", name).read_text(encoding="utf-8")


_said: set[str] = set()


def attempt(name: str, batch: Batch, wanted: np.ndarray, most: int, worst: bool) -> None:
    """Do what the device can, and mark it in `batch.done`; what is not done is for the CPU.

    wanted (p,): the rings to do, of up to `most` corners; worst: whether the longest diagonals are
    looked for. One line is logged where a device fails.
    """
    try:
        wrong = _owner().submit(_run, name, batch, wanted, most, worst).result()
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

    Raises `DeviceError`.
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
        raise DeviceError("its driver was loaded before this process was forked")
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


def _run(name: str, *task: Any) -> int:
    """Do a batch; return how many results were no triangulations of the cost they came with.

    A device that raises is closed: after a lost context nothing that it held can be used.
    """
    engine = _opened(name)
    try:
        return engine.do(*task)
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

    def do(self, batch: Batch, wanted: np.ndarray, most: int, worst: bool) -> int:
        """Do a batch, chunk after chunk; return how many results were wrong."""
        rings = Rings.of(batch.vertex_offsets)
        prepare(batch.coords, wanted, min(most, MOST), rings)
        bases = np.zeros(len(rings.corners), dtype=np.uint32)
        wrong = 0
        for first, last in pairwise(chunk_bounds(batch.vertex_offsets)):
            which = first + np.flatnonzero(rings.kind[first:last] != ON_CPU)
            if len(which):
                self._compute_chunk(rings, first, last, worst, bases)
                place(which, bases, worst, rings, batch)
                found = bases[rings.vertex_offsets[which]] != NONE
                wrong += int(np.count_nonzero(found & ~batch.done[which]))
        return wrong

    def _compute_chunk(
        self, rings: Rings, first: int, last: int, worst: bool, bases: np.ndarray
    ) -> None:
        """Fill the part of bases (n,) of polygons first..last - 1, a workgroup a ring."""
        own = slice(rings.vertex_offsets[first], rings.vertex_offsets[last])
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
    begin = rings.vertex_offsets[which]
    jobs = np.zeros((len(which), 4), dtype=np.int32)
    jobs[:, 0] = begin - rings.vertex_offsets[first]
    jobs[:, 1] = rings.vertex_offsets[which + 1] - begin
    jobs[:, 2] = rings.longest[which]
    return jobs


def chunk_bounds(vertex_offsets: np.ndarray, corners: int = CHUNK) -> list[int]:
    """Return where to cut polygons into chunks of about `corners` corners, one polygon at least."""
    marks = np.arange(0, int(vertex_offsets[-1]), corners)
    cuts = np.searchsorted(vertex_offsets, marks, side="left")
    return [int(cut) for cut in np.unique(np.r_[cuts, len(vertex_offsets) - 1])]
