"""The counting pass: fragments, quads and helper lanes of each polygon, by atomics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriser
from harness.frame import Frame, bare_frame
from harness.rasterisers.base import Triangles
from harness.rasterisers.opengl.buffers import BoundMesh
from harness.rasterisers.opengl.context import Context, Target

COUNTED = ("fragments", "quads", "helper_lanes")

KEEP_ALPHA = (True, True, True, False)
WRITE_ALL = (True, True, True, True)

IN_ORDER = ("softpipe",)
"""Renderers that finish a triangle before they begin the next."""


class Tally:
    """Counts in one draw, each quad through the lane that is its first covered one."""

    shader = "count.frag"

    def __init__(self, owner: Context) -> None:
        self.context = owner
        self.program = owner.program("draw.vert", self.shader)

    def count(self, target: Target, frame: Frame, triangles: Triangles) -> NDArray[np.int64]:
        """Return (p, 3) counts in the order of COUNTED."""
        polygons = len(frame.offsets) - 1
        counts = self.context.buffer(np.zeros(3 * polygons, np.uint32))
        counts.bind_to_storage_buffer(0)
        # llvmpipe forgets what it has collected for a tile, storage writes and all, when an
        # opaque triangle covers the tile; a draw that keeps alpha is not opaque to it.
        target.framebuffer.color_mask = KEEP_ALPHA
        with BoundMesh(self.context, self.program, target, frame, triangles) as mesh:
            mesh.bind()
            self._submit(mesh)
        target.framebuffer.color_mask = WRITE_ALL
        self.context.ctx.memory_barrier()
        found = np.frombuffer(counts.read(), np.uint32)[: 3 * polygons]
        counts.release()
        return found.reshape(polygons, 3).astype(np.int64)

    def _submit(self, mesh: BoundMesh) -> None:
        mesh.draw()

    def close(self) -> None:
        """Free the program."""
        self.program.release()


class TallyInOrder(Tally):
    """For devices whose lanes cannot tell helpers: remembers the last triangle of each quad."""

    shader = "count_in_order.frag"

    def count(self, target: Target, frame: Frame, triangles: Triangles) -> NDArray[np.int64]:
        """Return (p, 3) counts in the order of COUNTED."""
        columns, rows = (frame.width + 1) // 2, (frame.height + 1) // 2
        last = self.context.buffer(np.zeros(columns * rows, np.uint32))
        last.bind_to_storage_buffer(1)
        self.program["columns"] = columns
        counts = super().count(target, frame, triangles)
        last.release()
        counts[:, 2] = 4 * counts[:, 1] - counts[:, 0]
        return counts

    def _submit(self, mesh: BoundMesh) -> None:
        # One draw a triangle: softpipe draws nothing where a shader asks for gl_PrimitiveID.
        for number in range(mesh.upload.triangles):
            self.program["triangle"] = number + 1
            mesh.vertices.render(vertices=3, first=3 * number)


def open_tally(owner: Context) -> Tally:
    """Return a way of counting that is right on the device, judged by one known triangle.

    Raises
    ------
    NoRasteriser
        if there is none
    """
    kinds = [Tally, TallyInOrder] if owner.strings()["renderer"] in IN_ORDER else [Tally]
    for kind in kinds:
        tally = kind(owner)
        if tally.count(owner.target(8, 8), *_probe()).tolist() == [[1, 1, 3]]:
            return tally
        tally.close()
    raise NoRasteriser("the OpenGL driver does not tell a quad's lanes which of them are helpers")


def _probe() -> tuple[Frame, Triangles]:
    """Return a triangle that covers nothing but pixel (3, 3), the last lane of its quad."""
    points = np.array([[800, 800], [1000, 800], [800, 1000]], np.int32)
    return bare_frame(8, points), np.array([[0, 1, 2]], np.int32)
