"""OpenGL contexts, with a few functions that moderngl lacks, and the context of libOSMesa."""

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

import moderngl
import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriserError, UsageError
from harness.frame import Frame
from harness.rasterisers.base import Sample, Stopwatch, Triangles, check_size, read_shader

INT, UINT, POINTER = ctypes.c_int, ctypes.c_uint, ctypes.c_void_p

SAMPLES_PASSED = 0x8914
TIME_ELAPSED = 0x88BF
QUERY_RESULT = 0x8866

# OpenGL query targets of pipeline statistics, by the name of the counter.
STATISTICS = {
    "vertex_shader_invocations": 0x82F0,
    "clipping_input_primitives": 0x82F6,
    "clipping_output_primitives": 0x82F7,
}

# First OpenGL version with pipeline statistics, and the extension for older versions.
STATISTICS_VERSION, STATISTICS_EXTENSION = 460, "GL_ARB_pipeline_statistics_query"

DEPTH_BUFFER_BIT = 0x0100

TEXTURE_PX = 1024  # side of the texture of `Options.texture`
MODERN_VERSION = 450  # first version whose core has everything that the shaders need

# Extensions that a context older than `MODERN_VERSION` needs.
OLDER_EXTENSIONS = (
    "GL_ARB_shading_language_420pack",
    "GL_ARB_shader_storage_buffer_object",
    "GL_ARB_derivative_control",
    "GL_ARB_ES3_1_compatibility",
)

EARLY_EXTENSIONS = ("GL_ARB_shader_image_load_store",)  # and for depth tests before shading

COMPUTE_EXTENSIONS = (
    "GL_ARB_compute_shader",
    "GL_ARB_shader_image_load_store",
    "GL_ARB_gpu_shader_int64",
)


