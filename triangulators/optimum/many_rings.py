"""Optima of many polygons in one call, without holding the GIL: what threads of a batch run.

One compiled call does polygons first..last - 1, so that a polygon of ten corners, which takes two
microseconds, is not behind a call from Python that takes as long. Neighbours in the arrays are done
by one thread, so no two of them write to a cache line for long.
"""

from typing import NamedTuple

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.optimum.full_table import by_full_table


class Batch(NamedTuple):
    """Arrays of p polygons.

    coordinates (n, 2); rings (r + 1,): bounds of rings in it; owners (p + 1,): bounds of polygons
    in `rings`; begins (p + 1,): bounds of polygons in `coordinates`; starts (p + 1,): bounds of
    polygons in `triangles` (m, 3), where there is room for each one's; done (p,): which succeeded.
    """

    coordinates: np.ndarray
    rings: np.ndarray
    owners: np.ndarray
    begins: np.ndarray
    starts: np.ndarray
    triangles: np.ndarray
    done: np.ndarray


@njit(nogil=True)
def polygon_of(
    index: int, coordinates: np.ndarray, rings: np.ndarray, owners: np.ndarray, begins: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (n, 2) of polygon `index` of a `Batch`, and where in them its rings end."""
    ends = rings[owners[index] + 1 : owners[index + 1] + 1] - begins[index]
    return coordinates[begins[index] : begins[index + 1]], ends


@njit(nogil=True)
def do_rings(first: int, last: int, batch: Batch, wanted: np.ndarray, box: np.ndarray) -> None:
    """Triangulate the polygons first..last - 1 that are `wanted` (p,), which have no holes."""
    for index in range(first, last):
        if wanted[index]:
            points = batch.coordinates[batch.begins[index] : batch.begins[index + 1]]
            own = batch.triangles[batch.starts[index] : batch.starts[index + 1]]
            batch.done[index] = by_full_table(points, box, own) < np.inf
