"""An OpenGL context, the few calls that moderngl has no name for, and a frame's triangles in it."""

import ctypes
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, ClassVar
from weakref import WeakValueDictionary

import moderngl
import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriser, UsageError
from harness.frame import SUBPIXEL, Frame
from harness.rasterisers.base import Sample, Stopwatch, Triangles, check_size, shader, shared

SAMPLES_PASSED = 0x8914
TIME_ELAPSED = 0x88BF
QUERY_RESULT = 0x8866
SUBPIXEL_BITS = 0x0D50
MAX_RENDERBUFFER_SIZE = 0x84E8
MAX_FRAGMENT_STORAGE_BLOCKS = 0x90DA

DEPTH_BUFFER_BIT = 0x0100

STRINGS = {"vendor": 0x1F00, "renderer": 0x1F01, "version": 0x1F02, "shading_language": 0x8B8C}

MODERN = 450
"""From this version on everything the shaders need is in core."""

OLDER_EXTENSIONS = (
    "GL_ARB_shading_language_420pack",
    "GL_ARB_shader_storage_buffer_object",
    "GL_ARB_derivative_control",
    "GL_ARB_ES3_1_compatibility",
)
"""What a context older than that must bring instead."""

EARLY_EXTENSIONS = ("GL_ARB_shader_image_load_store",)
"""What such a context must bring for a depth test before shading."""

COMPUTE_EXTENSIONS = (
    "GL_ARB_compute_shader",
    "GL_ARB_shader_image_load_store",
    "GL_ARB_gpu_shader_int64",
)


class Target:
    """A framebuffer, freed when nothing refers to it any more: RGBA8, if `deep` with depths."""

    def __init__(
        self,
        owner: "Context",
        width: int,
        height: int,
        samples: int,
        idle: "Target | None" = None,
        *,
        deep: bool = False,
    ) -> None:
        ctx = owner.ctx
        self._owner = owner
        self._idle = idle
        self.alive = True
        size, samples = (width, height), samples if samples > 1 else 0
        self.buffer = ctx.renderbuffer(size, 4, samples=samples)
        self.depths = ctx.depth_renderbuffer(size, samples=samples) if deep else None
        self.framebuffer = ctx.framebuffer([self.buffer], self.depths)

    def __del__(self) -> None:
        # Not after its context, which frees all it has; nor where making it failed half-way.
        if self._owner.closed or not hasattr(self, "framebuffer"):
            return
        # moderngl binds again what was bound before, so the one to go must not be that.
        if self._idle is not None and self._idle.alive:
            self._owner.activate()
            self._idle.framebuffer.use()
        self.framebuffer.release()
        self.buffer.release()
        if self.depths is not None:
            self.depths.release()
        self.alive = False


class Picture:
    """A texture of one uint a pixel for compute shaders to write to, freed like a Target."""

    def __init__(self, owner: "Context", width: int, height: int) -> None:
        self._owner = owner
        self.texture = owner.ctx.texture((width, height), 1, dtype="u4")

    def __del__(self) -> None:
        if not self._owner.closed and hasattr(self, "texture"):
            self._owner.activate()
            self.texture.release()


