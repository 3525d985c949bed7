"""OpenGL on an EGL device: counted with atomics in one pass, timed in another."""

from __future__ import annotations

import os
import time
from typing import Any, ClassVar, Self

import glcontext  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriser
from harness.frame import SUBPIXEL, Frame
from harness.rasterisers import context, egl
from harness.rasterisers.base import (
    Counters,
    Device,
    Drawing,
    Image,
    Options,
    Rasteriser,
    Sample,
    Triangles,
)
from harness.rasterisers.context import Context

COUNTED = ("fragments", "quads", "helper_lanes")

STATISTICS = {
    "driver_vertices_submitted": 0x82EE,
    "driver_primitives_submitted": 0x82EF,
    "driver_vertex_invocations": 0x82F0,
    "driver_clipping_input": 0x82F6,
    "driver_clipping_output": 0x82F7,
    "driver_fragment_invocations": 0x82F4,
}
"""What ARB_pipeline_statistics_query reports: the driver's opinion, not a count of quads."""

KEEP_ALPHA = (True, True, True, False)
WRITE_ALL = (True, True, True, True)

BLOCK_LANES = 16
"""Lanes llvmpipe shades at once, a 4x4 block; it reports all of them as invocations."""


class OpenGL(Rasteriser):
    """OpenGL 3.3 or later with storage buffers in fragment shaders, through EGL, no window."""

    name = "opengl"
    counters: ClassVar[tuple[str, ...]] = (*COUNTED, "samples_passed", *STATISTICS)
    known: ClassVar[tuple[str, ...]] = ("gpu0", "llvmpipe", "softpipe", "zink")

    @classmethod
    def devices(cls) -> list[Device]:
        """List GPUs, then llvmpipe, softpipe and zink on lavapipe, as far as they open."""
        return list(egl.probe()[0])

    @classmethod
    def knows(cls, name: str) -> bool:
        """Whether `name` is one of these; gpu0, gpu1, ... are."""
        return name in cls.known or (name.startswith("gpu") and name[3:].isdigit())

    @classmethod
    def remedy(cls, name: str | None = None) -> str:
        """Say how to get a device."""
        if name and name.startswith("gpu"):
            return "EGL finds no such GPU; install its vendor's driver, or choose llvmpipe"
        if name == "zink":
            return f"run: {egl.INSTALL_VULKAN}"
        return f"run: {egl.INSTALL}"

    def __init__(self, device: Device) -> None:
        self.device = device
        for key, value in device.environment.items():
            if os.environ.get(key) != value:
                raise NoRasteriser(f"{device.name} needs {key}={value} before its driver loads")
        self.context = Context(self._open(device))
        self.ctx = self.context.ctx
        strings = self.context.strings()
        if not self._matches(device, strings["renderer"]):
            self.context.close()
            raise NoRasteriser(
                f"asked for {device.name}, but OpenGL opened '{strings['renderer']}'; "
                f"{self.remedy(device.name)}"
            )
        if self.ctx.version_code < context.MODERN:
            self.context.require(*context.OLDER_EXTENSIONS)
        if self.context.integer(context.MAX_FRAGMENT_STORAGE_BLOCKS) < 1:
            raise NoRasteriser(f"{device.name} has no storage buffers in fragment shaders")
        self.device = Device(
            device.name,
            egl.is_software(strings["renderer"]),
            device.environment,
            {
                **device.details,
                **strings,
                "subpixel_bits": self.context.integer(context.SUBPIXEL_BITS),
                "max_size": self.context.max_size,
                "max_samples": self.context.max_samples,
            },
        )
        self._draw = self.context.program("draw.vert", "draw.frag")
        self._tally = self.context.program("draw.vert", "count.frag")
        self._statistics = (
            STATISTICS if "GL_ARB_pipeline_statistics_query" in self.ctx.extensions else {}
        )
        self.context.check("opening the device")

    def _open(self, device: Device) -> Any:
        """Create a context on the device's EGL device."""
        try:
            return glcontext.get_backend_by_name("egl")(
                mode="standalone",
                glversion=330,
                device_index=device.details["egl_index"],
                libgl="libGL.so.1",
                libegl="libEGL.so.1",
            )
        except Exception as error:  # glcontext raises plain Exception
            raise NoRasteriser(f"{device.name}: {error}; {self.remedy(device.name)}") from error

    def _matches(self, device: Device, renderer: str) -> bool:
        return egl.matches(device.name, renderer)

    def close(self) -> None:
        """Free the programs and the context."""
        for program in (self._draw, self._tally):
            program.release()
        self.context.close()

    def _count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        polygons = len(frame.offsets) - 1
        totals = np.zeros((polygons, len(COUNTED)), np.int64)
        opinion = dict.fromkeys(["samples_passed", *self._statistics], 0)
        target = self.context.target(frame.width, frame.height, options.samples)
        for part in batches(frame, triangles):
            counts = self.ctx.buffer(np.zeros(max(totals.size, 1), np.uint32))
            counts.bind_to_storage_buffer(0)
            # llvmpipe forgets what it has collected for a tile, storage writes and all, when an
            # opaque triangle covers the tile; a draw that keeps alpha is not opaque to it.
            target.framebuffer.color_mask = KEEP_ALPHA
            with _Mesh(self.context, self._tally, target, frame, part) as mesh:
                mesh.draw(1)
            self.ctx.finish()
            target.framebuffer.color_mask = WRITE_ALL
            totals += np.frombuffer(counts.read(), np.uint32)[: totals.size].reshape(totals.shape)
            counts.release()
            # In a pass of its own: storage writes change what a driver may skip.
            with (
                _Mesh(self.context, self._draw, target, frame, part) as mesh,
                self.context.queries(
                    {"samples_passed": context.SAMPLES_PASSED, **self._statistics}
                ) as answers,
            ):
                mesh.draw(1)
            for name, value in answers.items():
                opinion[name] += value
        self.context.check("counting")
        counters = {name: totals[:, k].copy() for k, name in enumerate(COUNTED)}
        counters |= {name: np.array(value, np.int64) for name, value in opinion.items()}
        if "llvmpipe" in self.device.details["renderer"] and self._statistics:
            counters["driver_blocks"] = counters["driver_fragment_invocations"] // BLOCK_LANES
        return counters

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        target = self.context.target(frame.width, frame.height, options.samples)
        mesh = _Mesh(self.context, self._draw, target, frame, triangles)
        return _Timed(self.context, mesh, options.work, self.device.software)

    def _image(self, frame: Frame, triangles: Triangles, options: Options) -> Image:
        target = self.context.target(frame.width, frame.height, options.samples)
        target.framebuffer.clear(0.0, 0.0, 0.0, 0.0)
        with _Mesh(self.context, self._draw, target, frame, triangles) as mesh:
            mesh.program["work"] = options.work
            mesh.draw(1)
        source = target
        if options.samples > 1:
            source = self.context.target(frame.width, frame.height)
            self.ctx.copy_framebuffer(source.framebuffer, target.framebuffer)
        pixels = np.frombuffer(source.framebuffer.read(components=4), np.uint8)
        self.context.check("reading the picture")
        return pixels.reshape(frame.height, frame.width, 4)[::-1].copy()


