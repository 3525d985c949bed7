"""Software rasterisers in compute shaders: scans of bounding boxes, and of rows and spans.

`bounding-box` tests each pixel centre in a triangle's bounding box, as tinyrenderer, the analyser
of meshoptimizer and the software rasteriser of Nanite (Karis, Stubbe, Wihlidal, SIGGRAPH 2021) do;
the criterion A ("overdraw") measures this work. `scanline` computes each row's span by division.

One workgroup draws a triangle, several draw a huge one; the invocations of a workgroup share the
box's pixels or rows.
"""

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.grid import SUBPIXEL
from harness.rasterisers import context
from harness.rasterisers.base import (
    Counters,
    Device,
    Drawing,
    Options,
    Sample,
    Triangles,
    split_batches,
)
from harness.rasterisers.context import Context
from harness.rasterisers.opengl import GLRasteriser

MAX_GROUPS = 65535  # maximum workgroups in a dimension of a dispatch on every device
LANES = 32  # invocations of a workgroup
JOB_PIXELS = 16384 * LANES  # maximum; llvmpipe silently ends a loop after 65,535 rounds


class BoundingBox(GLRasteriser):
    """Rasteriser that tests every pixel centre of each triangle's bounding box."""

    name = "bounding-box"
    counters: ClassVar[tuple[str, ...]] = ("bbox_tests", "hits")
    source: ClassVar[str] = "bounding_box.comp"
    supports_scissor = True

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self.context.require_extensions(*context.COMPUTE_EXTENSIONS)
        sources = ("triangle", self.source)
        self._draw_program = self.context.build_compute_shader(*sources)
        self._count_program = self.context.build_compute_shader(*sources, defines=["COUNT"])
        self.context.raise_pending_error("building the shaders")

    def _draw_and_count(self, frame: Frame, triangles: Triangles, options: Options) -> Counters:
        self.context.activate()
        totals = np.zeros((len(frame.grid), len(self.counters)), np.int64)
        for part in split_batches(frame, triangles):
            counts = self.context.create_buffer(np.zeros(totals.size, np.uint32))
            counts.bind_to_storage_buffer(4)
            _DispatchedJobs(self.context, self._count_program, frame, part).run()
            self.ctx.memory_barrier()
            totals += np.frombuffer(counts.read(), np.uint32)[: totals.size].reshape(totals.shape)
        self.context.raise_pending_error("counting")
        return {name: totals[:, k].copy() for k, name in enumerate(self.counters)}

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        self.context.activate()
        return _DispatchedJobs(self.context, self._draw_program, frame, triangles)


class Scanline(BoundingBox):
    """Rasteriser that computes the span of covered pixels in each row of a triangle."""

    name = "scanline"
    counters: ClassVar[tuple[str, ...]] = ("rows", "hits")
    source: ClassVar[str] = "scanline.comp"


class _DispatchedJobs(Drawing):
    """Triangles on the device, divided into jobs: rows with at most JOB_PIXELS pixels in all."""

    def __init__(self, owner: Context, program: Any, frame: Frame, triangles: Triangles) -> None:
        jobs = split_into_jobs(frame, triangles)
        self.context = owner
        self.program = program
        self.size = (frame.width, frame.height)
        self.number = len(jobs)
        self.window = tuple(frame.window.tolist())
        self.buffers = (*owner.upload(frame, triangles), owner.create_buffer(jobs))

    def run(self) -> None:
        if not self.number:
            return
        for binding, buffer in enumerate(self.buffers):
            buffer.bind_to_storage_buffer(binding)
        self.program["number"] = self.number
        self.program["window"] = self.window
        columns = min(self.number, MAX_GROUPS)
        self.program.run(columns, -(-self.number // columns))

    def sample(self, repeats: int) -> Sample:
        # Each dispatch waits for the previous dispatch.
        self.context.activate()
        self.context.get_picture(*self.size).bind_to_image(0, read=False, write=True)
        return self.context.time_draws(repeats, self.run, self.context.ctx.memory_barrier)


def split_into_jobs(frame: Frame, triangles: Triangles) -> NDArray[np.int32]:
    """Divide triangles' bounding boxes into jobs (k, 4): triangle, first row, last row, padding."""
    corners = frame.points[triangles]
    first = (corners.min(axis=1) + SUBPIXEL // 2 - 1) // SUBPIXEL
    last = (corners.max(axis=1) - SUBPIXEL // 2) // SUBPIXEL
    width, height = np.maximum(last - first + 1, 0).T
    rows = np.maximum(JOB_PIXELS // np.maximum(width, 1), LANES)
    pieces = -(-height // rows)
    triangle = np.repeat(np.arange(len(triangles)), pieces)
    piece = np.arange(len(triangle)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    start = first[triangle, 1] + piece * rows[triangle]
    stop = np.minimum(start + rows[triangle] - 1, last[triangle, 1])
    return np.stack([triangle, start, stop, np.zeros_like(start)], axis=1).astype(np.int32)
