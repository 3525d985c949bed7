"""Rings of a batch for a device: their corners as integers, and its answer as triangles, checked.

A device has int32 alone: n (w + h) below 2^30 units of the ring's grid, so that every sum of
diagonals fits, with room for two that stand for nothing.

It gives each apex k the base (i, j) of its triangle: every corner of a ring but the first and the
last is the apex of exactly one. So the triangles are a binary tree. The pair (i, j) is the side of
one more triangle, whose base is longer: that of apex j, if it begins at i too, else that of apex i.
The tree is walked from the pair (0, n - 1) as the CPU walks its table.

Nothing that comes from a driver is trusted. It has to be such a tree, all its triangles have to
turn left, so that they are a triangulation, and their diagonals have to add up to the cost that
came with them. A ring of which one of these does not hold is left to the CPU.
"""

from typing import NamedTuple

import numpy as np

from triangulators.batch import Batch
from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import box_of, grid_unit
from triangulators.optimum.full_table import SPAN
from triangulators.polygon import twice_ring_area

SIZES = (16, 32, 64)
"""Corners up to which a ring has a program of its own, with a table that size."""

MOST = SIZES[-1]
KINDS = 2 * len(SIZES)
"""Kinds are even where differences of coordinates stay below 2^15 units, so that orientations fit
int32, and odd where they do not."""

ON_CPU = -1
_INT32_LIMIT = 1 << 30


class Rings(NamedTuple):
    """The rings of p polygons, prepared; n corners in all.

    vertex_offsets (p + 1,): where each ring begins in corners (n, 2) int32, which are its vertices
    in counter-clockwise order, in units of its grid, from its box's lower left. kind (p,) int8:
    ON_CPU, or by size and span; longest (p,) int32: w + h of the box; turned (p,): whether the
    order is that of the input reversed.
    """

    vertex_offsets: np.ndarray
    corners: np.ndarray
    kind: np.ndarray
    longest: np.ndarray
    turned: np.ndarray

    @classmethod
    def of(cls, vertex_offsets: np.ndarray) -> "Rings":
        """Return room for rings, of which none is prepared."""
        count = len(vertex_offsets) - 1
        return cls(
            vertex_offsets,
            np.zeros((int(vertex_offsets[-1]), 2), dtype=np.int32),
            np.full(count, ON_CPU, dtype=np.int8),
            np.zeros(count, dtype=np.int32),
            np.zeros(count, dtype=np.bool_),
        )


@njit(nogil=True)
def prepare(coords: np.ndarray, wanted: np.ndarray, most: int, rings: Rings) -> None:
    """Prepare each `wanted` ring (p,) that is for a device.

    coords: (n, 2) float64. Left out are rings off the grid, with sums beyond int32, of fewer
    than 3 or more than `most` corners (at most MOST), and with a corner twice in a row.
    """
    offsets, corners, kind, longest, turned = rings
    for index in range(len(wanted)):
        points = coords[offsets[index] : offsets[index + 1]]
        n = len(points)
        if not wanted[index] or n < 3 or n > most:
            continue
        unit = grid_unit(points)
        if unit == 0.0:
            continue
        low_x, low_y, w, h = box_of(points)
        if n * ((w + h) / unit) >= _INT32_LIMIT:
            continue
        back = not twice_ring_area(points) > 0.0
        own = corners[offsets[index] : offsets[index + 1]]
        for k in range(n):
            source = n - 1 - k if back else k
            own[k, 0] = np.int32((points[source, 0] - low_x) / unit)
            own[k, 1] = np.int32((points[source, 1] - low_y) / unit)
        if _repeats(own):
            continue
        size = 0
        while n > SIZES[size]:
            size += 1
        wide = max(w, h) >= SPAN * unit
        kind[index] = 2 * size + (1 if wide else 0)
        longest[index] = np.int32((w + h) / unit)
        turned[index] = back


