"""What a model costs in views from all around: exact counters of its front faces, without depth.

The camera looks at the middle from 24 directions, in perspective. Vertices are projected to the
grid of 1/256 px, and triangles are culled by their winding, as a GPU does it. There is no depth
test: every front face is shaded, also where another one hides it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.models.mesh import Mesh
from harness.rasterisers.reference import predict

VIEWS = 24
PIXELS = (256, 1024)
"""Sizes at which a model is looked at: it fills a square of so many pixels."""

DISTANCE = 3.0
"""Of the camera from the middle, in radii of the model."""

_UNITS = 256.0
_AT_A_TIME = 1 << 18


class Drawn(NamedTuple):
    """A part before and after: its mesh, new triangles (m, 3), matrices (4, 4) that place it."""

    mesh: Mesh
    triangles: NDArray[np.int64]
    placements: tuple[NDArray[np.float64], ...]


@dataclass
class Seen:
    """Sums over all views at one size."""

    pixels: int
    lanes_before: int = 0
    lanes_after: int = 0
    quads_before: int = 0
    quads_after: int = 0


def directions() -> NDArray[np.float64]:
    """Return (24, 3) unit vectors: (1, 2, 3) turned by all rotations of a cube."""
    found = []
    for order in permutations(range(3)):
        parity = np.linalg.det(np.eye(3)[list(order)])
        for signs in product((1, -1), repeat=3):
            if parity * np.prod(signs) > 0:
                found.append(np.array([1.0, 2.0, 3.0])[list(order)] * signs)
    return np.array(found) / np.sqrt(14.0)


def look(parts: list[Drawn], sizes: Sequence[int] = PIXELS) -> list[Seen]:
    """Count parts from all directions, at each size; [] where nothing has a place in space."""
    worlds = [
        (part, placed(part.mesh.positions, matrix), np.linalg.det(matrix[:3, :3]) < 0)
        for part in parts
        for matrix in part.placements
    ]
    used = [world[part.mesh.triangles.reshape(-1)] for part, world, _ in worlds]
    points = np.concatenate([np.empty((0, 3)), *used])
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0 or not np.ptp(points, axis=0).any():
        return []
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - middle, axis=1).max())
    result = [Seen(pixels) for pixels in sizes]
    for part, world, mirrored in worlds:
        local = (world - middle) / radius
        same = (part.triangles == part.mesh.triangles).all(axis=1)
        for direction in directions():
            flat = _projected(local, direction)
            for seen in result:
                grid = np.rint(np.nan_to_num(flat) * (seen.pixels * _UNITS)).astype(np.int32)
                kept = _count(grid, part.mesh.triangles[same], mirrored)
                old = _count(grid, part.mesh.triangles[~same], mirrored)
                new = _count(grid, part.triangles[~same], mirrored)
                seen.lanes_before += kept[0] + old[0]
                seen.lanes_after += kept[0] + new[0]
                seen.quads_before += kept[1] + old[1]
                seen.quads_after += kept[1] + new[1]
    return result


def placed(positions: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return positions (n, 3) moved by a matrix (4, 4)."""
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(positions @ matrix[:3, :3].T + matrix[:3, 3])


def _projected(local: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) in 0..1: points within the unit sphere, seen from `direction`, y up."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    up = np.cross(direction, right)
    away = DISTANCE - local @ direction
    widest = 1.0 / np.sqrt(DISTANCE**2 - 1.0)  # the tangent of the sphere's half angle
    with np.errstate(invalid="ignore", divide="ignore"):
        flat = np.stack([local @ right, local @ up], axis=1) / (away * widest)[:, None]
    return np.asarray((flat + 1.0) / 2)


def _count(
    grid: NDArray[np.int32], triangles: NDArray[np.int64], mirrored: bool
) -> tuple[int, int]:
    """Return helper lanes and quads of the triangles that face the camera."""
    lanes = quads = 0
    for part in np.split(triangles, range(_AT_A_TIME, len(triangles), _AT_A_TIME)):
        a, b, c = np.moveaxis(grid[part].astype(np.int64), 1, 0)
        doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        front = doubled < 0 if mirrored else doubled > 0
        found = predict(grid, np.ascontiguousarray(part[front], dtype=np.int32))
        lanes += int(found["helper_lanes"].sum())
        quads += int(found["quads"].sum())
    return lanes, quads
