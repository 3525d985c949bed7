"""Which rings of a batch a device can do, and their corners as integers.

A device has int32 alone. The guard is that of `edges.integer_type`: n (w + h) below 2^30 units of
the ring's grid, so that every sum of diagonals fits, with room for two that stand for nothing.
"""

from typing import NamedTuple

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.optimum.edge_table import INT32_LIMIT
from triangulators.optimum.small_ring import SPAN, box_of, grid_unit, twice_area

SIZES = (16, 32, 64)
"""Corners up to which a ring has a program of its own, with a table that size."""

MOST = 2048
"""Corners of the largest ring: its table has 16 MiB, which every device holds in one buffer."""

LARGE = 2 * len(SIZES)
"""The first kind that is done in tiles. Kinds are even where differences of coordinates stay below
2^15 units, so that orientations fit int32, and odd where they do not."""

ON_CPU = -1


class Rings(NamedTuple):
    """The rings of p polygons, prepared; n corners in all.

    begins (p + 1,): where each begins in corners (n, 2) int32, which are those of the ring in
    counter-clockwise order, in units of its grid, from its box's lower left. kind (p,) int8:
    ON_CPU, or by size and span; longest (p,) int32: w + h of the box; turned (p,): whether the
    order is that of the input reversed.
    """

    begins: np.ndarray
    corners: np.ndarray
    kind: np.ndarray
    longest: np.ndarray
    turned: np.ndarray

    @classmethod
    def of(cls, begins: np.ndarray) -> "Rings":
        """Return room for rings, of which none is prepared."""
        count = len(begins) - 1
        return cls(
            begins,
            np.zeros((int(begins[-1]), 2), dtype=np.int32),
            np.full(count, ON_CPU, dtype=np.int8),
            np.zeros(count, dtype=np.int32),
            np.zeros(count, dtype=np.bool_),
        )


@njit(nogil=True)
def prepare(
    first: int,
    last: int,
    coordinates: np.ndarray,
    wanted: np.ndarray,
    most: int,
    rings: Rings,
) -> None:
    """Prepare each wanted ring of first..last - 1, if it is for a device.

    coordinates: (n, 2) float64. Left out are rings off the grid, with sums beyond int32, of fewer
    than 3 or more than `most` corners (at most MOST), and with a corner twice in a row.
    """
    begins, corners, kind, longest, turned = rings
    for index in range(first, last):
        points = coordinates[begins[index] : begins[index + 1]]
        n = len(points)
        if not wanted[index] or n < 3 or n > most:
            continue
        unit = grid_unit(points)
        if unit == 0.0:
            continue
        low_x, low_y, w, h = box_of(points)
        if n * ((w + h) / unit) >= INT32_LIMIT:
            continue
        back = not twice_area(points) > 0.0
        own = corners[begins[index] : begins[index + 1]]
        for k in range(n):
            source = n - 1 - k if back else k
            own[k, 0] = np.int32((points[source, 0] - low_x) / unit)
            own[k, 1] = np.int32((points[source, 1] - low_y) / unit)
        if _repeats(own):
            continue
        size = 0
        while size < len(SIZES) and n > SIZES[size]:
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