@njit(nogil=True)
def _repeats(corners: np.ndarray) -> bool:
    """Whether a corner is met twice in a row: shapely takes that for valid."""
    x, y = corners[-1, 0], corners[-1, 1]
    for k in range(len(corners)):
        if corners[k, 0] == x and corners[k, 1] == y:
            return True
        x, y = corners[k, 0], corners[k, 1]
    return False


@njit(nogil=True)
def place(which: np.ndarray, bases: np.ndarray, worst: bool, rings: Rings, batch: Batch) -> None:
    """Write the triangles of the rings `which`; mark those in `done` that are as they should be.

    bases: (n,) uint32, as many as corners: the cost of the ring at its first, i | j << 16 at apex
    k; worst: whether the longest diagonals were looked for.
    """
    offsets, corners, longest, turned = (
        rings.vertex_offsets,
        rings.corners,
        rings.longest,
        rings.turned,
    )
    below = np.empty((MOST, 2), dtype=np.int32)
    stack = np.empty(MOST, dtype=np.int32)
    for index in which:
        begin, end = offsets[index], offsets[index + 1]
        own = batch.triangles[batch.triangle_offsets[index] : batch.triangle_offsets[index + 1]]
        base, ring = bases[begin:end], corners[begin:end]
        least = longest[index] if worst else -1
        if not _walk(base, ring, least, below, stack, own):
            continue
        if turned[index]:
            for row in range(len(own)):
                for e in range(3):
                    own[row, e] = end - begin - 1 - own[row, e]
        batch.done[index] = True


@njit(nogil=True)
def _walk(
    bases: np.ndarray,
    corners: np.ndarray,
    longest: int,
    below: np.ndarray,
    stack: np.ndarray,
    triangles: np.ndarray,
) -> bool:
    """Write the triangles (n - 2, 3) of a ring; False if they are no triangulation of that cost.

    longest: w + h of the box where diagonals cost that less their length, -1 where they cost it.
    """
    n = len(bases)
    stack[0] = _grow(bases, below)
    if stack[0] < 0:
        return False
    height, found, total = 1, 0, np.int64(0)
    while height > 0:
        height -= 1
        k = stack[height]
        i, j = np.int64(bases[k] & 0xFFFF), np.int64(bases[k] >> 16)
        ax, ay = np.int64(corners[k, 0]) - corners[i, 0], np.int64(corners[k, 1]) - corners[i, 1]
        bx, by = np.int64(corners[j, 0]) - corners[i, 0], np.int64(corners[j, 1]) - corners[i, 1]
        if ax * by - ay * bx <= 0:
            return False
        if j - i < n - 1:
            length = abs(bx) + abs(by)
            total += length if longest < 0 else longest - length
        # As the CPU's table has it: the new vertex last and the smaller side first.
        triangles[found, 0], triangles[found, 1], triangles[found, 2] = j, i, k
        found += 1
        left, right = below[k, 0], below[k, 1]
        if k - i <= j - k:
            left, right = right, left
        if left >= 0:
            stack[height] = left
            height += 1
        if right >= 0:
            stack[height] = right
            height += 1
    return found == n - 2 and total == np.int64(bases[0])


@njit(nogil=True)
def _grow(bases: np.ndarray, below: np.ndarray) -> int:
    """Link each apex below the one whose triangle has its base for a side; return the top or -1.

    below (n, 2): the apexes over the sides (i, k) and (k, j) of apex k, -1 where that is none.
    """
    n, top = len(bases), -1
    below[:n] = -1
    for k in range(1, n - 1):
        i, j = np.int64(bases[k] & 0xFFFF), np.int64(bases[k] >> 16)
        if not i < k < j < n:
            return -1
        if j - i == n - 1:
            if top >= 0:
                return -1
            top = k
        elif j < n - 1 and np.int64(bases[j] & 0xFFFF) == i and below[j, 0] < 0:
            below[j, 0] = k
        elif i > 0 and np.int64(bases[i] >> 16) == j and below[i, 1] < 0:
            below[i, 1] = k
        else:
            return -1
    return top
