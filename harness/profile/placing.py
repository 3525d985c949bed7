"""Draws of a profile: triangles with integer coordinates in 1/256 px, generated from a seed.

Only sums, products, floor divisions and shifts of integers below 2^53 are used, so that every
language, also that of a page, computes the same points. Directions are Pythagorean triples: a
rotation by (4, 3, 5) is exact except for one rounding at the end.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, make_bare_frame
from harness.grid import SUBPIXEL

Points = NDArray[np.int64]
Triangles = NDArray[np.int32]

SIDE = 1024  # width and height of the viewport of every draw, px

# Gap between boxes of shapes: no two share a pixel, although each is moved by less than 1 px.
GAP = 2 * SUBPIXEL

MARGIN = SUBPIXEL  # empty margin at each side of the viewport


@dataclass(frozen=True)
class Draw:
    """One draw of the design.

    kind : see the tables of `design` and `stage_draws`; name : description of the draw
    group : name of the draws that differ only in the terms that their kind isolates
    work : rounds of arithmetic of a fragment
    aspect, area : base / height, and area in px^2, of draws of the kind aspect; else 0
    """

    kind: str
    name: str
    group: str
    frame: Frame
    triangles: NDArray[np.int32]
    work: int = 0
    aspect: int = 0
    area: int = 0

    @property
    def checksum(self) -> int:
        """CRC-32 of the points, then the triangles, as little-endian 32-bit integers."""
        parts = (self.frame.points, self.triangles)
        return zlib.crc32(b"".join(np.ascontiguousarray(part, "<i4").tobytes() for part in parts))


def make_unshared_triangles(corners: NDArray[np.int32]) -> tuple[Frame, NDArray[np.int32]]:
    """Return a frame and triangles (m, 3) without shared vertices; corners : (m, 3, 2)."""
    rows = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return make_bare_frame(SIDE, corners.reshape(-1, 2)), rows


def make_jittered_mesh(
    across: int, along: int, side: int, numbers: NDArray[np.int64]
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return vertices (n, 2) and triangles (m, 3) of a mesh of squares from (4, 4) px.

    Each square of `side`/256 px is two triangles; triangles of a row follow each other in a strip.
    `numbers`, (across + 1) * (along + 1) hashes, move each vertex by less than half a side.
    """
    line = across + 1
    row, column = np.divmod(np.arange(line * (along + 1)), line)
    room = side // 2
    jitter = np.stack([numbers % room, numbers // SUBPIXEL % room], axis=-1)
    points = 4 * SUBPIXEL + np.stack([column, row], axis=-1) * side + jitter
    row, column = np.divmod(np.arange(across * along), across)
    corner = row * line + column
    up = corner + line
    halves = [np.stack([corner, corner + 1, up], -1), np.stack([corner + 1, up + 1, up], -1)]
    triangles = np.stack(halves, 1).reshape(-1, 3)
    return points.astype(np.int32), triangles.astype(np.int32)


class Direction(NamedTuple):
    """A rotation: (x, y) / length is its cosine and sine, all three integers."""

    x: int
    y: int
    length: int


LEVEL, STEEP = Direction(1, 0, 1), Direction(0, 1, 1)
SLANTED, DIAGONAL = Direction(12, 5, 13), Direction(21, 20, 29)
DIRECTIONS = (LEVEL, SLANTED, DIAGONAL, STEEP)  # rotations by 0, 22.6, 43.6 and 90 degrees

_MASK = np.uint64(0xFFFFFFFF)


def hash_numbers(seed: int, draw: int, count: int) -> NDArray[np.int64]:
    """Return `count` 32-bit hashes of the seed, the draw and each position.

    Multiplicative hashing as in D. E. Knuth ("The Art of Computer Programming", volume 3, section
    6.4), then two rounds of G. Marsaglia, "Xorshift RNGs", Journal of Statistical Software 8(14),
    2003.
    """
    position = np.arange(1, count + 1, dtype=np.uint64)
    start = (seed % (1 << 32) * 31 + draw * 65_599) % (1 << 32)
    value = ((position + np.uint64(start)) & _MASK) * np.uint64(2_654_435_761) & _MASK
    for _ in range(2):
        value ^= (value << np.uint64(13)) & _MASK
        value ^= value >> np.uint64(17)
        value ^= (value << np.uint64(5)) & _MASK
    return value.astype(np.int64)


def rotate(points: Points, direction: Direction) -> Points:
    """Return points (..., 2) rotated about the origin and rounded to integers."""
    x, y = points[..., 0], points[..., 1]
    half = direction.length // 2
    return np.stack(
        [
            (x * direction.x - y * direction.y + half) // direction.length,
            (x * direction.y + y * direction.x + half) // direction.length,
        ],
        axis=-1,
    )


def fit_boxes(width: int, height: int, direction: Direction, count: int) -> Points:
    """Return corners (k, 2) of at most `count` boxes, spread evenly over those that fit.

    The boxes are in rotated rows around the viewport's centre. Corners are relative to the centre
    and not rotated; `place_shapes` rotates the content.
    """
    wide, high = width + GAP, height + GAP
    half = SIDE * SUBPIXEL // 2 - MARGIN
    columns = np.arange(-(3 * half // (2 * wide)) - 2, 3 * half // (2 * wide) + 3) * wide
    rows = np.arange(-(3 * half // (2 * high)) - 2, 3 * half // (2 * high) + 3) * high
    # Each box is moved by less than a pixel afterwards, so ends are from -half to half - SUBPIXEL.
    # As `rotate` rounds, (v + length // 2) // length >= m if v >= m * length - length // 2.
    shift = direction.length // 2
    low, high_end = -half * direction.length - shift, (half - SUBPIXEL) * direction.length - shift
    fits = np.ones((len(rows), len(columns)), dtype=bool)
    for x, y in ((direction.x, -direction.y), (direction.y, direction.x)):
        corner = columns * x + (rows * y)[:, None]
        # Extremes over the box: each side adds its extent in this direction, or 0.
        fits &= corner + min(0, x * width) + min(0, y * height) >= low
        fits &= corner + max(0, x * width) + max(0, y * height) < high_end
    inside = np.flatnonzero(fits)
    size = min(count, len(inside))
    row, column = np.divmod(inside[np.arange(size) * len(inside) // max(size, 1)], len(columns))
    return np.stack([columns[column], rows[row]], axis=-1)


def place_shapes(
    shape: Callable[[NDArray[np.int64]], Points],
    size: tuple[int, int],
    direction: Direction,
    numbers: NDArray[np.int64],
) -> NDArray[np.int32]:
    """Return points (k, n, 2) of k rotated copies of a shape, each in one box of the grid.

    shape : k 32-bit numbers -> (k, n, 2) points in a box from (0, 0) to `size`
    numbers : (count,) from `hash_numbers`; there may be room for fewer copies
    """
    corners = fit_boxes(*size, direction, len(numbers))
    numbers = numbers[: len(corners)]
    local = shape(numbers) + corners[:, None]
    jitter = np.stack([numbers % SUBPIXEL, numbers // SUBPIXEL % SUBPIXEL], axis=-1)
    middle = SIDE * SUBPIXEL // 2
    return (rotate(local, direction) + middle + jitter[:, None]).astype(np.int32)


def make_triangle_shape(base: int, height: int) -> Callable[[NDArray[np.int64]], Points]:
    """Return a shape for `place_shapes`: triangles with varying apexes, half of them hanging."""

    def shape(numbers: NDArray[np.int64]) -> Points:
        apex = (numbers >> 16 & 255) * base // 255
        zero, high = np.zeros_like(apex), np.full_like(apex, height)
        x = np.stack([zero, zero + base, apex], axis=-1)
        y = np.stack([zero, zero, high], axis=-1)
        hangs = (numbers >> 24 & 1)[:, None] == 1
        return np.stack([np.where(hangs, base - x, x), np.where(hangs, height - y, y)], axis=-1)

    return shape


def make_ellipse_ring(corners: int, width: int, height: int) -> Points:
    """Return (corners, 2) points on an ellipse in a box, counter-clockwise from the right.

    Each quarter of the circle has the rational points ((m^2 - i^2) / (m^2 + i^2), 2 m i / (m^2 +
    i^2)); `corners` is a multiple of 4.
    """
    m = corners // 4
    i = np.arange(m)
    denominator = m * m + i * i
    quarter = np.stack([m * m - i * i, 2 * m * i], axis=-1)
    left_quarter = quarter[:, ::-1] * [-1, 1]
    circle = np.concatenate([quarter, left_quarter, -quarter, -left_quarter])
    denominator = np.tile(denominator, 4)[:, None]
    size = np.array([width, height])
    return np.asarray((circle + denominator) * size // (2 * denominator))


def triangulate_ring_as_fan(corners: int) -> Triangles:
    """Return (corners - 2, 3) triangles of a convex ring, all at its first vertex."""
    second = np.arange(1, corners - 1)
    return np.stack([np.zeros_like(second), second, second + 1], axis=-1).astype(np.int32)


def triangulate_ring_as_zigzag(corners: int) -> Triangles:
    """Return (corners - 2, 3) triangles of a convex ring: a strip from end to end."""
    step = np.arange(corners - 2)
    low, high = (step + 1) // 2, corners - 1 - step // 2
    apex = np.where(step % 2 == 0, low + 1, high - 1)
    return np.stack([low, apex, high], axis=-1).astype(np.int32)


def triangulate_ring_by_halving(corners: int) -> Triangles:
    """Return (corners - 2, 3) triangles: ends and middle of a chain, then of both halves."""

    def cut(first: int, last: int) -> list[tuple[int, int, int]]:
        if last - first < 2:
            return []
        middle = (first + last) // 2
        return [(first, middle, last), *cut(first, middle), *cut(middle, last)]

    return np.array(cut(0, corners - 1), np.int32)


RING_TRIANGULATIONS: dict[str, Callable[[int], Triangles]] = {
    "fan": triangulate_ring_as_fan,
    "zigzag": triangulate_ring_as_zigzag,
    "halved": triangulate_ring_by_halving,
}
