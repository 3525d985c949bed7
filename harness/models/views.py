"""What a model costs in views from all around: exact counters of its front faces, without depth.

The camera looks at the middle from 24 directions, in perspective. Vertices are projected to the
grid of 1/256 px, and triangles are culled by their winding, as a GPU does it. There is no depth
test: every front face is shaded, also where another one hides it. Coordinates are sums, products,
quotients and square roots of single numbers, in a fixed order, so that they are the same on every
machine; a library's product of matrices is not.
"""

from collections.abc import Callable, Sequence
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.models.flat_faces import Mesh
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


class Seen(NamedTuple):
    """Sums over all views at one size: (helper lanes, quads) before and after."""

    pixels: int
    before: tuple[int, ...]
    after: tuple[int, ...]


class Ball(NamedTuple):
    """The ball round all that is drawn, which a view shows whole."""

    middle: NDArray[np.float64]
    radius: float


def ways() -> NDArray[np.int64]:
    """Return (24, 3), the ways to the camera: (1, 2, 3) turned by all rotations of a cube.

    The first four, eight, ... of them add up to nothing, too.
    """
    found = []
    for order in permutations(range(3)):
        parity = np.linalg.det(np.eye(3)[list(order)])
        for signs in product((1, -1), repeat=3):
            if parity * np.prod(signs) > 0:
                found.append(np.array([1, 2, 3])[list(order)] * signs)
    return np.array(found)


def directions() -> NDArray[np.float64]:
    """Return `ways` as (24, 3) unit vectors."""
    return np.asarray(ways() / np.sqrt(14.0))


def look(
    parts: list[Drawn],
    sizes: Sequence[int] = PIXELS,
    tick: Callable[[int], None] = lambda _: None,
) -> list[Seen]:
    """Count parts from all directions, at each size; [] where nothing has a place in space.

    tick : told how many places of parts were looked at
    """
    points: list[NDArray[np.float64]] = []
    kinds: tuple[list[NDArray[np.int64]], ...] = ([], [], [])
    count = 0
    for part in parts:
        same = (part.triangles == part.mesh.triangles).all(axis=1)
        rows = part.mesh.triangles[same], part.mesh.triangles[~same], part.triangles[~same]
        for matrix in part.placements:
            # In a mirror image triangles turn the other way.
            turned = [0, 2, 1] if np.linalg.det(matrix[:3, :3]) < 0 else [0, 1, 2]
            for kind, each in zip(kinds, rows, strict=True):
                kind.append(each[:, turned] + count)
            points.append(placed(part.mesh.positions, matrix))
            count += len(points[-1])
    if not points:
        return []
    places, world = len(points), np.concatenate(points)
    kept, old, new = map(np.concatenate, kinds)
    ball = ball_of([world[np.concatenate([kept, old]).reshape(-1)]])
    if ball is None:
        return []
    local = (world - ball.middle) / ball.radius
    sums = np.zeros((len(sizes), 2, 2), dtype=np.int64)
    for number, direction in enumerate(directions()):
        tick(places * number // VIEWS)
        flat, _ = projected(local, direction)
        for pixels, own in zip(sizes, sums, strict=True):
            grid = np.rint(np.nan_to_num(flat) * (pixels * _UNITS)).astype(np.int32)
            always, before, after = (_count(grid, each) for each in (kept, old, new))
            own += [always + before, always + after]
    return [
        Seen(pixels, *map(tuple, own)) for pixels, own in zip(sizes, sums.tolist(), strict=True)
    ]


def placed(positions: NDArray[np.float64], matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return positions (n, 3) moved by a matrix (4, 4)."""
    return np.stack([_along(positions, row) + row[3] for row in matrix[:3]], axis=1)


def ball_of(placed_points: Sequence[NDArray[np.float64]]) -> Ball | None:
    """Return the ball round points (n, 3) that are numbers; None if they have no extent."""
    points = np.concatenate([np.empty((0, 3)), *placed_points])
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0 or not np.ptp(points, axis=0).any():
        return None
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    off = points - middle
    return Ball(middle, float(np.sqrt((off * off).sum(axis=1).max())))


def projected(
    local: NDArray[np.float64], direction: NDArray[np.float64], distance: float = DISTANCE
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (n, 2) in 0..1, y up, of points within the unit sphere, and how far away each is.

    direction : unit vector to the camera, whose distance is in radii
    """
    x, y, z = direction.tolist()
    level = float(np.sqrt(x * x + y * y))
    right = np.array([-y / level, x / level, 0.0])
    up = np.array([-z * right[1], z * right[0], x * right[1] - y * right[0]])
    away = distance - _along(local, direction)
    widest = 1.0 / np.sqrt(distance**2 - 1.0)  # the tangent of the sphere's half angle
    sides = [_along(local, axis) / (away * widest) for axis in (right, up)]
    return (np.stack(sides, axis=1) + 1.0) / 2, away


def _along(points: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) scalar products of points (n, 3) with an axis."""
    products = points[:, 0] * axis[0] + points[:, 1] * axis[1] + points[:, 2] * axis[2]
    return np.asarray(products)


def _count(grid: NDArray[np.int32], triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (2,) helper lanes and quads of the triangles that face the camera."""
    counted = np.zeros(2, dtype=np.int64)
    for part in np.split(triangles, range(_AT_A_TIME, len(triangles), _AT_A_TIME)):
        a, b, c = np.moveaxis(grid[part].astype(np.int64), 1, 0)
        doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        found = predict(grid, np.ascontiguousarray(part[doubled > 0], dtype=np.int32))
        counted += [found["helper_lanes"].sum(), found["quads"].sum()]
    return counted
