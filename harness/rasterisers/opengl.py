"""OpenGL on an EGL device: counted with atomics in one pass, timed in another."""

from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import cycle
from typing import Any, ClassVar

import glcontext
import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriser
from harness.frame import Frame, bare_frame
from harness.rasterisers import context, devices
from harness.rasterisers.base import (
    Counters,
    Device,
    Drawing,
    Image,
    Options,
    Rasteriser,
    Sample,
    Triangles,
    batches,
    per_polygon,
)
from harness.rasterisers.context import BoundMesh, Context, Target
from harness.rasterisers.reference import SHADED, visible
from scenes.scene import Viewing
from triangulators.devices import is_software, matches

LAST_LANE = np.array([[800, 800], [1000, 800], [800, 1000]], np.int32)
"""A triangle that covers nothing but pixel (3, 3)."""

KEEP_ALPHA = (True, True, True, False)
WRITE_ALL = (True, True, True, True)

IN_ORDER = ("softpipe",)
"""Renderers that finish a triangle before they begin the next."""


class GLRasteriser(Rasteriser):
    """A rasteriser on OpenGL through EGL, without a window.

    `context` is the open context, `ctx` moderngl's view of it; `device` is completed with what
    the driver says about itself.
    """

    known: ClassVar[tuple[str, ...]] = ("gpu0", "llvmpipe", "softpipe", "zink")

    @classmethod
    def devices(cls) -> list[Device]:
        """List GPUs, then llvmpipe, softpipe and zink on lavapipe, as far as they open."""
        return list(devices.of_egl()[0])

    @classmethod
    def remedy(cls, name: str | None = None) -> str:
        """Say how to get a device."""
        if name and name.startswith("gpu"):
            return "EGL finds no such GPU; install its vendor's driver, or choose llvmpipe"
        if name == "zink":
            return f"run: {devices.INSTALL_VULKAN}"
        return f"run: {devices.INSTALL}"

    def __init__(self, device: Device) -> None:
        device.require_environment()
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
        self.device = replace(
            device,
            software=is_software(strings["renderer"]),
            details={
                **device.details,
                **strings,
                "subpixel_bits": self.context.integer(context.SUBPIXEL_BITS),
                "max_size": self.context.max_size,
                "max_samples": self.context.max_samples,
            },
        )
        self.context.check("opening the device")

    def _open(self, device: Device) -> Any:
        """Create a context, an object with glcontext's methods."""
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
        return matches(device.name, renderer)

    def close(self) -> None:
        """Close the context."""
        self.context.activate()
        self.context.close()


