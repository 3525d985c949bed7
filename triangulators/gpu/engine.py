"""Solve batches of polygons on a device, by compute shaders, and check the results.

An OpenGL context belongs to the thread that made the context current. So a single thread of this
module uses all devices, and other OpenGL code in the process is not disturbed.
"""

import logging
import os
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from importlib.resources import files
from itertools import pairwise
from typing import Any

import numpy as np

from triangulators.gpu import LLVMPIPE, selects_renderer
from triangulators.gpu.rings import (
    KINDS,
    MAX_VERTICES,
    ON_CPU,
    SIZES,
    Rings,
    prepare_rings,
    read_cost_words,
    store_results,
)
from triangulators.polygon_arrays import Batch

VERSION = 430  # the first version of OpenGL with compute shaders and storage buffers, times 100
MAX_DEVICES = 32  # number of EGL devices that are tried
MAX_GROUPS = 65535  # workgroups in a dimension of a dispatch, supported by every device
NO_RESULT = (1 << 64) - 1  # 64 bits of the cost of a ring without a triangulation
LANES = 32  # minimum invocations of a workgroup; rings of more than 32 vertices have 64
CHUNK_VERTICES = 1 << 18  # vertices in an upload (2 MiB; the result is 1 MiB)

_LOG = logging.getLogger(__name__)


class DeviceError(Exception):
    """A device could not be opened, or failed; the message is the reason."""


class Compute:
    """An open OpenGL context with compiled shaders, for use in the thread that opened it."""

    def __init__(self, ctx: Any) -> None:
        self.ctx = ctx
        self.renderer = str(ctx.info["GL_RENDERER"])
        self._programs: dict[tuple[Any, ...], Any] = {}

    def get_program(self, *names: str, **constants: int) -> Any:
        """Return a compute shader of concatenated files, with macros `constants`; cached."""
        key = (names, *sorted(constants.items()))
        if key not in self._programs:
            lines = [f"#version {VERSION} core"]
            lines += [f"#define {name} {value}" for name, value in constants.items()]
            source = "\n".join([*lines, *(_read_shader(name) for name in names)])
            self._programs[key] = self.ctx.compute_shader(source)
        return self._programs[key]

    def dispatch(self, program: Any, columns: int, rows: int = 1) -> None:
        """Start columns x rows workgroups, and a barrier, so that later dispatches see results."""
        program.run(columns, rows)
        self.ctx.memory_barrier()

    def check_errors(self, doing: str) -> None:
        """Raise `DeviceError` if OpenGL has recorded an error since the last check."""
        error = self.ctx.error
        if error != "GL_NO_ERROR":
            raise DeviceError(f"OpenGL error {error} while {doing}")

    def close(self) -> None:
        """Release the context with all its shaders and buffers."""
        self.ctx.release()


class Storage:
    """A storage buffer of a context that grows on demand; binding: index in the shaders."""

    def __init__(self, owner: Compute, binding: int) -> None:
        self._owner, self._binding = owner, binding
        self._buffer = owner.ctx.buffer(reserve=4, dynamic=True)

    def reserve(self, count: int) -> None:
        """Ensure a capacity of `count` bytes; the content may be lost."""
        if self._buffer.size < count:
            self._buffer.orphan(count)
            self._owner.check_errors(f"allocating {count:,} bytes")

    def write(self, array: np.ndarray) -> None:
        """Upload an array (C-contiguous) to the buffer's beginning."""
        self.reserve(array.nbytes)
        self._buffer.write(array)

    def read_into(self, array: np.ndarray) -> None:
        """Wait for the device and fill `array` (C-contiguous) from the buffer's beginning."""
        self._buffer.read_into(array, size=array.nbytes)

    def bind(self) -> None:
        """Bind the buffer for shaders."""
        self._buffer.bind_to_storage_buffer(self._binding)


