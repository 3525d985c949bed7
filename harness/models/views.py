"""Exact counters of a model's front faces in views from 24 directions, without a depth test.

The camera looks at the centre, in perspective. Vertices are snapped to 1/256 px, and back faces are
culled as on a GPU. Without a depth test, hidden front faces are shaded as well. Coordinates are
computed by scalar operations in a fixed order, so that all machines give equal coordinates, unlike
matrix products of a library.
"""

from collections.abc import Callable, Sequence
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.models.flat_faces import Floats, Ints, ModelMesh
from harness.rasterisers.reference import count_per_triangle

VIEWS = 24
PIXELS = (256, 1024)  # default sides of the square viewport
DISTANCE = 3.0  # of the camera from the centre, in radii of the model

_STEPS_PER_PIXEL = 256.0
_CHUNK_TRIANGLES = 1 << 18


class DrawnPart(NamedTuple):
    """A part with old and new triangles: mesh, new triangles (m, 3), (4, 4) placements."""

    mesh: ModelMesh
    triangles: Ints
    placements: tuple[Floats, ...]


class ViewCounts(NamedTuple):
    """Sums over all views at a size: (helper lanes, quads) before and after."""

    pixels: int
    before: tuple[int, ...]
    after: tuple[int, ...]


class BoundingSphere(NamedTuple):
    """Bounding sphere of all drawn points, which every view contains."""

    middle: Floats
    radius: float


def list_integer_directions() -> Ints:
    """Return the vector (1, 2, 3) in all 24 rotations of a cube; the first 4, 8, ... sum to 0."""
    rotated = []
    for order in permutations(range(3)):
        parity = np.linalg.det(np.eye(3)[list(order)])
        for signs in product((1, -1), repeat=3):
            if parity * np.prod(signs) > 0:
                rotated.append(np.array([1, 2, 3])[list(order)] * signs)
    return np.array(rotated)


def list_directions() -> Floats:
    """Return `list_integer_directions` as unit vectors (24, 3)."""
    return np.asarray(list_integer_directions() / np.sqrt(14.0))


def count_views(
    parts: list[DrawnPart],
    sizes: Sequence[int] = PIXELS,
    tick: Callable[[int], None] = lambda _: None,
) -> list[ViewCounts]:
    """Count helper lanes and quads of front faces at each size; [] if no part has an extent."""
    points: list[Floats] = []
    sets: tuple[list[Ints], ...] = ([], [], [])  # unchanged, old, new triangles
    count = 0
    for part in parts:
        same = (part.triangles == part.mesh.triangles).all(axis=1)
        rows = part.mesh.triangles[same], part.mesh.triangles[~same], part.triangles[~same]
        for matrix in part.placements:
            # A reflection reverses the orientation of triangles.
            order = [0, 2, 1] if np.linalg.det(matrix[:3, :3]) < 0 else [0, 1, 2]
            for triangle_set, triangles in zip(sets, rows, strict=True):
                triangle_set.append(triangles[:, order] + count)
            points.append(transform_points(part.mesh.positions, matrix))
            count += len(points[-1])
    if not points:
        return []
    placements, world = len(points), np.concatenate(points)
    unchanged, old, new = map(np.concatenate, sets)
    sphere = find_bounding_sphere([world[np.concatenate([unchanged, old]).reshape(-1)]])
    if sphere is None:
        return []
    local = (world - sphere.middle) / sphere.radius
    sums = np.zeros((len(sizes), 2, 2), dtype=np.int64)
    for number, direction in enumerate(list_directions()):
        tick(placements * number // VIEWS)
        flat, _ = project_points(local, direction)
        for pixels, size_sums in zip(sizes, sums, strict=True):
            grid = np.rint(np.nan_to_num(flat) * (pixels * _STEPS_PER_PIXEL)).astype(np.int32)
            shared, before, after = (
                _count_front_faces(grid, triangles) for triangles in (unchanged, old, new)
            )
            size_sums += [shared + before, shared + after]
    return [
        ViewCounts(pixels, *map(tuple, size_sums))
        for pixels, size_sums in zip(sizes, sums.tolist(), strict=True)
    ]


def transform_points(positions: Floats, matrix: Floats) -> Floats:
    """Transform positions (n, 3) by a matrix (4, 4)."""
    return np.stack([_dot(positions, row) + row[3] for row in matrix[:3]], axis=1)


def find_bounding_sphere(placed_points: Sequence[Floats]) -> BoundingSphere | None:
    """Return the bounding sphere of finite points (n, 3), or None for points without extent."""
    points = np.concatenate([np.empty((0, 3)), *placed_points])
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0 or not np.ptp(points, axis=0).any():
        return None
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    off = points - middle
    return BoundingSphere(middle, float(np.sqrt((off * off).sum(axis=1).max())))


def project_points(
    local: Floats, direction: Floats, distance: float = DISTANCE
) -> tuple[Floats, Floats]:
    """Project points (n, 3) of the unit sphere; return (n, 2) in 0..1, y up, and distances (n,)."""
    x, y, z = direction.tolist()
    level = float(np.sqrt(x * x + y * y))
    right = np.array([-y / level, x / level, 0.0])
    up = np.array([-z * right[1], z * right[0], x * right[1] - y * right[0]])
    distances = distance - _dot(local, direction)
    widest = 1.0 / np.sqrt(distance**2 - 1.0)  # tangent of half the angle that the sphere subtends
    sides = [_dot(local, axis) / (distances * widest) for axis in (right, up)]
    return (np.stack(sides, axis=1) + 1.0) / 2, distances


def _dot(points: Floats, axis: Floats) -> Floats:
    products = points[:, 0] * axis[0] + points[:, 1] * axis[1] + points[:, 2] * axis[2]
    return np.asarray(products)


def _count_front_faces(grid: NDArray[np.int32], triangles: Ints) -> Ints:
    """Return (2,) helper lanes and quads of the triangles that face the camera."""
    counted = np.zeros(2, dtype=np.int64)
    for part in np.split(triangles, range(_CHUNK_TRIANGLES, len(triangles), _CHUNK_TRIANGLES)):
        a, b, c = np.moveaxis(grid[part].astype(np.int64), 1, 0)
        doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
        counters = count_per_triangle(grid, np.ascontiguousarray(part[doubled > 0], dtype=np.int32))
        counted += [counters["helper_lanes"].sum(), counters["quads"].sum()]
    return counted
