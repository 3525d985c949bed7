"""Triangles in whole numbers of 1/256 px, made from a seed, that a page makes in the same way.

Only sums, products, floor divisions and shifts of whole numbers below 2^53 are used, so that any
language gives the same points. Directions are those of Pythagorean triples: a turn by (4, 3, 5) is
exact but for one rounding at the end.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.grid import SUBPIXEL

Points = NDArray[np.int64]
Triangles = NDArray[np.int32]

SIDE = 1024
"""Width and height of the viewport of every draw, px."""

GAP = 2 * SUBPIXEL
"""Between neighbours: one strays by less than a pixel, and shares no pixel with another."""

MARGIN = SUBPIXEL
"""Kept free at each side of the viewport."""


class Direction(NamedTuple):
    """A turn: (x, y) / length is its cosine and sine, all three whole numbers."""

    x: int
    y: int
    length: int


LEVEL, STEEP = Direction(1, 0, 1), Direction(0, 1, 1)
SLANTED, DIAGONAL = Direction(12, 5, 13), Direction(21, 20, 29)
DIRECTIONS = (LEVEL, SLANTED, DIAGONAL, STEEP)
"""Turns by 0, 22.6, 43.6 and 90 degrees."""

_MASK = np.uint64(0xFFFFFFFF)


def mixed(seed: int, draw: int, count: int) -> NDArray[np.int64]:
    """Return `count` numbers of 32 bits: the seed's, the draw's and each place's, well mixed.

    Multiplied as D. E. Knuth does ("The Art of Computer Programming", volume 3, section 6.4), then
    shifted twice as in G. Marsaglia, "Xorshift RNGs", Journal of Statistical Software 8(14), 2003.
    """
    place = np.arange(1, count + 1, dtype=np.uint64)
    start = (seed % (1 << 32) * 31 + draw * 65_599) % (1 << 32)
    value = ((place + np.uint64(start)) & _MASK) * np.uint64(2_654_435_761) & _MASK
    for _ in range(2):
        value ^= (value << np.uint64(13)) & _MASK
        value ^= value >> np.uint64(17)
        value ^= (value << np.uint64(5)) & _MASK
    return value.astype(np.int64)


def turned(points: Points, direction: Direction) -> Points:
    """Return points (..., 2) turned about the origin, to the nearest whole number."""
    x, y = points[..., 0], points[..., 1]
    half = direction.length // 2
    return np.stack(
        [
            (x * direction.x - y * direction.y + half) // direction.length,
            (x * direction.y + y * direction.x + half) // direction.length,
        ],
        axis=-1,
    )


def cells(width: int, height: int, direction: Direction, count: int) -> Points:
    """Return corners (k, 2) of at most `count` boxes, spread evenly over those that fit.

    The boxes, `width` times `height` and turned, stand in rows about the viewport's middle. They
    are returned unturned, as seen from the middle; `placed` turns what is in them.
    """
    wide, high = width + GAP, height + GAP
    half = SIDE * SUBPIXEL // 2 - MARGIN
    columns = np.arange(-(3 * half // (2 * wide)) - 2, 3 * half // (2 * wide) + 3) * wide
    rows = np.arange(-(3 * half // (2 * high)) - 2, 3 * half // (2 * high) + 3) * high
    # Each is moved by less than a pixel afterwards, so ends are from -half to half - SUBPIXEL. As
    # `turned` rounds, (v + length // 2) // length >= m where v >= m * length - length // 2.
    shift = direction.length // 2
    least, limit = -half * direction.length - shift, (half - SUBPIXEL) * direction.length - shift
    fits = np.ones((len(rows), len(columns)), dtype=bool)
    for x, y in ((direction.x, -direction.y), (direction.y, direction.x)):
        corner = columns * x + (rows * y)[:, None]
        # What a box adds to its corner: each side's part, or nothing.
        fits &= corner + min(0, x * width) + min(0, y * height) >= least
        fits &= corner + max(0, x * width) + max(0, y * height) < limit
    inside = np.flatnonzero(fits)
    wanted = min(count, len(inside))
    row, column = np.divmod(inside[np.arange(wanted) * len(inside) // max(wanted, 1)], len(columns))
    return np.stack([columns[column], rows[row]], axis=-1)


def placed(
    shape: Callable[[NDArray[np.int64]], Points],
    size: tuple[int, int],
    direction: Direction,
    numbers: NDArray[np.int64],
) -> NDArray[np.int32]:
    """Return points (k, n, 2) of k copies of a shape, turned, each at its own place on the grid.

    shape : k numbers of 32 bits -> (k, n, 2) points in a box from (0, 0) to `size`
    numbers : (count,) as `mixed` returns them; there may be room for fewer than that
    """
    corners = cells(*size, direction, len(numbers))
    numbers = numbers[: len(corners)]
    local = shape(numbers) + corners[:, None]
    stray = np.stack([numbers % SUBPIXEL, numbers // SUBPIXEL % SUBPIXEL], axis=-1)
    middle = SIDE * SUBPIXEL // 2
    return (turned(local, direction) + middle + stray[:, None]).astype(np.int32)


def triangle(base: int, height: int) -> Callable[[NDArray[np.int64]], Points]:
    """Return a shape for `placed`: triangles on a base, each with its apex above another place.

    Every other one hangs from the top of its box. All have one area: base times height over 2.
    """

    def shape(numbers: NDArray[np.int64]) -> Points:
        apex = (numbers >> 16 & 255) * base // 255
        nothing, low, high = np.zeros_like(apex), np.zeros_like(apex), np.full_like(apex, height)
        x = np.stack([nothing, nothing + base, apex], axis=-1)
        y = np.stack([low, low, high], axis=-1)
        hangs = (numbers >> 24 & 1)[:, None] == 1
        return np.stack([np.where(hangs, base - x, x), np.where(hangs, height - y, y)], axis=-1)

    return shape


def ring(corners: int, width: int, height: int) -> Points:
    """Return (corners, 2) points on an ellipse in a box from (0, 0) to (width, height).

    They go round counter-clockwise from the right. Each quarter of the circle has the rational
    points ((m^2 - i^2) / (m^2 + i^2), 2 m i / (m^2 + i^2)); `corners` is a multiple of 4.
    """
    m = corners // 4
    i = np.arange(m)
    whole = m * m + i * i
    quarter = np.stack([m * m - i * i, 2 * m * i], axis=-1)
    back = quarter[:, ::-1] * [-1, 1]
    circle = np.concatenate([quarter, back, -quarter, -back])
    whole = np.tile(whole, 4)[:, None]
    size = np.array([width, height])
    return np.asarray((circle + whole) * size // (2 * whole))


def fan(corners: int) -> Triangles:
    """Return (corners - 2, 3) triangles of a convex ring, all from its first corner."""
    second = np.arange(1, corners - 1)
    return np.stack([np.zeros_like(second), second, second + 1], axis=-1).astype(np.int32)


def zigzag(corners: int) -> Triangles:
    """Return (corners - 2, 3) triangles of a convex ring: a strip from one end to the other."""
    step = np.arange(corners - 2)
    left, right = (step + 1) // 2, corners - 1 - step // 2
    third = np.where(step % 2 == 0, left + 1, right - 1)
    return np.stack([left, third, right], axis=-1).astype(np.int32)


def halved(corners: int) -> Triangles:
    """Return (corners - 2, 3) triangles of a convex ring: each chain is cut in its middle."""

    def cut(first: int, last: int) -> list[tuple[int, int, int]]:
        if last - first < 2:
            return []
        middle = (first + last) // 2
        return [(first, middle, last), *cut(first, middle), *cut(middle, last)]

    return np.array(cut(0, corners - 1), np.int32)


WAYS: dict[str, Callable[[int], Triangles]] = {"fan": fan, "zigzag": zigzag, "halved": halved}
"""Triangulations of a convex ring, by name."""
