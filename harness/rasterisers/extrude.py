"""A frame in three dimensions, for renderers of scenes.

As a city, each polygon's triangulation is a roof, with walls under its rings. The views of a model
have depths already.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.frame import SUBPIXEL, Frame
from harness.rasterisers.base import Triangles
from harness.rasterisers.depth import DEEPEST
from harness.rasterisers.palette import colours

LOWEST, TALLEST = 0.005, 0.035
"""Heights of roofs, as shares of the viewport's width."""

GOLDEN = 0.6180339887498949
WALL_SHADE = 0.55


@dataclass(frozen=True)
class Solid:
    """Roofs and walls in pixels, z up: positions (v, 3), colours (v, 4) in 0..1, faces (f, 3)."""

    positions: NDArray[np.float32]
    colours: NDArray[np.float32]
    faces: NDArray[np.uint32]


def extrude(frame: Frame, triangles: Triangles) -> Solid:
    """Raise each polygon to a height of its own; the roof's triangles keep their order."""
    owner = np.repeat(np.arange(len(frame.offsets) - 1), np.diff(frame.offsets)).astype(np.int32)
    heights = (LOWEST + (TALLEST - LOWEST) * ((owner * GOLDEN) % 1.0)) * frame.width
    plan = frame.points / SUBPIXEL
    roof = np.column_stack([plan, heights])
    ground = np.column_stack([plan, np.zeros(len(plan))])
    paint = colours(owner).view(np.uint8).reshape(-1, 4) / 255
    dark = paint * [WALL_SHADE, WALL_SHADE, WALL_SHADE, 1.0]

    # A wall's corners are its own: they have its colour, not the roof's.
    following = next_in_ring(frame)
    first = 2 * len(plan) + np.arange(len(plan))
    top, bottom = len(plan) + np.arange(len(plan)), first
    walls = np.concatenate(
        [
            np.column_stack([bottom, bottom[following], top[following]]),
            np.column_stack([bottom, top[following], top]),
        ]
    )
    return Solid(
        positions=np.concatenate([roof, roof, ground]).astype(np.float32),
        colours=np.concatenate([paint, dark, dark]).astype(np.float32),
        faces=np.concatenate([triangles, walls]).astype(np.uint32),
    )


def projected(frame: Frame, triangles: Triangles) -> Solid:
    """Return triangles (m, 3) of a model's views where they are projected, z from 0 down to -1."""
    assert frame.depths is not None
    used, faces = np.unique(triangles, return_inverse=True)
    if not len(used):
        used, faces = np.zeros(1, np.int64), np.zeros(3, np.int64)  # no renderer takes nothing
    points = np.column_stack([frame.points[used] / SUBPIXEL, frame.depths[used] / -DEEPEST])
    owner = np.searchsorted(frame.offsets, used, side="right").astype(np.int32) - 1
    paint = colours(owner.astype(np.int32)).view(np.uint8).reshape(-1, 4) / 255
    return Solid(
        points.astype(np.float32), paint.astype(np.float32), faces.reshape(-1, 3).astype(np.uint32)
    )


def next_in_ring(frame: Frame) -> NDArray[np.int64]:
    """Return (n,) for each of the frame's points the next one in its ring."""
    following = np.arange(1, len(frame.points) + 1, dtype=np.int64)
    following[frame.ring_ends - 1] = np.concatenate([[0], frame.ring_ends[:-1]])
    return following