class Context:
    """One OpenGL context; whoever uses it calls `activate` first, for there may be several.

    backend : a glcontext context, or an object with its methods
    """

    _current: ClassVar["Context | None"] = None

    def __init__(self, backend: Any) -> None:
        self.ctx = moderngl.create_context(context=backend)
        Context._current = self
        self.closed = False
        self._backend = backend
        self._targets: WeakValueDictionary[tuple[int, ...], Target] = WeakValueDictionary()
        self._pictures: WeakValueDictionary[tuple[int, int], Picture] = WeakValueDictionary()
        self._idle = Target(self, 1, 1, 1)
        self._get_integer = self._function("glGetIntegerv", None, "uint", "pointer")
        self._gen_queries = self._function("glGenQueries", None, "int", "pointer")
        self._delete_queries = self._function("glDeleteQueries", None, "int", "pointer")
        self.begin_query = self._function("glBeginQuery", None, "uint", "uint")
        self.end_query = self._function("glEndQuery", None, "uint")
        self.query_result = self._function("glGetQueryObjectui64v", None, "uint", "uint", "pointer")
        self.flush = self._function("glFlush", None)
        self.clear = self._function("glClear", None, "uint")
        self.max_size = self.integer(MAX_RENDERBUFFER_SIZE)
        self.max_samples = int(self.ctx.max_samples)

    def _function(self, name: str, result: Any, *kinds: str) -> Any:
        types = {"uint": ctypes.c_uint, "int": ctypes.c_int, "pointer": ctypes.c_void_p}
        address = self._backend.load(name)
        if not address:
            raise NoRasteriser(f"the OpenGL driver has no {name}; install a newer one")
        return ctypes.CFUNCTYPE(result, *(types[kind] for kind in kinds))(address)

    def activate(self) -> None:
        """Make this the current context."""
        if Context._current is not self:
            self._backend.__enter__()
            Context._current = self

    def strings(self) -> dict[str, str]:
        """Return vendor, renderer, version and shading language as the driver reports them."""
        get_string = self._function("glGetString", ctypes.c_char_p, "uint")
        return {key: (get_string(name) or b"").decode() for key, name in STRINGS.items()}

    def integer(self, name: int) -> int:
        """Return one integer of the driver's state."""
        value = (ctypes.c_int * 4)()
        self._get_integer(name, value)
        return int(value[0])

    def require(self, *extensions: str) -> None:
        """Raise NoRasteriser if the driver lacks any of the extensions."""
        missing = sorted(set(extensions) - set(self.ctx.extensions))
        if missing:
            raise NoRasteriser(f"the OpenGL driver lacks {', '.join(missing)}; install a newer one")

    def header(self, *extensions: str) -> str:
        """Return the lines that every shader starts with on this context."""
        modern = self.ctx.version_code >= MODERN
        needed = extensions if modern else (*OLDER_EXTENSIONS, *extensions)
        lines = [f"#extension {name} : require" for name in needed]
        return "\n".join(["#version 450 core" if modern else "#version 330 core", *lines, ""])

    def buffer(self, array: NDArray[Any]) -> Any:
        """Upload an array; an empty one gets four bytes, for OpenGL has no empty buffers."""
        return self.ctx.buffer(array if array.size else np.zeros(1, np.uint32))

    def program(self, vertex: str, fragment: str, *, deep: bool = False) -> Any:
        """Build a program of two files in shaders/; `deep` if vertices have depths."""
        header = self.header(*EARLY_EXTENSIONS) + "#define DEPTH\n" if deep else self.header()
        return self.ctx.program(
            vertex_shader=header + shader(f"{vertex}.glsl"),
            fragment_shader=header + shader(f"{fragment}.glsl"),
        )

    def compute(self, *names: str, define: str = "") -> Any:
        """Build a compute shader of files in shaders/, one after another."""
        header = self.header(*COMPUTE_EXTENSIONS)
        if define:
            header += f"#define {define}\n"
        return self.ctx.compute_shader(header + "".join(shader(f"{name}.glsl") for name in names))

    def target(self, width: int, height: int, samples: int = 1, *, deep: bool = False) -> Target:
        """Return a framebuffer, if `deep` with depths, shared with whoever uses one like it now.

        Raises
        ------
        UsageError
            if the device has none that large or with so many samples
        """
        check_size(width, height, self.max_size)
        if samples > max(self.max_samples, 1):
            raise UsageError(f"{samples} samples a pixel: the device has {self.max_samples}")
        key = (width, height, samples, int(deep))
        return shared(
            self._targets, key, lambda: Target(self, width, height, samples, self._idle, deep=deep)
        )

    def picture(self, width: int, height: int) -> Picture:
        """Return a picture, shared like a target; raises UsageError if it is too large."""
        check_size(width, height, self.max_size)
        return shared(self._pictures, (width, height), lambda: Picture(self, width, height))

    @contextmanager
    def queries(self, number: int) -> Iterator["Queries"]:
        """Give `number` query objects for as long as the block runs."""
        names = (ctypes.c_uint * number)()
        self._gen_queries(number, names)
        try:
            yield Queries(self, list(names))
        finally:
            self._delete_queries(number, names)

    def wait(self) -> None:
        """Wait until the device has done all that was asked of it.

        A query's result is waited for by every driver; zink's glFinish does not wait for what
        was flushed before it.
        """
        with self.queries(1) as queries:
            queries.begin(0, TIME_ELAPSED)
            queries.end(TIME_ELAPSED)
            self.ctx.finish()
            queries.result(0)

    def timed(self, calls: int, draw: Callable[[], None], after: Callable[[], None]) -> Sample:
        """Call `draw` and then `after`, `calls` times, and wait; returns the seconds of all.

        Each call of `draw` has a timer of its own, for llvmpipe's knows only the last flush.
        """
        self.wait()
        with self.queries(calls) as timers:
            watch = Stopwatch()
            for call in range(calls):
                timers.begin(call, TIME_ELAPSED)
                draw()
                timers.end(TIME_ELAPSED)
                after()
            self.ctx.finish()
            # zink's glFinish does not wait for what was flushed before it; a result does.
            elapsed = timers.result(calls - 1)
            sample = watch.stop()
            elapsed += sum(timers.result(call) for call in range(calls - 1))
        self.check("timing")
        return replace(sample, gpu=elapsed * 1e-9)

    def check(self, doing: str) -> None:
        """Raise RuntimeError if OpenGL has noted an error since the last check."""
        error = self.ctx.error
        if error != "GL_NO_ERROR":
            raise RuntimeError(f"OpenGL error {error} while {doing}")

    def close(self) -> None:
        """Free the context and all that is in it."""
        self.closed = True
        self.ctx.release()
        Context._current = None