class _Mesh:
    """Triangles on the device, bound to a program and a framebuffer."""

    def __init__(
        self, owner: Context, program: Any, target: context.Target, frame: Frame, tris: Triangles
    ) -> None:
        self.ctx = owner.ctx
        self.program = program
        self.target = target
        self.size = (frame.width, frame.height)
        self.empty = len(tris) == 0
        if self.empty:
            return
        polygons = np.repeat(
            np.arange(len(frame.offsets) - 1, dtype=np.uint32), np.diff(frame.offsets)
        )
        self.points = self.ctx.buffer(np.ascontiguousarray(frame.points, np.int32))
        self.polygons = self.ctx.buffer(polygons)
        self.indices = self.ctx.buffer(tris)
        # A program may have no use for an attribute; then the driver drops it.
        content = [(self.points, "2i", "position"), (self.polygons, "1u", "polygon")]
        self.vertices = self.ctx.vertex_array(program, content, self.indices)

    def draw(self, instances: int) -> None:
        """Submit the triangles, `instances` times in one call."""
        if self.empty:
            return
        self.bind()
        self.vertices.render(instances=instances)

    def bind(self) -> None:
        """Make the framebuffer and the viewport current."""
        framebuffer = self.target.framebuffer
        framebuffer.use()
        framebuffer.viewport = (0, 0, *self.size)
        self.program["size"] = tuple(SUBPIXEL * side for side in self.size)

    def close(self) -> None:
        """Free the buffers."""
        if not self.empty:
            for part in (self.vertices, self.indices, self.polygons, self.points):
                part.release()
            self.empty = True

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class _Timed(Drawing):
    def __init__(self, owner: Context, mesh: _Mesh, work: int, software: bool) -> None:
        self.context = owner
        self.mesh = mesh
        self.work = work
        self.software = software

    def sample(self, repeats: int) -> Sample:
        """Draw `repeats` times.

        A GPU gets them as instances of one call, so that it is never kept waiting for the next. A
        software rasteriser gets one call each and a flush: it collects a frame before it draws,
        and would leave out tiles of one draw that a later one covers. The clock stops when the
        timer's result is there, for zink's glFinish does not wait for what was flushed before it.
        """
        self.mesh.program["work"] = self.work
        self.mesh.bind()
        self.context.ctx.finish()
        start = time.perf_counter()
        with self.context.queries({"elapsed": context.TIME_ELAPSED}) as answers:
            if self.software:
                for _ in range(repeats):
                    self.mesh.draw(1)
                    self.context.flush()
            else:
                self.mesh.draw(repeats)
            self.context.ctx.finish()
        wall = time.perf_counter() - start
        self.context.check("timing")
        return Sample(wall=wall, gpu=answers["elapsed"] * 1e-9)

    def close(self) -> None:
        self.mesh.close()


def batches(frame: Frame, triangles: Triangles) -> list[Triangles]:
    """Split `triangles` so that no batch can count past 32 bits.

    A triangle touches at most the quads of its bounding box.
    """
    corners = frame.points[triangles].astype(np.int64)
    sides = (corners.max(axis=1) - corners.min(axis=1)) // SUBPIXEL + 4
    lanes: NDArray[np.int64] = np.cumsum(sides.prod(axis=1))
    if not len(lanes) or lanes[-1] < 2**32:
        return [triangles]
    return np.split(triangles, np.flatnonzero(np.diff(lanes // 2**31)) + 1)
