"""Triangle order: a walk over neighbours, or an order for a vertex cache; in linear time.

Walk order: each triangle is a neighbour of an earlier triangle, and its last vertex is the new one:
lookups in a vertex cache are then hit, hit, miss. A renderer shades a vertex again after the vertex
has left the cache, or when a batch ends. So triangles are visited along the dual graph, depth
first, the smaller branch first: at most about log2(m) edges then lead to unvisited triangles. Each
connected component is walked from the first triangle with a single neighbour, or else the first
triangle, along a breadth-first spanning tree (holes are cycles of the dual graph). Neighbours are
visited from the entry edge on, so the order does not depend on the rotation of a triangle.

Vertex cache: Tipsify. Source: P. V. Sander, D. Nehab, J. Barczak, "Fast triangle reordering for
vertex locality and reduced overdraw", ACM Transactions on Graphics 26(3), 2007, section 4. The
model is a first-in first-out cache of shaded vertices. All remaining triangles around a vertex, a
fan, are emitted. The next fan is around the oldest vertex in the cache whose fan can be emitted
before the vertex leaves the cache; r triangles shade at most 2 r new vertices. If there is none,
the last emitted vertex with remaining triangles is taken, or the next by index.
"""

import numpy as np

from triangulators.compute.kernels import group_by_key, njit
from triangulators.errors import UnknownNameError, suggest
from triangulators.geometry.half_edges import link_half_edges

CACHE_SIZE = 16  # assumed size of the vertex cache; GPUs reuse 16 to 32 vertices in each batch

ORDERS = ("walk", "native")  # from neighbour to neighbour, or as the triangulator returns them

# Values in place of the half-edge over which the walk enters a triangle: the triangle is not yet
# reached, or is the first of a component.
_UNREACHED, _ROOT = -2, -1


def is_walk(order: str) -> bool:
    """Return whether an order of triangles is a walk; raise `UnknownNameError` if unknown."""
    if order not in ORDERS:
        raise UnknownNameError(f"unknown order {order!r}; {suggest(str(order), ORDERS)}")
    return order == "walk"


@njit(nogil=True)
def put_in_walk_order(triangles: np.ndarray, count: int) -> np.ndarray:
    """Return triangles (m, 3) of `count` points in walk order, rotated: the new vertex is last."""
    return put_in_walk_order_by_twins(triangles, link_half_edges(triangles.reshape(-1)), count)


@njit(nogil=True)
def put_in_walk_order_by_twins(triangles: np.ndarray, twin: np.ndarray, count: int) -> np.ndarray:
    """Return triangles (m, 3) in walk order, given the twins (3 m,); see `put_in_walk_order`."""
    rows = _find_walk_order(twin)
    ordered = np.empty_like(triangles)
    met = np.zeros(count, dtype=np.bool_)
    for row in range(len(ordered)):
        a, b, c = triangles[rows[row], 0], triangles[rows[row], 1], triangles[rows[row], 2]
        # Rotate the new vertex to the end; a rotation preserves the orientation.
        if met[c] and met[b] and not met[a]:
            a, b, c = b, c, a
        elif met[c] and not met[b]:
            a, b, c = c, a, b
        ordered[row, 0], ordered[row, 1], ordered[row, 2] = a, b, c
        met[a], met[b], met[c] = True, True, True
    return ordered


@njit(nogil=True)
def _find_walk_order(twin: np.ndarray) -> np.ndarray:
    m = len(twin) // 3
    entry = np.full(m, _UNREACHED, dtype=np.int32)  # half-edge over which a triangle is entered
    size = np.ones(m, dtype=np.int32)  # triangles in the branch below a triangle
    queue = np.empty(m, dtype=np.int32)
    order = np.empty(m, dtype=np.int32)
    stack = np.empty(m, dtype=np.int32)
    done = 0
    for first in range(m):
        if entry[first] == _UNREACHED:
            root = _find_leaf(twin, first, entry, queue)
            done = _walk_component(twin, root, entry, size, queue, stack, order, done)
    return order


