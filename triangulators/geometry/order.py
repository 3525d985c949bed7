"""The order in which triangles are given: neighbours one after another, the new vertex last.

What draws triangles shades a vertex again once it has left its cache, or where a batch ends. So
the triangles are walked along their dual graph, depth first and always into the smaller part
first: then only some log2(m) edges wait at any time for what lies beyond them. Each triangle
begins with the edge over which it is reached: a program that looks its vertices up in a cache then
finds, finds, misses, triangle after triangle, which a processor learns to foresee.

Order. Each part that hangs together is walked from its first triangle with one neighbour, or from
its first, along a tree that is grown breadth first, as the dual graph has cycles where there are
holes. The sizes of its branches are added up from its leaves; then the tree is walked with a stack.
Neighbours of a triangle are taken from the edge over which it was reached on, so that the order
does not depend on how triangles are turned. All of it takes a time that goes by their number.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.half_edges import link

_FREE, _ROOT = -2, -1  # in place of the half-edge over which a triangle is entered


def walk(triangles: np.ndarray, count: int) -> np.ndarray:
    """Return triangles (m, 3) of `count` points in the order of a walk; each is only turned."""
    rows = np.ascontiguousarray(triangles, dtype=np.int32)
    return walk_of(rows, count) if len(rows) > 1 else rows


@njit(nogil=True)
def walk_of(triangles: np.ndarray, count: int) -> np.ndarray:
    """Do the work of `walk`, for int32 triangles."""
    return walk_along(triangles, link(triangles.reshape(-1)), count)


@njit(nogil=True)
def walk_along(triangles: np.ndarray, twin: np.ndarray, count: int) -> np.ndarray:
    """Do the work of `walk` where the twins (3 m,) of half-edges are known."""
    rows = _rows_of(twin)
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
def _rows_of(twin: np.ndarray) -> np.ndarray:
    """Return the (m,) rows of triangles in the order of the walk, by their twins (3 m,)."""
    m = len(twin) // 3
    entry = np.full(m, _FREE, dtype=np.int32)  # the half-edge, of its own, over which it is entered
    size = np.ones(m, dtype=np.int32)  # triangles in its branch
    queue = np.empty(m, dtype=np.int32)
    order = np.empty(m, dtype=np.int32)
    stack = np.empty(m, dtype=np.int32)
    done = 0
    for first in range(m):
        if entry[first] == _FREE:
            root = _leaf(twin, first, entry, queue)
            done = _walk_part(twin, root, entry, size, queue, stack, order, done)
    return order


@njit(nogil=True)
def _walk_part(
    twin: np.ndarray,
    root: int,
    entry: np.ndarray,
    size: np.ndarray,
    queue: np.ndarray,
    stack: np.ndarray,
    order: np.ndarray,
    done: int,
) -> int:
    """Append to `order`, from `done` on, what is reached from `root`; return the new end.

    A half-edge leads down the tree where the triangle beyond it is entered over its twin.
    """
    entry[root] = _ROOT
    queue[0] = root
    head, tail = 0, 1
    while head < tail:
        row = queue[head]
        head += 1
        for step in range(3):
            other = twin[3 * row + (max(entry[row], 0) + step) % 3]
            if other >= 0 and entry[other // 3] == _FREE:
                entry[other // 3] = other
                queue[tail] = other // 3
                tail += 1
    for at in range(tail - 1, 0, -1):  # those further down come later in the queue
        size[twin[entry[queue[at]]] // 3] += size[queue[at]]
    stack[0] = root
    height = 1
    while height > 0:
        height -= 1
        row = stack[height]
        order[done] = row
        done += 1
        begin = height
        for step in range(3):
            other = twin[3 * row + (max(entry[row], 0) + step) % 3]
            if other >= 0 and entry[other // 3] == other:
                # Two branches at most, or the root's three: sorted in, the smallest on top.
                at = height
                while at > begin and size[stack[at - 1]] < size[other // 3]:
                    stack[at] = stack[at - 1]
                    at -= 1
                stack[at] = other // 3
                height += 1
    return done


@njit(nogil=True)
def _leaf(twin: np.ndarray, first: int, entry: np.ndarray, queue: np.ndarray) -> int:
    """Return a triangle with at most one neighbour that hangs together with `first`, or `first`.

    It is looked for breadth first; `entry` is left as it was.
    """
    queue[0] = first
    entry[first] = _ROOT
    head, tail, found = 0, 1, -1
    while head < tail and found < 0:
        row = queue[head]
        head += 1
        degree = 0
        for e in range(3):
            if twin[3 * row + e] >= 0:
                degree += 1
                other = twin[3 * row + e] // 3
                if entry[other] == _FREE:
                    entry[other] = _ROOT
                    queue[tail] = other
                    tail += 1
        if degree <= 1:
            found = row
    for at in range(tail):
        entry[queue[at]] = _FREE
    return found if found >= 0 else first
