"""An OpenGL context for compute shaders, without a window."""

from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from triangulators.devices import LLVMPIPE, matches

VERSION = 430
"""Of OpenGL: the first with compute shaders and storage buffers."""

MAX_DEVICES = 32
MAX_GROUPS = 65535
"""Workgroups that every device takes in one dimension of a dispatch."""


class DeviceFailed(Exception):  # noqa: N818 - says what happened
    """A device could not be opened, or gave up; the message says why."""


class Compute:
    """An open context, for the one thread that opened it."""

    def __init__(self, ctx: Any) -> None:
        self.ctx = ctx
        self.renderer = str(ctx.info["GL_RENDERER"])
        self.version = str(ctx.info["GL_VERSION"])
        self.storage = int(ctx.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])  # bytes of one buffer
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
        """Raise `DeviceFailed` if OpenGL has noted an error since the last check."""
        error = self.ctx.error
        if error != "GL_NO_ERROR":
            raise DeviceFailed(f"OpenGL error {error} while {doing}")

    def close(self) -> None:
        """Free the context and what is in it."""
        self.ctx.release()


class Storage:
    """A storage buffer that grows when more is put into it than it holds."""

    def __init__(self, owner: Compute, binding: int) -> None:
        self._owner = owner
        self._binding = binding
        self._buffer: Any = None

    def reserve(self, count: int) -> None:
        """Have room for at least `count` bytes; what was in it may be lost."""
        if self._buffer is None or self._buffer.size < count:
            if self._buffer is not None:
                self._buffer.release()
            self._buffer = None
            size = min(1 << max(count - 1, 255).bit_length(), max(count, self._owner.storage))
            self._buffer = self._owner.ctx.buffer(reserve=size, dynamic=True)
            self._owner.check(f"taking {size:,} bytes")

    def write(self, array: np.ndarray) -> None:
        """Upload an array (C-contiguous) to the buffer's beginning."""
        self.reserve(array.nbytes)
        if array.size:
            self._buffer.write(array)

    def read_into(self, array: np.ndarray) -> None:
        """Wait for the device and fill `array` (C-contiguous) from the buffer's beginning."""
        if array.size:
            self._buffer.read_into(array, size=array.nbytes)

    def bind(self) -> None:
        """Let shaders see it."""
        self._buffer.bind_to_storage_buffer(self._binding)


def open_context(name: str) -> Compute:
    """Open llvmpipe, gpu0, gpu1, ... (see `devices.check_name`) in the calling thread.

    Raises `DeviceFailed` if there is none of that name, or its driver fails.
    """
    try:
        import moderngl
    except ImportError as error:
        raise DeviceFailed(f"{name}: {error}") from error
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
    raise DeviceFailed(f"there is no {name} with compute shaders here{reason}")


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
