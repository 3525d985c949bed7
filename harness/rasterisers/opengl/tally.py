"""The counting pass: fragments, quads, helper lanes, partial quads of each polygon, by atomics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from harness.errors import NoRasteriser
from harness.frame import Frame, bare_frame
from harness.rasterisers.base import Triangles
from harness.rasterisers.opengl.buffers import BoundMesh
from harness.rasterisers.opengl.context import Context, Target
from harness.rasterisers.reference import SHADED, visible
from scenes.scene import Viewing

LAST_LANE = np.array([[800, 800], [1000, 800], [800, 1000]], np.int32)
"""A triangle that covers nothing but pixel (3, 3)."""

KEEP_ALPHA = (True, True, True, False)
WRITE_ALL = (True, True, True, True)

IN_ORDER = ("softpipe",)
"""Renderers that finish a triangle before they begin the next."""


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
        with BoundMesh(self.context, self.program, target, frame, triangles) as mesh:
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
        probe, expected = _deep_probe() if deep else _probe()
        if tally.count(owner.target(8, 8, deep=deep), *probe).tolist() == expected:
            return tally
        tally.close()
    if deep:
        raise NoRasteriser(
            "the OpenGL driver does not test depth before it shades, or does not tell lanes of it; "
            "choose another device, or depth=none"
        )
    raise NoRasteriser("the OpenGL driver does not tell a quad's lanes which of them are helpers")


Probe = tuple[tuple[Frame, Triangles], list[list[int]]]
"""A frame and its triangles, and what is counted of each polygon."""


def _probe() -> Probe:
    """Return a triangle that covers nothing but pixel (3, 3), the last lane of its quad."""
    return (bare_frame(8, LAST_LANE), np.array([[0, 1, 2]], np.int32)), [[1, 1, 3, 1]]


def _deep_probe() -> Probe:
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