class Context:
    """An OpenGL context; call `activate` before each use, as a process may have several contexts.

    Buffers and other OpenGL objects without a reference are freed by the next `activate`.
    `backend` is a glcontext context, or an object with the same methods.
    """

    _current: ClassVar["Context | None"] = None

    def __init__(self, backend: Any) -> None:
        self.ctx = moderngl.create_context(context=backend)
        self.ctx.gc_mode = "context_gc"
        Context._current = self
        self._backend = backend
        self._target: tuple[tuple[int, ...], Any] = (), None
        self._picture: Any = None
        self._gen_queries = self._load_function("glGenQueries", INT, POINTER)
        self._delete_queries = self._load_function("glDeleteQueries", INT, POINTER)
        self.begin_query = self._load_function("glBeginQuery", UINT, UINT)
        self.end_query = self._load_function("glEndQuery", UINT)
        self._query_result = self._load_function("glGetQueryObjectui64v", UINT, UINT, POINTER)
        self.flush = self._load_function("glFlush")
        self.clear = self._load_function("glClear", UINT)
        self.max_size = int(self.ctx.info["GL_MAX_RENDERBUFFER_SIZE"])
        self.max_samples = int(self.ctx.max_samples)
        has_statistics = (
            self.ctx.version_code >= STATISTICS_VERSION
            or STATISTICS_EXTENSION in self.ctx.extensions
        )
        self.statistics = STATISTICS if has_statistics else {}

    def _load_function(self, name: str, *types: Any) -> Any:
        address = self._backend.load(name)
        if not address:
            raise OSError(f"OpenGL driver: function {name} not found")
        return ctypes.CFUNCTYPE(None, *types)(address)

    def activate(self) -> None:
        """Make this the current context, and free its unreferenced objects."""
        if Context._current is not self:
            self._backend.__enter__()
            Context._current = self
        self.ctx.gc()

    def require_extensions(self, *extensions: str) -> None:
        """Raise NoRasteriserError if the driver lacks any of the extensions."""
        missing = sorted(set(extensions) - set(self.ctx.extensions))
        if missing:
            raise NoRasteriserError(
                f"OpenGL driver: missing extensions ({', '.join(missing)}); install a newer driver"
            )

    def _make_header(self, extensions: Sequence[str], defines: Sequence[str]) -> str:
        """Return a shader's version, extensions (and those an old context needs), and macros."""
        modern = self.ctx.version_code >= MODERN_VERSION
        needed = extensions if modern else (*OLDER_EXTENSIONS, *extensions)
        lines = ["#version 450 core" if modern else "#version 330 core"]
        lines += [f"#extension {name} : require" for name in needed]
        lines += [f"#define {name}" for name in defines]
        return "\n".join([*lines, ""])

    def create_buffer(self, array: NDArray[Any]) -> Any:
        """Upload an array; an empty array becomes four bytes, as OpenGL has no empty buffers."""
        return self.ctx.buffer(array if array.size else np.zeros(1, np.uint32))

    def build_program(self, vertex: str, fragment: str, *defines: str) -> Any:
        """Build a program from two files in shaders/; `defines` are macros such as DEPTH."""
        header = self._make_header(EARLY_EXTENSIONS if "DEPTH" in defines else (), defines)
        try:
            return self.ctx.program(
                vertex_shader=header + read_shader(f"{vertex}.glsl"),
                fragment_shader=header + read_shader(f"{fragment}.glsl"),
            )
        except moderngl.Error as error:
            message = " ".join(str(error).split())
            raise NoRasteriserError(
                f"OpenGL driver: shader compilation failed ({message}); choose another device"
            ) from error

    def build_compute_shader(self, *names: str, defines: Sequence[str] = ()) -> Any:
        """Build a compute shader from concatenated files in shaders/; `defines` are macros."""
        header = self._make_header(COMPUTE_EXTENSIONS, defines)
        source = "".join(read_shader(f"{name}.glsl") for name in names)
        return self.ctx.compute_shader(header + source)

    def get_framebuffer(
        self, width: int, height: int, samples: int = 1, *, deep: bool = False
    ) -> Any:
        """Return an RGBA8 framebuffer, with depths if `deep`; reuse the last one if it is equal."""
        check_size(width, height, self.max_size)
        if samples > max(self.max_samples, 1):
            raise UsageError(
                f"{samples} samples per pixel: unsupported (the maximum is {self.max_samples}); "
                "lower --samples"
            )
        properties = (width, height, samples if samples > 1 else 0, int(deep))
        if properties != self._target[0]:
            size, number = properties[:2], properties[2]
            colours = self.ctx.renderbuffer(size, 4, samples=number)
            depths = self.ctx.depth_renderbuffer(size, samples=number) if deep else None
            self._target = properties, self.ctx.framebuffer([colours], depths)
        return self._target[1]

    def get_picture(self, width: int, height: int) -> Any:
        """Return a texture, a uint per pixel, for compute shaders; reuse the last of this size."""
        check_size(width, height, self.max_size)
        if self._picture is None or self._picture.size != (width, height):
            self._picture = self.ctx.texture((width, height), 1, dtype="u4")
        return self._picture

    @cached_property
    def texture(self) -> Any:
        """A mip-mapped RGBA8 texture of noise with trilinear filtering."""
        size = (TEXTURE_PX, TEXTURE_PX)
        content = np.random.default_rng(0).integers(128, 256, (*size, 4), np.uint8)
        texture = self.ctx.texture(size, 4, content)
        texture.build_mipmaps()
        texture.filter = (moderngl.LINEAR_MIPMAP_LINEAR, moderngl.LINEAR)
        return texture

    @contextmanager
    def create_queries(self, number: int) -> Iterator[list[int]]:
        """Create query objects of 64 bits; nanoseconds overflow moderngl's 32 bits after 4.29 s."""
        names = (ctypes.c_uint * number)()
        self._gen_queries(number, names)
        try:
            yield list(names)
        finally:
            self._delete_queries(number, names)

    def read_query(self, query: int) -> int:
        """Wait for the result of a query, and return the result."""
        value = ctypes.c_uint64()
        self._query_result(query, QUERY_RESULT, ctypes.byref(value))
        return value.value

    def count_by_queries(
        self, targets: Mapping[str, int], draw: Callable[[], None]
    ) -> dict[str, int]:
        """Call `draw` once; return the results of the query targets (number by name), by name."""
        with self.create_queries(len(targets)) as queries:
            for target, query in zip(targets.values(), queries, strict=True):
                self.begin_query(target, query)
            draw()
            for target in targets.values():
                self.end_query(target)
            return dict(zip(targets, map(self.read_query, queries), strict=True))

    def wait(self) -> None:
        """Wait for all commands; zink's glFinish does not wait for those flushed before."""
        with self.create_queries(1) as (query,):
            self.begin_query(TIME_ELAPSED, query)
            self.end_query(TIME_ELAPSED)
            self.ctx.finish()
            self.read_query(query)

    def time_draws(self, calls: int, draw: Callable[[], None], after: Callable[[], None]) -> Sample:
        """Repeat `draw` and then `after`, a flush or a barrier; return the total time.

        Each repetition has a GPU timer, as a timer of llvmpipe covers only the last flush.
        """
        self.wait()
        with self.create_queries(calls) as timers:
            watch = Stopwatch()
            for timer in timers:
                self.begin_query(TIME_ELAPSED, timer)
                draw()
                self.end_query(TIME_ELAPSED)
                after()
            self.ctx.finish()
            # zink's glFinish does not wait for flushed commands; reading a result does.
            self.read_query(timers[-1])
            sample = watch.stop()
            elapsed = sum(map(self.read_query, timers))
        self.raise_pending_error("timing")
        return replace(sample, gpu=elapsed * 1e-9)

    def raise_pending_error(self, doing: str) -> None:
        """Raise RuntimeError if an OpenGL error is pending; `doing` is the activity to report."""
        error = self.ctx.error
        if error != "GL_NO_ERROR":
            raise RuntimeError(f"OpenGL error {error} while {doing}")

    def upload(self, frame: Frame, triangles: Triangles) -> tuple[Any, Any, Any]:
        """Upload a frame and `triangles` (m, 3); return three buffers.

        The buffers hold points, (n,) ivec2 in 1/256 px; their polygon numbers, (n,) uint; and the
        triangles' vertices, (3 m,) int.
        """
        numbers = np.arange(len(frame.grid), dtype=np.uint32)
        return (
            self.create_buffer(np.ascontiguousarray(frame.points, np.int32)),
            self.create_buffer(np.repeat(numbers, frame.grid.vertex_counts)),
            self.create_buffer(triangles),
        )

    def close(self) -> None:
        """Free the context with all objects."""
        self.ctx.release()
        Context._current = None


