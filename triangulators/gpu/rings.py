"""Rings of a batch for a device: vertices as integers, and checked triangles from the results.

Coordinates are int32. Only rings with n (w + h) below 2^30 units of the ring's grid are supported
(w, h: sides of the bounding box): every sum of diagonals then fits, and so does the sum of two
costs NONE of half-perimeters.

In the triangle i < k < j of a triangulation, the vertex k is called the apex and the side (i, j)
the base. Every vertex of a ring except the first and the last is the apex of exactly one triangle,
so a device returns the base of each apex, and in the places of the first and the last vertex the
low and the high word of the ring's cost. The triangles are a binary tree, walked from the base
(0, n - 1) in the order of the CPU: the base (i, j) is also a side of the triangle of apex j if the
base of j begins at i, otherwise of the triangle of apex i.

Results of drivers are not trusted: the bases must form such a tree, all triangles must be
counter-clockwise, and the costs must add up to the reported cost. The CPU solves other rings.
"""

from typing import NamedTuple

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.criteria.features import expected_quads
from triangulators.geometry.order import put_in_walk_order
from triangulators.geometry.predicates import find_bounding_box, find_grid_unit
from triangulators.optimum.full_table import INT32_SPAN
from triangulators.polygon import twice_ring_area
from triangulators.polygon_arrays import Batch

SIZES = (16, 32, 64)  # maximum numbers of vertices of the three shaders, and sizes of cost tables

MAX_VERTICES = SIZES[-1]
KINDS = 2 * len(SIZES)  # two for each size; the odd is wide: differences of 2^15 units or more
ON_CPU = -1  # kind of rings that devices do not support
_INT32_LIMIT = 1 << 30  # limit of n (w + h)
_MAX_UNIT = 2.0**64  # units of grids, float32 in shaders, are from 2^-64 to 2^64
_TOLERANCE = 1e-9  # tolerated relative difference of expected quads between device and CPU


class Rings(NamedTuple):
    """The rings of p polygons without holes, prepared for a device."""

    vertex_offsets: np.ndarray  # (p + 1,): offsets of the rings in `corners`
    corners: np.ndarray  # (n, 2) int32: counter-clockwise, in grid units from the box's lower left
    kind: np.ndarray  # (p,) int8: ON_CPU, or 2 * (index in SIZES) + (1 if wide, see KINDS)
    longest: np.ndarray  # (p,) int32: width plus height of the bounding box
    turned: np.ndarray  # (p,): True if the order of vertices was reversed
    unit: np.ndarray  # (p,) float32: the grid's unit, a power of two

    @classmethod
    def allocate(cls, vertex_offsets: np.ndarray) -> "Rings":
        """Return rings for vertex offsets (p + 1,), all of the kind ON_CPU."""
        count = len(vertex_offsets) - 1
        return cls(
            vertex_offsets,
            np.zeros((int(vertex_offsets[-1]), 2), dtype=np.int32),
            np.full(count, ON_CPU, dtype=np.int8),
            np.zeros(count, dtype=np.int32),
            np.zeros(count, dtype=np.bool_),
            np.zeros(count, dtype=np.float32),
        )


@njit(nogil=True)
def prepare_rings(
    coords: np.ndarray, selected: np.ndarray, max_vertices: int, rings: Rings
) -> None:
    """Write the rings that devices support to `rings`.

    Unsupported are rings off the grid, with sums beyond int32, with fewer than 3 or more than
    `max_vertices` vertices, and with a vertex repeated consecutively.
    """
    offsets, corners, kind, longest, turned, units = rings
    for index in range(len(selected)):
        points = coords[offsets[index] : offsets[index + 1]]
        n = len(points)
        if not selected[index] or n < 3 or n > max_vertices:
            continue
        unit = find_grid_unit(points)
        if not 1.0 / _MAX_UNIT <= unit <= _MAX_UNIT:
            continue
        low_x, low_y, w, h = find_bounding_box(points)
        if n * ((w + h) / unit) >= _INT32_LIMIT:
            continue
        is_reversed = not twice_ring_area(points) > 0.0
        vertices = corners[offsets[index] : offsets[index + 1]]
        for k in range(n):
            source = n - 1 - k if is_reversed else k
            vertices[k, 0] = np.int32((points[source, 0] - low_x) / unit)
            vertices[k, 1] = np.int32((points[source, 1] - low_y) / unit)
        if _has_repeated_vertex(vertices):
            continue
        size = 0
        while n > SIZES[size]:
            size += 1
        wide = max(w, h) >= INT32_SPAN * unit
        kind[index] = 2 * size + (1 if wide else 0)
        longest[index] = np.int32((w + h) / unit)
        turned[index], units[index] = is_reversed, unit