class OpenGL(GLRasteriser):
    """OpenGL 3.3 or later with storage buffers in fragment shaders, through EGL, no window."""

    name = "opengl"
    shades = True
    cuts = True
    deep = True
    counters: ClassVar[tuple[str, ...]] = (*SHADED, "samples_passed")

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        if self.context.integer(context.MAX_FRAGMENT_STORAGE_BLOCKS) < 1:
            raise NoRasteriser(f"{device.name} has no storage buffers in fragment shaders")
        self._draw = self.context.program("draw.vert", "draw.frag")
        self._tally = open_tally(self.context)
        self._deep: tuple[Any, Tally] | None = None
        self.context.check("building the shaders")

    def close(self) -> None:
        """Free the programs and the context."""
        self.context.activate()
        self._draw.release()
        self._tally.close()
        if self._deep is not None:
            self._deep[0].release()
            self._deep[1].close()
        super().close()

    def _programs(self, frame: Frame) -> tuple[Any, "Tally"]:
        """Return the program that draws and what counts, with a depth test if the frame has one."""
        if frame.depths is None:
            return self._draw, self._tally
        if self._deep is None:
            draw = self.context.program("draw.vert", "draw.frag", deep=True)
            self._deep = draw, open_tally(self.context, deep=True)
        return self._deep

    def _target(self, frame: Frame, options: Options) -> Target:
        deep = frame.depths is not None
        return self.context.target(frame.width, frame.height, options.samples, deep=deep)

    def _count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        self.context.activate()
        totals = np.zeros((len(frame.offsets) - 1, len(SHADED)), np.int64)
        passed = 0
        target = self._target(frame, options)
        draw, tally = self._programs(frame)
        for part in batches(frame, triangles):
            totals += tally.count(target, frame, part)
            # Drawn again, without counting: storage writes change what a driver may skip.
            with (
                closing(BoundMesh(self.context, draw, target, frame, part)) as mesh,
                self.context.queries(1) as queries,
            ):
                mesh.bind()
                queries.begin(0, context.SAMPLES_PASSED)
                mesh.draw()
                queries.end(context.SAMPLES_PASSED)
                passed += queries.result(0)
        self.context.check("counting")
        counters = {name: totals[:, k].copy() for k, name in enumerate(SHADED)}
        counters["samples_passed"] = np.array(passed, np.int64)
        if frame.depths is not None:
            ties = visible(frame, triangles)["depth_ties"]
            counters["depth_ties"] = per_polygon(frame, triangles, ties)
        return counters

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        self.context.activate()
        target = self._target(frame, options)
        mesh = BoundMesh(self.context, self._programs(frame)[0], target, frame, triangles)
        return _Timed(self.context, mesh, options.work, self.device.software)

    def image(self, frame: Frame, triangles: Triangles, options: Options) -> Image:
        """Draw once and return the picture, (height, width, 4) RGBA, top row first."""
        triangles = self._ready(frame, triangles, options)
        self.context.activate()
        target = self._target(frame, options)
        target.framebuffer.scissor = None  # type: ignore[assignment]
        target.framebuffer.clear(0.0, 0.0, 0.0, 0.0)
        draw = self._programs(frame)[0]
        with closing(BoundMesh(self.context, draw, target, frame, triangles)) as mesh:
            mesh.program["work"] = options.work
            mesh.bind()
            mesh.draw()
        target.framebuffer.scissor = None  # type: ignore[assignment]
        source = target
        if options.samples > 1:
            source = self.context.target(frame.width, frame.height)
            self.ctx.copy_framebuffer(source.framebuffer, target.framebuffer)
        pixels = np.frombuffer(source.framebuffer.read(components=4), np.uint8)
        self.context.check("reading the picture")
        return pixels.reshape(frame.height, frame.width, 4)[::-1].copy()


class _Timed(Drawing):
    def __init__(self, owner: Context, mesh: BoundMesh, work: int, software: bool) -> None:
        self.context = owner
        self.mesh = mesh
        self.work = work
        self.software = software

    def sample(self, repeats: int) -> Sample:
        """Draw `repeats` times.

        A GPU gets them as instances of one call, so that it is never kept waiting for the next. A
        software rasteriser gets one call each and a flush: it collects a frame before it draws,
        and would leave out tiles of one draw that a later one covers. So each map tile is a call
        of its own there, too. With a depth test each draw begins with nothing near, also on a GPU.
        """
        self.context.activate()
        self.mesh.program["work"] = self.work
        self.mesh.bind()
        if not self.software and self.mesh.upload.depths is None:
            return self.context.timed(1, partial(self.mesh.draw, repeats), self.context.flush)
        draws = self.mesh.upload.draws
        following = cycle(draws)
        return self.context.timed(
            repeats * len(draws), lambda: self.mesh.draw_rows(next(following)), self.context.flush
        )

    def close(self) -> None:
        self.mesh.close()


