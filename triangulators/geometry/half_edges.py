"""Triangles as half-edges: triangle t has 3 t, 3 t + 1 and 3 t + 2, each from a corner to the next.

The other half of the same edge, in the triangle beyond, is its twin.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import turn


@njit(nogil=True)
def link(corner: np.ndarray) -> np.ndarray:
    """Return the twin of each of (3 m,) half-edges, (3 m,), or -1; a half-edge is its twin's twin.

    corner: where each begins. One that has several is linked with the first that has none yet.

    A table with open addressing, at most two thirds full, holds the half-edges that have no twin
    yet, under a number that both directions of an edge have. So each is looked for once, in the
    order given: 3 m look-ups, in which one that has found its twin is stepped over.
    """
    count = len(corner)
    bits = 4
    while 1 << bits < count + (count >> 1):
        bits += 1
    mask = (1 << bits) - 1
    slots = np.full(mask + 1, -1, dtype=np.int32)
    twin = np.full(count, -1, dtype=np.int32)
    for e in range(count):
        tail, head = np.int64(corner[e]), np.int64(corner[e + 1 if e % 3 < 2 else e - 2])
        low, high = min(tail, head), max(tail, head)
        at = (((low + high * 0x9E3779B1) * 0x85EBCA6B) & 0xFFFFFFFF) >> (32 - bits)
        found = slots[at]
        while found >= 0 and not (
            corner[found] == head
            and twin[found] < 0
            and corner[found + 1 if found % 3 < 2 else found - 2] == tail
        ):
            at = (at + 1) & mask
            found = slots[at]
        if found < 0:
            slots[at] = e
        else:
            twin[e] = found
            twin[found] = e
    return twin


def twins_of(triangles: np.ndarray) -> np.ndarray:
    """Return (m, 3): the twin of the half-edge from corner e of triangles (m, 3), or -1."""
    corner = np.ascontiguousarray(triangles, dtype=np.int32).reshape(-1)
    return np.asarray(link(corner)).reshape(-1, 3)


@njit(nogil=True)
def is_triangulation(
    points: np.ndarray, ends: np.ndarray, corner: np.ndarray, twin: np.ndarray
) -> bool:
    """Whether triangles all turn left and what they do not share is the rings' edges, once each.

    points (n, 2): rings, in whichever direction, which end at `ends`; corner, twin: (3 m,), as
    `link` has them. n + 2 h - 2 triangles that turn left, whose edges are the boundary's or lie
    between two of them, add up to the boundary as a chain, and so cover what it encloses once.
    """
    n = len(points)
    if len(corner) != 3 * (n + 2 * (len(ends) - 1) - 2):
        return False
    following = np.arange(1, n + 1)
    start = 0
    for end in ends:
        following[end - 1] = start
        start = end
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
