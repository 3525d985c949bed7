"""OpenGL that does more fragment work for one drawing: a regression of a known size.

Counters do not see it, so only times can tell.
"""

import os

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.rasterisers.base import Device, Drawing, Options, Triangles
from harness.rasterisers.opengl import OpenGL

EXTRA = "HEAVY_EXTRA"
"""Environment variable: the share of a drawing's triangles that is drawn twice, e.g. 0.1."""

WHICH = "HEAVY_DRAWING"
"""Environment variable: which triangulation of a run, in the order of its plan, does more work."""

SCENE = 1000
"""The self-test and the reference are smaller than this many triangles, a scene is not."""


class HeavyOpenGL(OpenGL):
    """Draws some triangles of the chosen drawing twice."""

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self._met: list[int] = []

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        if len(triangles) >= SCENE:
            # Each epoch prepares the same arrays again, in another order: known by where they lie.
            where = triangles.__array_interface__["data"][0]
            if where not in self._met:
                self._met.append(where)
            if self._met.index(where) == int(os.environ.get(WHICH, "0")):
                share = float(os.environ.get(EXTRA, "0"))
                triangles = np.concatenate([triangles, some(frame, triangles, share)])
        return super()._prepare(frame, triangles, options)


def some(frame: Frame, triangles: Triangles, share: float) -> NDArray[np.int32]:
    """Choose `share` of the triangles, large and small alike, so `share` of the fragments too."""
    if share <= 0:
        return triangles[:0]
    corners = frame.points[triangles].astype(np.float64)
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    by_area = np.argsort(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), kind="stable")
    middle = 0.5 / share
    return triangles[by_area[np.arange(middle, len(triangles), 1 / share).astype(int)]]
