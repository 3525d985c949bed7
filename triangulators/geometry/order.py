"""The order in which triangles are given: neighbours one after another, the new vertex last.

What draws triangles shades a vertex again once it has left its cache, or where a batch ends. So
the triangles are walked along their dual graph, depth first and always into the smaller part
first: then only some log2(m) edges wait at any time for what lies beyond them. Each triangle
begins with the edge over which it is reached: a program that looks its vertices up in a cache then
finds, finds, misses, triangle after triangle, which a processor learns to foresee.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.unfold import neighbours_of


def walk(triangles: np.ndarray, count: int) -> np.ndarray:
    """Return triangles (m, 3) of `count` points in the order of a walk; each is only turned."""
    rows = np.ascontiguousarray(triangles, dtype=np.int32)
    return walk_of(rows, count) if len(rows) > 1 else rows


@njit(nogil=True)
def walk_of(triangles: np.ndarray, count: int) -> np.ndarray:
    """Do the work of `walk`, for int32 triangles."""
    return walk_along(triangles, neighbours_of(triangles, count), count)


@njit(nogil=True)
def walk_along(triangles: np.ndarray, across: np.ndarray, count: int) -> np.ndarray:
    """Do the work of `walk` where the neighbours (m, 3) are known."""
    rows = _rows_of(across)
    ordered = np.empty_like(triangles)
    met = np.zeros(count, dtype=np.bool_)
    for row in range(len(ordered)):
        a, b, c = triangles[rows[row], 0], triangles[rows[row], 1], triangles[rows[row], 2]
        # Turned, not mirrored: a triangle's orientation means something.
        if met[c] and met[b] and not met[a]:
            a, b, c = b, c, a
        elif met[c] and not met[b]:
            a, b, c = c, a, b
        ordered[row, 0], ordered[row, 1], ordered[row, 2] = a, b, c
        met[a], met[b], met[c] = True, True, True
    return ordered


@njit(nogil=True)
def _rows_of(across: np.ndarray) -> np.ndarray:
    """Return the (m,) rows of triangles in the order of the walk, by their neighbours (m, 3).

    Each part that hangs together is walked from its first triangle with one neighbour, or from
    its first; where the dual graph has cycles, along a tree grown breadth first.
    """
    m = len(across)
    parent = np.full(m, -2, dtype=np.int32)
    size = np.ones(m, dtype=np.int32)
    queue = np.empty(m, dtype=np.int32)
    order = np.empty(m, dtype=np.int32)
    stack = np.empty(m, dtype=np.int32)
    done = 0
    for first in range(m):
        if parent[first] == -2:
            root = _leaf(across, first, parent, queue)
            done = _walk_part(across, root, parent, size, queue, stack, order, done)
        if parent[first] == -2:  # no way leads from the leaf back, where edges have three sides
            done = _walk_part(across, first, parent, size, queue, stack, order, done)
    return order


@njit(nogil=True)
def _walk_part(
    across: np.ndarray,
    root: int,
    parent: np.ndarray,
    size: np.ndarray,
    queue: np.ndarray,
    stack: np.ndarray,
    order: np.ndarray,
    done: int,
) -> int:
    """Append to `order`, from `done` on, what is reached from `root`; return the new end."""
    parent[root] = -1
    queue[0] = root
    head, tail = 0, 1
    while head < tail:
        row = queue[head]
        head += 1
        came = _edge_to(across, row, parent[row])
        for step in range(3):
            other = across[row, (came + step) % 3]
            if other >= 0 and parent[other] == -2:
                parent[other] = row
                queue[tail] = other
                tail += 1
    for at in range(tail - 1, 0, -1):
        size[parent[queue[at]]] += size[queue[at]]
    stack[0] = root
    height = 1
    while height > 0:
        height -= 1
        row = stack[height]
        order[done] = row
        done += 1
        begin = height
        came = _edge_to(across, row, -4 - parent[row])
        for step in range(3):
            other = across[row, (came + step) % 3]
            if other >= 0 and parent[other] == row:
                parent[other] = -4 - row  # once, even where two edges lead to it
                at = height
                while at > begin and size[stack[at - 1]] < size[other]:
                    stack[at] = stack[at - 1]
                    at -= 1
                stack[at] = other
                height += 1
    return done


@njit(nogil=True)
def _edge_to(across: np.ndarray, row: int, other: int) -> int:
    """Return the edge from `row` to `other`: where to begin, however the triangle is turned."""
    for e in range(3):
        if other >= 0 and across[row, e] == other:
            return e
    return 0


@njit(nogil=True)
def _leaf(across: np.ndarray, first: int, parent: np.ndarray, queue: np.ndarray) -> int:
    """Return a triangle with at most one neighbour that hangs together with `first`, or `first`."""
    queue[0] = first
    parent[first] = -3
    head, tail, found = 0, 1, -1
    while head < tail and found < 0:
        row = queue[head]
        head += 1
        degree = 0
        for e in range(3):
            other = across[row, e]
            if other >= 0:
                degree += 1
                if parent[other] == -2:
                    parent[other] = -3
                    queue[tail] = other
                    tail += 1
        if degree <= 1:
            found = row
    for at in range(tail):
        parent[queue[at]] = -2
    return found if found >= 0 else first
