"""OpenGL on an EGL device: counted with atomics in one pass, timed in another."""

from __future__ import annotations

from functools import partial
from itertools import cycle
from typing import Any, ClassVar

import numpy as np

from harness.errors import NoRasteriser
from harness.frame import Frame
from harness.rasterisers.base import (
    Counters,
    Device,
    Drawing,
    Image,
    Options,
    Sample,
    Triangles,
    per_polygon,
)
from harness.rasterisers.opengl import context
from harness.rasterisers.opengl.buffers import BoundMesh, batches
from harness.rasterisers.opengl.context import Context, Target
from harness.rasterisers.opengl.gl import GLRasteriser
from harness.rasterisers.opengl.tally import Tally, open_tally
from harness.rasterisers.reference import SHADED, visible

STATISTICS = {
    "driver_vertices_submitted": 0x82EE,
    "driver_primitives_submitted": 0x82EF,
    "driver_vertex_invocations": 0x82F0,
    "driver_clipping_input": 0x82F6,
    "driver_clipping_output": 0x82F7,
    "driver_fragment_invocations": 0x82F4,
}
"""What ARB_pipeline_statistics_query reports: the driver's opinion, not a count of quads."""

BLOCK_LANES = 16
"""Lanes llvmpipe shades at once, a 4x4 block; it reports all of them as invocations."""


class OpenGL(GLRasteriser):
    """OpenGL 3.3 or later with storage buffers in fragment shaders, through EGL, no window."""

    name = "opengl"
    shades = True
    cuts = True
    deep = True
    counters: ClassVar[tuple[str, ...]] = (*SHADED, "samples_passed", *STATISTICS)

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        if self.context.integer(context.MAX_FRAGMENT_STORAGE_BLOCKS) < 1:
            raise NoRasteriser(f"{device.name} has no storage buffers in fragment shaders")
        self._draw = self.context.program("draw.vert", "draw.frag")
        self._tally = open_tally(self.context)
        self._statistics = (
            STATISTICS if "GL_ARB_pipeline_statistics_query" in self.ctx.extensions else {}
        )
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

    def _programs(self, frame: Frame) -> tuple[Any, Tally]:
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
        opinion = dict.fromkeys(["samples_passed", *self._statistics], 0)
        target = self._target(frame, options)
        _, tally = self._programs(frame)
        for part in batches(frame, triangles):
            totals += tally.count(target, frame, part)
            for name, value in self._ask(target, frame, part).items():
                opinion[name] += value
        self.context.check("counting")
        counters = {name: totals[:, k].copy() for k, name in enumerate(SHADED)}
        counters |= {name: np.array(value, np.int64) for name, value in opinion.items()}
        if frame.depths is not None:
            ties = visible(frame, triangles)["depth_ties"]
            counters["depth_ties"] = per_polygon(frame, triangles, ties)
        if "llvmpipe" in self.device.details["renderer"] and self._statistics:
            counters["driver_blocks"] = counters["driver_fragment_invocations"] // BLOCK_LANES
        return counters

    def _ask(self, target: Target, frame: Frame, triangles: Triangles) -> dict[str, int]:
        """Draw once, without counting: storage writes change what a driver may skip."""
        targets = {"samples_passed": context.SAMPLES_PASSED, **self._statistics}
        with (
            BoundMesh(self.context, self._programs(frame)[0], target, frame, triangles) as mesh,
            self.context.queries(len(targets)) as queries,
        ):
            mesh.bind()
            for number, kind in enumerate(targets.values()):
                queries.begin(number, kind)
            mesh.draw()
            for kind in targets.values():
                queries.end(kind)
            return {name: queries.result(number) for number, name in enumerate(targets)}

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        self.context.activate()
        target = self._target(frame, options)
        mesh = BoundMesh(self.context, self._programs(frame)[0], target, frame, triangles)
        return _Timed(self.context, mesh, options.work, self.device.software)

    def _image(self, frame: Frame, triangles: Triangles, options: Options) -> Image:
        self.context.activate()
        target = self._target(frame, options)
        target.framebuffer.scissor = None  # type: ignore[assignment]
        target.framebuffer.clear(0.0, 0.0, 0.0, 0.0)
        with BoundMesh(self.context, self._programs(frame)[0], target, frame, triangles) as mesh:
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
