"""Triangles as half-edges: triangle t has 3 t, 3 t + 1 and 3 t + 2, each from a corner to the next.

The other half of the same edge, in the triangle beyond, is its twin.
"""

from typing import Any

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import turn


@njit(nogil=True, inline="always")
def _next(e: Any) -> Any:
    """Return the half-edge after e in its triangle."""
    return e + 1 if e % 3 < 2 else e - 2


@njit(nogil=True)
def link(corner: np.ndarray) -> np.ndarray:
    """Return the twin of each of (3 m,) half-edges, (3 m,), or -1; a half-edge is its twin's twin.

    corner: where each begins. One that has several is linked with the first that has none yet.

    A table with open addressing, at most two thirds full, has one slot for each edge, under a
    number that both its directions have. In the slot stands the last half-edge of a queue: those of
    the edge that wait for a twin, all in one direction, for one in the other would take the first.
    While it waits, a half-edge holds -2 - the next one in `twin`, the last one the first: the queue
    is a ring, so its ends are found in one step, and any number of equal edges costs the same each.
    """
    count = len(corner)
    bits = 4
    while 1 << bits < count + (count >> 1):
        bits += 1
    mask = (1 << bits) - 1
    slots = np.full(mask + 1, -1, dtype=np.int32)
    twin = np.empty(count, dtype=np.int32)
    for e in range(count):
        tail, head = np.int64(corner[e]), np.int64(corner[_next(e)])
        low, high = min(tail, head), max(tail, head)
        at = (((low + high * 0x9E3779B1) * 0x85EBCA6B) & 0xFFFFFFFF) >> (32 - bits)
        last: Any = np.int64(slots[at])
        start, end = tail, head
        while last >= 0:
            start, end = np.int64(corner[last]), np.int64(corner[_next(last)])
            if (start == head and end == tail) or (start == tail and end == head):
                break
            at = (at + 1) & mask
            last = np.int64(slots[at])
        if last < 0 or twin[last] >= 0:  # none waits: a queue of its own
            slots[at] = e
            twin[e] = -2 - e
        elif start == head and end == tail:
            first = -2 - twin[last]
            twin[last] = twin[first]  # if first is last, the line below says otherwise
            twin[first] = e
            twin[e] = first
        else:
            slots[at] = e
            twin[e] = twin[last]
            twin[last] = -2 - e
    for e in range(count):
        twin[e] = max(twin[e], -1)
    return twin


def twins_of(triangles: np.ndarray) -> np.ndarray:
    """Return (m, 3): the twin of the half-edge from corner e of triangles (m, 3), or -1."""
    corner = np.ascontiguousarray(triangles, dtype=np.int32).reshape(-1)
    return np.asarray(link(corner)).reshape(-1, 3)


@njit(nogil=True)
def is_triangulation(
    points: np.ndarray, ring_offsets: np.ndarray, corner: np.ndarray, twin: np.ndarray
) -> bool:
    """Whether triangles all turn left and what they do not share is the rings' edges, once each.

    points (n, 2), ring_offsets (h + 2,): rings of either orientation; corner, twin: (3 m,), as
    `link` has them. n + 2 h - 2 triangles that turn left, whose edges are the boundary's or lie
    between two of them, add up to the boundary as a chain, and so cover what it encloses once.
    """
    n = len(points)
    if len(corner) != 3 * (n + 2 * (len(ring_offsets) - 2) - 2):
        return False
    following = np.arange(1, n + 1)
    for ring in range(len(ring_offsets) - 1):
        following[ring_offsets[ring + 1] - 1] = ring_offsets[ring]
    edges = 0
    for row in range(0, len(corner), 3):
        a, b, c = corner[row], corner[row + 1], corner[row + 2]
        if turn(points, a, b, c) <= 0.0:
            return False
        for e in range(3):
            if twin[row + e] < 0:
                edges += 1
                if following[a] != b and following[b] != a:
                    return False
            a, b, c = b, c, a
    return edges == n