@njit(nogil=True)
def _walk_component(
    twin: np.ndarray,
    root: int,
    entry: np.ndarray,
    size: np.ndarray,
    queue: np.ndarray,
    stack: np.ndarray,
    order: np.ndarray,
    done: int,
) -> int:
    """Append the component of triangle `root` to `order`, from `done` on; return the new end."""
    entry[root] = _ROOT
    queue[0] = root
    head, tail = 0, 1
    while head < tail:
        row = queue[head]
        head += 1
        for step in range(3):
            other = twin[3 * row + (max(entry[row], 0) + step) % 3]
            if other >= 0 and entry[other // 3] == _UNREACHED:
                entry[other // 3] = other
                queue[tail] = other // 3
                tail += 1
    for index in range(tail - 1, 0, -1):  # from the leaves: descendants are later in the queue
        size[twin[entry[queue[index]]] // 3] += size[queue[index]]
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
                # Insertion sort of at most two branches, three at the root: the smallest on top.
                index = height
                while index > begin and size[stack[index - 1]] < size[other // 3]:
                    stack[index] = stack[index - 1]
                    index -= 1
                stack[index] = other // 3
                height += 1
    return done


@njit(nogil=True)
def _find_leaf(twin: np.ndarray, first: int, entry: np.ndarray, queue: np.ndarray) -> int:
    """Return a triangle of the component with at most one neighbour, or else `first`."""
    queue[0] = first
    entry[first] = _ROOT
    head, tail, leaf = 0, 1, -1
    while head < tail and leaf < 0:
        row = queue[head]
        head += 1
        degree = 0
        for e in range(3):
            if twin[3 * row + e] >= 0:
                degree += 1
                other = twin[3 * row + e] // 3
                if entry[other] == _UNREACHED:
                    entry[other] = _ROOT
                    queue[tail] = other
                    tail += 1
        if degree <= 1:
            leaf = row
    for index in range(tail):
        entry[queue[index]] = _UNREACHED
    return leaf if leaf >= 0 else first


def sort_for_vertex_cache(
    triangles: np.ndarray, count: int, cache_size: int = CACHE_SIZE
) -> np.ndarray:
    """Return triangles (m, 3) of `count` points in Tipsify's order for a cache of that size."""
    rows = np.ascontiguousarray(triangles, dtype=np.int32)
    ordered: np.ndarray = rows[_order_by_tipsify(rows, count, cache_size)]
    return ordered


@njit(nogil=True)
def _order_by_tipsify(triangles: np.ndarray, count: int, cache_size: int) -> np.ndarray:
    m = len(triangles)
    begin, items = group_by_key(triangles.reshape(-1), count)
    around = items // np.int32(3)  # indices of each vertex's triangles, grouped as `items`
    remaining = np.diff(begin).astype(np.int32)  # triangles of each vertex that are not emitted yet
    # The time at which a vertex entered the cache; a shaded vertex is one step of time.
    entered = np.zeros(count, dtype=np.int64)
    time = cache_size + 1
    emitted = np.zeros(m, dtype=np.bool_)
    order = np.empty(m, dtype=np.int32)
    dead_ends = np.empty(3 * m, dtype=np.int32)  # emitted vertices, the last on top
    height, done, next_index = 0, 0, 0
    fan = 0 if count > 0 else -1
    while fan >= 0:
        bottom = height
        for at in range(begin[fan], begin[fan + 1]):
            row = around[at]
            if not emitted[row]:
                emitted[row] = True
                order[done] = row
                done += 1
                for corner in range(3):
                    vertex = triangles[row, corner]
                    dead_ends[height] = vertex
                    height += 1
                    remaining[vertex] -= 1
                    # Not in the cache: the vertex is shaded and enters.
                    if time - entered[vertex] > cache_size:
                        entered[vertex] = time
                        time += 1
        fan = _choose_next_fan(dead_ends[bottom:height], remaining, entered, time, cache_size)
        while fan < 0 and height > 0:
            height -= 1
            if remaining[dead_ends[height]] > 0:
                fan = dead_ends[height]
        while fan < 0 and next_index < count:
            if remaining[next_index] > 0:
                fan = next_index
            next_index += 1
    return order


@njit(nogil=True)
def _choose_next_fan(
    emitted: np.ndarray, remaining: np.ndarray, entered: np.ndarray, time: int, cache_size: int
) -> int:
    """Return the vertex of the next fan, among the vertices of the fan just emitted, or -1."""
    fan, best = -1, -1
    for vertex in emitted:
        if remaining[vertex] > 0:
            age = time - entered[vertex]
            priority = age if age + 2 * remaining[vertex] <= cache_size else 0
            if priority > best:
                fan, best = vertex, priority
    return fan
