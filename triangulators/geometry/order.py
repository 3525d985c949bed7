"""The order in which triangles are given: a walk over neighbours, or an order for a vertex cache.

Walk: neighbours one after another, the new vertex last. What draws triangles shades a vertex again
once it has left its cache, or where a batch ends. So the triangles are walked along their dual
graph, depth first and always into the smaller part first: then only some log2(m) edges wait at any
time for what lies beyond them. Each triangle begins with the edge over which it is reached: a
program that looks its vertices up in a cache then finds, finds, misses, triangle after triangle,
which a processor learns to foresee.

Order. Each part that hangs together is walked from its first triangle with one neighbour, or from
its first, along a tree that is grown breadth first, as the dual graph has cycles where there are
holes. The sizes of its branches are added up from its leaves; then the tree is walked with a stack.
Neighbours of a triangle are taken from the edge over which it was reached on, so that the order
does not depend on how triangles are turned. All of it takes a time that goes by their number.

Vertex cache: Tipsify, in linear time. Source: P. V. Sander, D. Nehab, J. Barczak, "Fast triangle
reordering for vertex locality and reduced overdraw", ACM Transactions on Graphics 26(3), 2007,
section 4.

A first-in first-out cache of shaded vertices is assumed. All triangles around one vertex are given
one after another, a fan; then the next fan begins at a vertex that is still in the cache. Of those
it takes the one that entered the cache first, if its own fan can be given before it drops out:
a fan of r triangles shades at most 2 r new vertices. Where none is left, it goes back along the
vertices given, and then to the next vertex by number.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.compute.operations import grouped
from triangulators.geometry.half_edges import link

CACHE_SIZE = 16
"""Shaded vertices that are assumed to be kept. GPUs keep 16 to 32 in each batch."""

_FREE, _ROOT = -2, -1  # in place of the half-edge over which a triangle is entered


@njit(nogil=True)
def walk(triangles: np.ndarray, count: int) -> np.ndarray:
    """Return triangles (m, 3) of `count` points in the order of a walk; each is only turned."""
    return walk_along(triangles, link(triangles.reshape(-1)), count)


@njit(nogil=True)
def walk_along(triangles: np.ndarray, twin: np.ndarray, count: int) -> np.ndarray:
    """Do the work of `walk` where the twins (3 m,) of half-edges are known."""
    rows = _walked_rows(twin)
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
def _walked_rows(twin: np.ndarray) -> np.ndarray:
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


def vertex_cache_order(
    triangles: np.ndarray, count: int, cache_size: int = CACHE_SIZE
) -> np.ndarray:
    """Return triangles (m, 3) of `count` points in the order of a vertex cache; none is turned."""
    rows = np.ascontiguousarray(triangles, dtype=np.int32)
    ordered: np.ndarray = rows[_rows_of(rows, count, cache_size)]
    return ordered


@njit(nogil=True)
def _rows_of(triangles: np.ndarray, count: int, cache_size: int) -> np.ndarray:
    """Return the (m,) rows of triangles in the order of Tipsify."""
    m = len(triangles)
    begin, places = grouped(triangles.reshape(-1), count)
    around = places // np.int32(3)  # the rows of each vertex's triangles
    left = np.diff(begin).astype(np.int32)  # how many of them are not given yet
    entered = np.zeros(count, dtype=np.int64)  # the time at which a vertex entered the cache
    time = cache_size + 1
    given = np.zeros(m, dtype=np.bool_)
    order = np.empty(m, dtype=np.int32)
    back = np.empty(3 * m, dtype=np.int32)  # vertices given, the last on top
    height, done, following = 0, 0, 0
    fan = 0 if count > 0 else -1
    while fan >= 0:
        bottom = height
        for at in range(begin[fan], begin[fan + 1]):
            row = around[at]
            if not given[row]:
                given[row] = True
                order[done] = row
                done += 1
                for corner in range(3):
                    vertex = triangles[row, corner]
                    back[height] = vertex
                    height += 1
                    left[vertex] -= 1
                    if time - entered[vertex] > cache_size:  # it is not in the cache: it is shaded
                        entered[vertex] = time
                        time += 1
        fan = _next_fan(back[bottom:height], left, entered, time, cache_size)
        while fan < 0 and height > 0:
            height -= 1
            if left[back[height]] > 0:
                fan = back[height]
        while fan < 0 and following < count:
            if left[following] > 0:
                fan = following
            following += 1
    return order


@njit(nogil=True)
def _next_fan(
    given: np.ndarray, left: np.ndarray, entered: np.ndarray, time: int, cache_size: int
) -> int:
    """Return which of the vertices just given the next fan is around; -1 where none has one."""
    fan, best = -1, -1
    for vertex in given:
        if left[vertex] > 0:
            age = time - entered[vertex]
            priority = age if age + 2 * left[vertex] <= cache_size else 0
            if priority > best:
                fan, best = vertex, priority
    return fan