class Queries:
    """Questions to the driver about what is drawn between `begin` and `end`, answered in 64 bits.

    moderngl's own are 32 bits wide: nanoseconds wrap after 4.29 s.
    """

    def __init__(self, owner: Context, names: list[int]) -> None:
        self._owner = owner
        self._names = names

    def begin(self, number: int, target: int) -> None:
        """Start query `number`; one of each target may run at a time."""
        self._owner.begin_query(target, self._names[number])

    def end(self, target: int) -> None:
        """End the query of that target."""
        self._owner.end_query(target)

    def result(self, number: int) -> int:
        """Return the answer; waits until the device has it."""
        value = ctypes.c_uint64()
        self._owner.query_result(self._names[number], QUERY_RESULT, ctypes.byref(value))
        return value.value


class Upload:
    """A frame's points and triangles in buffers of the device.

    points : (n,) ivec2, in 1/256 px; polygons : (n,) uint, the number of each point's polygon;
    indices : (3 m,) int; depths : (n,) int, None without a depth test
    """

    def __init__(self, owner: Context, frame: Frame, triangles: Triangles) -> None:
        self.owner = owner
        self.size = (frame.width, frame.height)
        self.scissor = frame.scissor
        self.draws = frame.draws(triangles)
        self.window = tuple(frame.window.tolist())
        self.triangles = len(triangles)
        numbers = np.arange(len(frame.offsets) - 1, dtype=np.uint32)
        self.points = owner.buffer(np.ascontiguousarray(frame.points, np.int32))
        self.polygons = owner.buffer(np.repeat(numbers, np.diff(frame.offsets)))
        self.indices = owner.buffer(triangles)
        self.depths = None if frame.depths is None else owner.buffer(frame.depths)

    def close(self) -> None:
        """Free the buffers."""
        self.owner.activate()
        for buffer in (self.points, self.polygons, self.indices, self.depths):
            if buffer is not None:
                buffer.release()


class BoundMesh:
    """Triangles on the device, bound to a program and a framebuffer."""

    def __init__(
        self, owner: Context, program: Any, target: Target, frame: Frame, tris: Triangles
    ) -> None:
        self.program = program
        self.target = target
        self.upload = Upload(owner, frame, tris)
        content = [(self.upload.points, "2i", "position"), (self.upload.polygons, "1u", "polygon")]
        if self.upload.depths is not None:
            content.append((self.upload.depths, "1i", "depth"))
        self.vertices = owner.ctx.vertex_array(program, content, self.upload.indices)

    def bind(self) -> None:
        """Make the framebuffer and the viewport current; before `draw`."""
        framebuffer = self.target.framebuffer
        framebuffer.use()
        framebuffer.viewport = (0, 0, *self.upload.size)
        framebuffer.scissor = self.upload.scissor  # type: ignore[assignment]
        self.program["size"] = tuple(SUBPIXEL * side for side in self.upload.size)
        ctx = self.upload.owner.ctx
        (ctx.disable if self.upload.depths is None else ctx.enable)(ctx.DEPTH_TEST)

    def draw(self, instances: int = 1) -> None:
        """Submit the triangles, `instances` times in one call for each tile."""
        for rows in self.upload.draws:
            self.draw_rows(rows, instances)

    def begin(self) -> None:
        """Begin a tile or a view: with a depth test nothing is near yet."""
        if self.upload.depths is not None:
            self.upload.owner.clear(DEPTH_BUFFER_BIT)

    def draw_rows(self, rows: slice, instances: int = 1) -> None:
        """Submit some of the triangles, `instances` times in one call."""
        self.begin()
        count = 3 * (rows.stop - rows.start)
        self.vertices.render(vertices=count, first=3 * rows.start, instances=instances)

    def close(self) -> None:
        """Free the buffers."""
        self.upload.close()
        self.vertices.release()