def open_context(name: str) -> Compute:
    """Open llvmpipe, gpu0, gpu1, ... in the calling thread, or raise `DeviceError`."""
    try:
        import glcontext
        import moderngl
    except ImportError as error:
        raise DeviceError(f"{name}: {error}") from error
    number = 0 if name == LLVMPIPE else int(name[3:])
    passed, problems = 0, list[str]()
    libraries = {"libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
    for index in range(MAX_DEVICES):
        try:
            backend = glcontext.get_backend_by_name("egl")(
                mode="standalone", glversion=VERSION, device_index=index, **libraries
            )
            ctx = moderngl.create_context(context=backend, require=VERSION)
        except Exception as error:  # both raise plain Exception
            # "requested device index 2, but found 2 devices": no more devices.
            if "but found" in str(error):
                break
            problems.append(str(error))
            continue
        compute = Compute(ctx)
        if selects_renderer(name, compute.renderer):
            if passed == number:
                return compute
            passed += 1
        compute.close()
    reason = f" ({problems[0]})" if problems else ""
    raise DeviceError(
        f"{name}: no EGL device of this name supports compute shaders{reason}; "
        "`raster-harness doctor` lists devices"
    )


@cache
def _read_shader(name: str) -> str:
    return files("triangulators.gpu").joinpath("shaders", name).read_text(encoding="utf-8")


_warned: set[str] = set()


def solve_on_device(
    name: str, batch: Batch, selected: np.ndarray, max_vertices: int, feature: str, worst: bool
) -> None:
    """Solve the selected (p,) polygons that a device supports; mark them in `batch.done`.

    feature: "half_perimeter" or "expected_quads", whose sum is minimised, or maximised if `worst`.
    A failure of the device is logged once, not raised.
    """
    try:
        wrong = (
            _get_context_thread()
            .submit(_solve_batch, name, batch, selected, max_vertices, feature, worst)
            .result()
        )
    except Exception as error:  # drivers and bindings raise any exception
        reason = " ".join(str(error).split()) or type(error).__name__
        _warn_once(f"{name}: device failed ({reason}); the CPU does the remaining polygons")
        return
    if wrong:
        _warn_once(f"{name}: {wrong:,} results are wrong; the CPU does these polygons")


def _warn_once(line: str) -> None:
    if line not in _warned:
        _warned.add(line)
        _LOG.warning(line)


def close_all() -> None:
    """Close all devices and clear the warnings; the next batch opens a device again."""

    def close() -> None:
        while _open_engines:
            _open_engines.popitem()[1].compute.close()

    _get_context_thread().submit(close).result()
    _warned.clear()


@cache
def _get_context_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, thread_name_prefix="triangulators-gpu")


_open_engines: dict[str, "Engine"] = {}  # by name; used only by the context thread
_driver_pids: set[int] = set()
"""Process ids, of this process or parents, that have loaded a driver."""


def _open_engine(name: str) -> "Engine":
    """Return the open device of a name, opened if necessary; for the context thread only."""
    if _driver_pids - {os.getpid()}:
        raise DeviceError("driver loaded before this process was forked; start it by spawn")
    if name not in _open_engines:
        _driver_pids.add(os.getpid())
        _open_engines[name] = Engine(name)
    return _open_engines[name]


def _after_fork() -> None:
    """Clear the context thread and the devices: a forked process has no threads of its parent."""
    _get_context_thread.cache_clear()
    _open_engines.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def _solve_batch(name: str, *task: Any) -> int:
    """Call `Engine.solve`; close the device after an exception, because its context may be lost."""
    engine = _open_engine(name)
    try:
        return engine.solve(*task)
    except BaseException:
        del _open_engines[name]
        try:
            engine.compute.close()
        except Exception:  # the context is lost already
            _LOG.debug("%s cannot be closed", name, exc_info=True)
        raise


