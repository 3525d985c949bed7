"""Candidates: all edges and empty triangles that a triangulation of a polygon can contain.

An edge is a pair of mutually visible sites (see `Boundary`), or an edge of the boundary; a triangle
is empty if no hole lies inside. Every triangulation is a subset of the empty triangles.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from triangulators.compute.kernels import copy_rows, group_by_key, njit
from triangulators.criteria.cost import Cost, allocate_block, weigh_block
from triangulators.geometry.half_edges import find_twins
from triangulators.geometry.predicates import orientation
from triangulators.geometry.visibility import find_visible_sites
from triangulators.polygon import Boundary

_BLOCK_TRIANGLES = 256  # triangles whose costs are computed in one call


class Candidates(NamedTuple):
    """Edges and triangles of a polygon.

    `items[start[2 * i]:start[2 * i + 1]]` are the triangles on the left of edge i, seen from a to
    b, and those up to `start[2 * i + 2]` the triangles on the right.
    """

    points: np.ndarray  # (n, 2)
    edges: np.ndarray  # (e, 2): pairs of sites a < b, in ascending order
    side: np.ndarray  # (e,): 1 if a-b is a boundary edge (interior on the left), -1 if b-a, else 0
    triangles: np.ndarray  # (t, 3): sites, counter-clockwise
    triangle_edges: np.ndarray  # (t, 3): index of the edge from vertex k to vertex k + 1
    start: np.ndarray  # (2 e + 1,)
    items: np.ndarray  # (3 t,)


def find_candidates(
    outline: Boundary, triangles: np.ndarray, max_triples: int
) -> Candidates | None:
    """Return the candidates, from any triangulation (m, 3), or None above `max_triples` triples."""
    points = outline.points
    triangles = np.ascontiguousarray(triangles, dtype=np.int32)
    pairs = find_visible_sites(points, triangles, find_twins(triangles))
    edges = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    side = np.zeros(len(edges), dtype=np.int8)
    keys = edges[:, 0].astype(np.int64) * len(points) + edges[:, 1]
    low_ends, high_ends = outline.edges.min(axis=1).astype(np.int64), outline.edges.max(axis=1)
    on_boundary = np.searchsorted(keys, low_ends * len(points) + high_ends)
    side[on_boundary] = np.where(outline.edges[:, 0] < outline.edges[:, 1], 1, -1)
    first = np.searchsorted(edges[:, 0], np.arange(len(points) + 1))
    triples, rows = _list_triangles(points, first, edges, side, _sample_holes(outline), max_triples)
    if triples > max_triples:
        return None
    empty, sides = rows[:, :3].copy(), rows[:, 3:].copy()
    keys = 2 * sides
    keys += empty > empty[:, [1, 2, 0]]  # on the right of an edge if the side descends (b to a)
    start, items = group_by_key(keys.ravel(), 2 * len(edges))
    items //= 3
    return Candidates(points, edges, side, empty, sides, start, items)


def _sample_holes(outline: Boundary) -> np.ndarray:
    """Return up to four sites of each hole, (h, 4); the last is repeated if there are fewer."""
    samples = np.zeros((outline.holes, 4), dtype=np.int32)
    for number, (begin, end) in enumerate(pairwise(outline.ring_offsets[1:])):
        ring = list(dict.fromkeys(outline.site[begin:end].tolist()))[:4]
        samples[number] = ring + ring[-1:] * (4 - len(ring))
    return samples


@njit(nogil=True)
def _list_triangles(
    points: np.ndarray,
    first: np.ndarray,
    edges: np.ndarray,
    side: np.ndarray,
    rings: np.ndarray,
    max_triples: int,
) -> tuple[int, np.ndarray]:
    """Return the number of mutually visible triples, and the empty triangles, (t, 6).

    A row has three vertices and three sides. Edges first[a] to first[a + 1] - 1 begin at a.
    """
    n = len(points)
    edge_to = np.full(n, -1, dtype=np.int32)
    rows = np.empty((1024, 6), dtype=np.int32)
    triples, count = 0, 0
    for a in range(n):
        if triples > max_triples:
            break
        for p in range(first[a], first[a + 1]):
            edge_to[edges[p, 1]] = p
        for p in range(first[a], first[a + 1]):
            b = edges[p, 1]
            for q in range(first[b], first[b + 1]):
                c = edges[q, 1]
                r = edge_to[c]
                if r < 0:
                    continue
                triples += 1
                # The counter-clockwise triangle a-b-c runs along the edges p and q and against r, a
                # clockwise one the other way. A triangle that runs against a boundary edge is
                # outside the polygon.
                sign = 1 if orientation(points, a, b, c) > 0.0 else -1
                if side[p] == -sign or side[q] == -sign or side[r] == sign:
                    continue
                if contains_hole(points, rings, a, b, c, sign):
                    continue
                if count == len(rows):
                    grown = np.empty((2 * count, 6), dtype=np.int32)
                    copy_rows(rows, grown[:count])
                    rows = grown
                row = rows[count]
                row[0], row[1], row[2], row[3], row[4], row[5] = a, b, c, p, q, r
                if sign < 0:
                    row[1], row[2], row[3], row[5] = c, b, r, p
                count += 1
        for p in range(first[a], first[a + 1]):
            edge_to[edges[p, 1]] = -1
    return triples, rows[:count]


@njit(nogil=True)
def weigh_candidates(points: np.ndarray, triangles: np.ndarray, cost: Cost) -> np.ndarray:
    """Return the cost (t,) of each triangle (t, 3), computed in blocks (see `weigh_block`)."""
    result = np.empty(len(triangles))
    corners, costs = allocate_block(_BLOCK_TRIANGLES)
    ax, ay, bx, by, cx, cy = corners
    for first in range(0, len(triangles), _BLOCK_TRIANGLES):
        count = min(_BLOCK_TRIANGLES, len(triangles) - first)
        for k in range(count):
            a, b, c = triangles[first + k, 0], triangles[first + k, 1], triangles[first + k, 2]
            ax[k], ay[k], bx[k] = points[a, 0], points[a, 1], points[b, 0]
            by[k], cx[k], cy[k] = points[b, 1], points[c, 0], points[c, 1]
        weigh_block(cost, corners, count, costs)
        for k in range(count):
            result[first + k] = costs[k]
    return result


@njit(nogil=True)
def contains_hole(points: np.ndarray, rings: np.ndarray, a: int, b: int, c: int, sign: int) -> bool:
    """Whether a hole is inside the triangle a-b-c, counter-clockwise if sign is 1, clockwise if -1.

    No hole crosses the sides, so the first of its four sites that is not a vertex decides.
    """
    low_x = min(points[a, 0], points[b, 0], points[c, 0])
    high_x = max(points[a, 0], points[b, 0], points[c, 0])
    low_y = min(points[a, 1], points[b, 1], points[c, 1])
    high_y = max(points[a, 1], points[b, 1], points[c, 1])
    for ring in range(len(rings)):
        v = rings[ring, 0]
        step = 0
        while (v == a or v == b or v == c) and step < 3:  # noqa: SIM109 - for Numba
            step += 1
            v = rings[ring, step]
        if not (low_x < points[v, 0] < high_x and low_y < points[v, 1] < high_y):
            continue
        if (
            sign * orientation(points, a, b, v) > 0.0
            and sign * orientation(points, b, c, v) > 0.0
            and sign * orientation(points, c, a, v) > 0.0
        ):
            return True
    return False
