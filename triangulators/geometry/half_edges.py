"""Half-edges: 3 t, 3 t + 1 and 3 t + 2 run from each vertex of triangle t to the next.

The twin of a half-edge is the opposite half-edge along the same edge, in the adjacent triangle.
"""

from typing import Any

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import orientation


@njit(nogil=True, inline="always")
def next_edge(e: Any) -> Any:
    """Return the next half-edge of the triangle of e."""
    return e + 1 if e % 3 < 2 else e - 2


@njit(nogil=True, inline="always")
def previous_edge(e: Any) -> Any:
    """Return the previous half-edge of the triangle of e."""
    return e - 1 if e % 3 > 0 else e + 2


@njit(nogil=True)
def link_half_edges(corner: np.ndarray) -> np.ndarray:
    """Return the twin (3 m,) of each half-edge, or -1 on the boundary; twins are mutual.

    corner (3 m,): start vertex of each half-edge. Of several candidates the lowest is the twin.

    A hash table with open addressing, at most two thirds full, has a slot per undirected edge: the
    last half-edge of a queue of unmatched half-edges, all in the same direction. While e is queued,
    twin[e] is -2 - f, where f is the half-edge after e in the queue, or the first one if e is the
    last. So both ends are reached in a step, and each repeated edge takes constant time.
    """
    count = len(corner)
    bits = 4
    while 1 << bits < count + (count >> 1):
        bits += 1
    mask = (1 << bits) - 1
    slots = np.full(mask + 1, -1, dtype=np.int32)
    twin = np.empty(count, dtype=np.int32)
    for e in range(count):
        tail, head = np.int64(corner[e]), np.int64(corner[next_edge(e)])
        low, high = min(tail, head), max(tail, head)
        at = (((low + high * 0x9E3779B1) * 0x85EBCA6B) & 0xFFFFFFFF) >> (32 - bits)
        last: Any = np.int64(slots[at])
        start, end = tail, head
        while last >= 0:
            start, end = np.int64(corner[last]), np.int64(corner[next_edge(last)])
            if (start == head and end == tail) or (start == tail and end == head):
                break
            at = (at + 1) & mask
            last = np.int64(slots[at])
        if last < 0 or twin[last] >= 0:  # start a new queue
            slots[at] = e
            twin[e] = -2 - e
        elif start == head and end == tail:
            first = -2 - twin[last]
            twin[last] = twin[first]  # overwritten by the next line if first is last
            twin[first] = e
            twin[e] = first
        else:
            slots[at] = e
            twin[e] = twin[last]
            twin[last] = -2 - e
    for e in range(count):
        twin[e] = max(twin[e], -1)
    return twin


def find_twins(triangles: np.ndarray) -> np.ndarray:
    """Return the twins (m, 3) of the half-edges of triangles (m, 3)."""
    corner = np.ascontiguousarray(triangles, dtype=np.int32).reshape(-1)
    return np.asarray(link_half_edges(corner)).reshape(-1, 3)


@njit(nogil=True)
def is_triangulation(
    points: np.ndarray, ring_offsets: np.ndarray, corner: np.ndarray, twin: np.ndarray
) -> bool:
    """Whether triangles, given by half-edges, cover a polygon once: edges add up to its rings."""
    n = len(points)
    if len(corner) != 3 * (n + 2 * (len(ring_offsets) - 2) - 2):
        return False
    following = np.arange(1, n + 1)
    for ring in range(len(ring_offsets) - 1):
        following[ring_offsets[ring + 1] - 1] = ring_offsets[ring]
    edges = 0
    for row in range(0, len(corner), 3):
        a, b, c = corner[row], corner[row + 1], corner[row + 2]
        if orientation(points, a, b, c) <= 0.0:
            return False
        for e in range(3):
            if twin[row + e] < 0:
                edges += 1
                if following[a] != b and following[b] != a:
                    return False
            a, b, c = b, c, a
    return edges == n