class Engine:
    """An open device with programs and buffers, used by the thread of all OpenGL contexts only."""

    def __init__(self, name: str) -> None:
        self.compute: Compute = open_context(name)
        self._corners, self._jobs, self._bases = (Storage(self.compute, n) for n in range(3))

    def solve(
        self, batch: Batch, selected: np.ndarray, max_vertices: int, feature: str, worst: bool
    ) -> int:
        """Solve a batch in chunks (see `solve_on_device`); return the number of wrong results."""
        is_quads = feature == "expected_quads"
        rings = Rings.allocate(batch.vertex_offsets)
        prepare_rings(batch.coords, selected, min(max_vertices, MAX_VERTICES), rings)
        bases = np.zeros(len(rings.corners), dtype=np.uint32)
        wrong = 0
        for first, last in pairwise(find_chunk_bounds(batch.vertex_offsets)):
            indices = first + np.flatnonzero(rings.kind[first:last] != ON_CPU)
            if len(indices):
                self._compute_chunk(rings, first, last, feature, worst, bases)
                words = read_cost_words(indices, bases, rings)
                costs = words.view(np.float64) if is_quads else words.astype(np.float64)
                store_results(indices, bases, costs, is_quads, worst, rings, batch)
                wrong += int(np.count_nonzero((words != NO_RESULT) & ~batch.done[indices]))
        return wrong

    def _compute_chunk(
        self, rings: Rings, first: int, last: int, feature: str, worst: bool, bases: np.ndarray
    ) -> None:
        """Write the results of polygons first..last - 1 to `bases` (n,), see `store_results`."""
        vertices = slice(rings.vertex_offsets[first], rings.vertex_offsets[last])
        self._corners.write(rings.corners[vertices])
        self._bases.reserve(bases[vertices].nbytes)
        for kind in range(KINDS):
            jobs = make_jobs(rings, first, last, kind)
            if len(jobs):
                self._jobs.write(jobs)
                for buffer in (self._corners, self._jobs, self._bases):
                    buffer.bind()
                max_size = SIZES[kind // 2]
                wide = {"WIDE": 1} if kind % 2 else {}
                constants = {"MAX_SIZE": max_size, "LANES": max(LANES, max_size), **wide}
                names = ("exact.glsl", f"{feature}.glsl", "ring.glsl")
                program = self.compute.get_program(*names, **constants)
                program["number"], program["worst"] = len(jobs), int(worst)
                columns = min(len(jobs), MAX_GROUPS)
                self.compute.dispatch(program, columns, -(-len(jobs) // columns))
        self.compute.check_errors("computing rings")
        self._bases.read_into(bases[vertices])
        self.compute.check_errors("reading rings")


def make_jobs(rings: Rings, first: int, last: int, kind: int) -> np.ndarray:
    """Return the jobs (k, 4) int32, one for each ring of a kind among polygons first..last - 1.

    Columns: first vertex in the chunk, number of vertices, width plus height of the bounding box,
    bits of the unit of the ring's grid as float32.
    """
    indices = first + np.flatnonzero(rings.kind[first:last] == kind)
    begin = rings.vertex_offsets[indices]
    jobs = np.zeros((len(indices), 4), dtype=np.int32)
    jobs[:, 0] = begin - rings.vertex_offsets[first]
    jobs[:, 1] = rings.vertex_offsets[indices + 1] - begin
    jobs[:, 2] = rings.longest[indices]
    jobs[:, 3] = rings.unit[indices].view(np.int32)
    return jobs


def find_chunk_bounds(vertex_offsets: np.ndarray, corners: int = CHUNK_VERTICES) -> list[int]:
    """Return the polygon indices at which chunks of about `corners` vertices begin, and the end."""
    marks = np.arange(0, int(vertex_offsets[-1]), corners)
    cuts = np.searchsorted(vertex_offsets, marks, side="left")
    return [int(cut) for cut in np.unique(np.r_[cuts, len(vertex_offsets) - 1])]