OSMESA_RGBA, UNSIGNED_BYTE = 0x1908, 0x1401
OSMESA_FORMAT, OSMESA_PROFILE, OSMESA_CORE_PROFILE = 0x22, 0x33, 0x34
OSMESA_MAJOR, OSMESA_MINOR = 0x36, 0x37
SIDE = 16  # side in px of a buffer that OSMesa requires; drawings go elsewhere


class OSMesaContext:
    """A core-profile context of libOSMesa with the methods that moderngl requires."""

    def __init__(self, library: str) -> None:
        self._library = osmesa = ctypes.CDLL(library)
        osmesa.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        osmesa.OSMesaCreateContextAttribs.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        osmesa.OSMesaGetProcAddress.restype = ctypes.c_void_p
        osmesa.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        osmesa.OSMesaMakeCurrent.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_int] * 3
        osmesa.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        self._pixels = (ctypes.c_ubyte * (4 * SIDE * SIDE))()
        settings = (OSMESA_FORMAT, OSMESA_RGBA, OSMESA_PROFILE, OSMESA_CORE_PROFILE)
        attributes = (*settings, OSMESA_MAJOR, 3, OSMESA_MINOR, 3, 0)  # 3.3 or newer
        values = (ctypes.c_int * len(attributes))(*attributes)
        self._context: int | None = osmesa.OSMesaCreateContextAttribs(values, None)
        if self._context is None:
            raise OSError("OSMesa has no OpenGL 3.3 core context")
        self.__enter__()

    def load(self, name: str) -> int:
        """Return the address of an OpenGL function, or 0 if it does not exist."""
        address: int | None = self._library.OSMesaGetProcAddress(name.encode())
        return address or 0

    load_opengl_function = load

    def __enter__(self) -> "OSMesaContext":
        self._library.OSMesaMakeCurrent(self._context, self._pixels, UNSIGNED_BYTE, SIDE, SIDE)
        return self

    def __exit__(self, *_: object) -> None:
        self._library.OSMesaMakeCurrent(None, None, UNSIGNED_BYTE, 0, 0)

    def release(self) -> None:
        """Free the context."""
        self._library.OSMesaDestroyContext(self._context)
