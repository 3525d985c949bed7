"""Compiled parts of `batch.many`: what is done for each polygon, without holding the GIL."""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.optimum.small_holes import holes_optimum
from triangulators.optimum.small_ring import ring_optimum


@njit(nogil=True)
def polygon_of(
    index: int, coordinates: np.ndarray, ring_ends: np.ndarray, owners: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (n, 2) of polygon `index` of a batch, and where in them each ring ends."""
    start = ring_ends[owners[index] - 1] if owners[index] > 0 else 0
    ends = ring_ends[owners[index] : owners[index + 1]] - start
    return coordinates[start : start + ends[-1]], ends


@njit(nogil=True)
def do_rings(
    first: int,
    last: int,
    coordinates: np.ndarray,
    begins: np.ndarray,
    wanted: np.ndarray,
    box: np.ndarray,
    starts: np.ndarray,
    triangles: np.ndarray,
    done: np.ndarray,
) -> None:
    """Triangulate each wanted ring of first..last - 1; mark in `done` which succeeded.

    Polygon i has coordinates[begins[i]:begins[i + 1]] and room in triangles[starts[i]:starts[i +
    1]]. Neighbours in the arrays are done by one thread, so no two of them write to a cache line
    for long.
    """
    for index in range(first, last):
        if wanted[index]:
            points = coordinates[begins[index] : begins[index + 1]]
            own = triangles[starts[index] : starts[index + 1]]
            done[index] = ring_optimum(points, box, own) < np.inf


@njit(nogil=True)
def do_holes(
    first: int,
    last: int,
    coordinates: np.ndarray,
    ring_ends: np.ndarray,
    owners: np.ndarray,
    which: np.ndarray,
    box: np.ndarray,
    starts: np.ndarray,
    triangles: np.ndarray,
    done: np.ndarray,
) -> None:
    """Triangulate the polygons which[first:last], which have holes; mark which succeeded.

    Polygon i has the rings that end at ring_ends[owners[i]:owners[i + 1]].
    """
    for task in range(first, last):
        index = which[task]
        points, ends = polygon_of(index, coordinates, ring_ends, owners)
        own = triangles[starts[index] : starts[index + 1]]
        done[index] = holes_optimum(points, ends, box, own)