@njit(nogil=True)
def _has_repeated_vertex(corners: np.ndarray) -> bool:
    """Whether two consecutive vertices of a ring (n, 2) are equal, which shapely accepts."""
    x, y = corners[-1, 0], corners[-1, 1]
    for k in range(len(corners)):
        if corners[k, 0] == x and corners[k, 1] == y:
            return True
        x, y = corners[k, 0], corners[k, 1]
    return False


def read_cost_words(indices: np.ndarray, bases: np.ndarray, rings: Rings) -> np.ndarray:
    """Return the 64 bits (k,) uint64 of the cost of each ring in `indices` (k,)."""
    first, last = rings.vertex_offsets[indices], rings.vertex_offsets[indices + 1] - 1
    high_words = bases[last].astype(np.uint64) << np.uint64(32)
    return np.asarray(bases[first] | high_words)


@njit(nogil=True)
def store_results(
    indices: np.ndarray,
    bases: np.ndarray,
    costs: np.ndarray,
    is_quads: bool,
    worst: bool,
    rings: Rings,
    batch: Batch,
) -> None:
    """Write the triangles of the rings `indices` (k,) to `batch`; mark valid results in its `done`.

    bases (n,) uint32: at the apex k of a triangle i, k, j, its base as i | j << 16; costs (k,)
    float64: costs that the device reported, expected quads if `is_quads`, else half-perimeters.
    """
    offsets, corners, _kind, longest, turned, unit = rings
    below = np.empty((MAX_VERTICES, 2), dtype=np.int32)
    stack = np.empty(MAX_VERTICES, dtype=np.int32)
    for number, index in enumerate(indices):
        begin, end = offsets[index], offsets[index + 1]
        triangles = batch.triangles[
            batch.triangle_offsets[index] : batch.triangle_offsets[index + 1]
        ]
        base, ring = bases[begin:end], corners[begin:end]
        max_length, scale = longest[index] if worst else -1, unit[index] if is_quads else 0.0
        total = _write_ring_triangles(base, ring, max_length, scale, below, stack, triangles)
        cost = -costs[number] if is_quads and worst else costs[number]
        if not abs(total - cost) <= (_TOLERANCE * total if is_quads else 0.0):
            continue
        for row in range(len(triangles)):
            j, i, k = triangles[row]
            if turned[index]:
                i, j, k = end - begin - 1 - i, end - begin - 1 - j, end - begin - 1 - k
            # The CPU's order of vertices in a row; for quads, that of `any_cost.solve_any_cost`.
            triangles[row] = (i, k, j) if is_quads else (j, i, k)
        if is_quads:  # the order of `methods.optimal`
            triangles[:] = put_in_walk_order(triangles, end - begin)
        batch.done[index] = True


@njit(nogil=True)
def _write_ring_triangles(
    bases: np.ndarray,
    corners: np.ndarray,
    longest: int,
    unit: float,
    below: np.ndarray,
    stack: np.ndarray,
    triangles: np.ndarray,
) -> float:
    """Write the triangles (n - 2, 3) of a ring; return the cost, NaN if `bases` are invalid.

    A diagonal costs its L1 length, or `longest` minus the length unless `longest` is -1. unit: unit
    of the grid if the cost is expected quads, otherwise 0; below, stack: workspaces.
    """
    n = len(bases)
    stack[0] = _link_triangles(bases, below)
    if stack[0] < 0:
        return np.nan
    height, size, total = 1, 0, 0.0
    while height > 0:
        height -= 1
        k = stack[height]
        i, j = np.int64(bases[k] & 0xFFFF), np.int64(bases[k] >> 16)
        ax, ay = np.int64(corners[k, 0]) - corners[i, 0], np.int64(corners[k, 1]) - corners[i, 1]
        bx, by = np.int64(corners[j, 0]) - corners[i, 0], np.int64(corners[j, 1]) - corners[i, 1]
        if ax * by - ay * bx <= 0:
            return np.nan
        if unit > 0.0:
            total += expected_quads(0.0, 0.0, unit * ax, unit * ay, unit * bx, unit * by)
        elif j - i < n - 1:
            length = abs(bx) + abs(by)
            total += length if longest < 0 else longest - length
        # In the order of the CPU: the new vertex is last, and the smaller side is visited first.
        triangles[size, 0], triangles[size, 1], triangles[size, 2] = j, i, k
        size += 1
        later, sooner = below[k, 0], below[k, 1]
        if k - i <= j - k:
            later, sooner = sooner, later
        if later >= 0:
            stack[height] = later
            height += 1
        if sooner >= 0:
            stack[height] = sooner
            height += 1
    return total if size == n - 2 else np.nan


@njit(nogil=True)
def _link_triangles(bases: np.ndarray, below: np.ndarray) -> int:
    """Link the triangles of a ring to a tree; return the apex of the root, or -1 if impossible.

    below (n, 2): output; apexes of the triangles at the sides (i, k) and (k, j) of apex k, or -1.
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
