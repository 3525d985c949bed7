"""A frame's triangles on the device."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from harness.frame import SUBPIXEL, Frame
from harness.rasterisers.base import Triangles
from harness.rasterisers.opengl.context import Context, Target


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
            self.upload.owner.clear_depths()

    def draw_rows(self, rows: slice, instances: int = 1) -> None:
        """Submit some of the triangles, `instances` times in one call."""
        self.begin()
        count = 3 * (rows.stop - rows.start)
        self.vertices.render(vertices=count, first=3 * rows.start, instances=instances)

    def close(self) -> None:
        """Free the buffers."""
        self.upload.close()
        self.vertices.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def batches(frame: Frame, triangles: Triangles, most: int = 2**32) -> list[Triangles]:
    """Split `triangles` so that no batch shades `most` lanes, that no counter of 32 bits wraps.

    With a depth test a batch is a view, of at most 2^28 pixels.

    A triangle touches at most the quads of its bounding box.
    """
    corners = frame.points[triangles].astype(np.int64)
    sides = (corners.max(axis=1) - corners.min(axis=1)) // SUBPIXEL + 4
    lanes: NDArray[np.int64] = np.cumsum(sides.prod(axis=1))
    if frame.depths is not None:  # a view hides only what is drawn in the same batch
        return [triangles[rows] for rows in frame.draws(triangles)]
    if not len(lanes) or lanes[-1] < most:
        return [triangles]
    return np.split(triangles, np.flatnonzero(np.diff(lanes // (most // 2))) + 1)