class Tally:
    """Counts in one draw, each quad through the lane that is its first covered one."""

    shader = "count.frag"

    def __init__(self, owner: Context, *, deep: bool = False) -> None:
        self.context = owner
        self.program = owner.program("draw.vert", self.shader, deep=deep)

    def count(self, target: Target, frame: Frame, triangles: Triangles) -> NDArray[np.int64]:
        """Return (p, 4) counts in the order of SHADED."""
        polygons = len(frame.offsets) - 1
        counts = self.context.buffer(np.zeros(len(SHADED) * polygons, np.uint32))
        counts.bind_to_storage_buffer(0)
        # llvmpipe forgets what it has collected for a tile, storage writes and all, when an
        # opaque triangle covers the tile; a draw that keeps alpha is not opaque to it.
        target.framebuffer.color_mask = KEEP_ALPHA
        with closing(BoundMesh(self.context, self.program, target, frame, triangles)) as mesh:
            mesh.bind()
            self._submit(mesh)
        target.framebuffer.color_mask = WRITE_ALL
        self.context.ctx.memory_barrier()
        found = np.frombuffer(counts.read(), np.uint32)[: len(SHADED) * polygons]
        counts.release()
        return found.reshape(polygons, len(SHADED)).astype(np.int64)

    def _submit(self, mesh: BoundMesh) -> None:
        mesh.draw()

    def close(self) -> None:
        """Free the program."""
        self.program.release()


class TallyInOrder(Tally):
    """For devices whose lanes cannot tell helpers: remembers the last triangle of each quad."""

    shader = "count_in_order.frag"

    def count(self, target: Target, frame: Frame, triangles: Triangles) -> NDArray[np.int64]:
        """Return (p, 4) counts in the order of SHADED."""
        columns, rows = (frame.width + 1) // 2, (frame.height + 1) // 2
        last = self.context.buffer(np.zeros(columns * rows, np.uint32))
        last.bind_to_storage_buffer(1)
        self.program["columns"] = columns
        counts = super().count(target, frame, triangles)
        last.release()
        whole = counts[:, 3].copy()
        counts[:, 2] = 4 * counts[:, 1] - counts[:, 0]
        counts[:, 3] = counts[:, 1] - whole
        return counts

    def _submit(self, mesh: BoundMesh) -> None:
        # One draw a triangle: softpipe draws nothing where a shader asks for gl_PrimitiveID.
        mesh.begin()
        for number in range(mesh.upload.triangles):
            self.program["triangle"] = number + 1
            mesh.vertices.render(vertices=3, first=3 * number)


def open_tally(owner: Context, *, deep: bool = False) -> Tally:
    """Return a way of counting that is right on the device, judged by known triangles.

    deep : with a depth test before shading

    Raises
    ------
    NoRasteriser
        if there is none
    """
    kinds = [Tally, TallyInOrder] if owner.strings()["renderer"] in IN_ORDER else [Tally]
    for kind in kinds:
        tally = kind(owner, deep=deep)
        # A triangle that covers nothing but pixel (3, 3), the last lane of its quad.
        alone = bare_frame(8, LAST_LANE), np.array([[0, 1, 2]], np.int32)
        probe, expected = _deep_probe() if deep else (alone, [[1, 1, 3, 1]])
        if tally.count(owner.target(8, 8, deep=deep), *probe).tolist() == expected:
            return tally
        tally.close()
    if deep:
        raise NoRasteriser(
            "the OpenGL driver does not test depth before it shades, or does not tell lanes of it; "
            "choose another device, or depth=none"
        )
    raise NoRasteriser("the OpenGL driver does not tell a quad's lanes which of them are helpers")


def _deep_probe() -> tuple[tuple[Frame, Triangles], list[list[int]]]:
    """Return a triangle like it, and behind it a large one, of which it hides one pixel."""
    whole = np.array([[0, 0], [2048, 0], [0, 2048]], np.int32)
    frame = bare_frame(8, np.concatenate([LAST_LANE, whole]), 3)
    triangles = np.arange(6, dtype=np.int32).reshape(2, 3)
    count = np.arange(3)
    viewing = Viewing(
        pixels=8,
        names=("",),
        points=frame.points,
        depths=np.repeat(np.array([1 << 22, 1 << 23], np.int32), 3),
        offsets=frame.offsets,
        ring_ends=frame.ring_ends,
        source=count[:2],
        first=np.array([0, 2]),
        given=(),
        rest={},
        ranks=count,
    )
    frame = replace(frame, tiles=viewing.first, viewing=viewing)
    exact = visible(frame, triangles)
    assert exact["fragments"].tolist() == [1, 27]
    return (frame, triangles), np.stack([exact[name] for name in SHADED], axis=1).tolist()
