"""OpenGL with more fragment work for one drawing, but equal counters: only times can reveal it."""

import os

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame
from harness.rasterisers.base import Device, Drawing, Options, Triangles
from harness.rasterisers.opengl import OpenGL

EXTRA = "HEAVY_EXTRA"
"""Environment variable: the share of a drawing's triangles that is drawn twice, e.g. 0.1."""

WHICH = "HEAVY_DRAWING"
"""Environment variable: index in the plan of the triangulation with additional work."""

MIN_SCENE_TRIANGLES = 1000
"""The self-test and the reference draw have fewer triangles, and a scene has more."""


class HeavyOpenGL(OpenGL):
    """Draws a share of the triangles of the selected drawing twice."""

    def __init__(self, device: Device) -> None:
        super().__init__(device)
        self._addresses: list[int] = []

    def _prepare(self, frame: Frame, triangles: Triangles, options: Options) -> Drawing:
        if len(triangles) >= MIN_SCENE_TRIANGLES:
            # Each epoch prepares the same arrays in another order; addresses identify the arrays.
            address = triangles.__array_interface__["data"][0]
            if address not in self._addresses:
                self._addresses.append(address)
            if self._addresses.index(address) == int(os.environ.get(WHICH, "0")):
                share = float(os.environ.get(EXTRA, "0"))
                triangles = np.concatenate([triangles, select_share(frame, triangles, share)])
        return super()._prepare(frame, triangles, options)


def select_share(frame: Frame, triangles: Triangles, share: float) -> NDArray[np.int32]:
    """Return `share` of the triangles, of all sizes, and therefore `share` of the fragments."""
    if share <= 0:
        return triangles[:0]
    vertices = frame.points[triangles].astype(np.float64)
    a, b = vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0]
    by_area = np.argsort(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), kind="stable")
    middle = 0.5 / share
    return triangles[by_area[np.arange(middle, len(triangles), 1 / share).astype(int)]]
