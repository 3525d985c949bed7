"""Half-edges of triangles: twins, and trees of adjacent triangles, unfolded into simple polygons.

Half-edges 3 t, 3 t + 1 and 3 t + 2 run from each vertex of triangle t to the next. The twin of a
half-edge is the opposite half-edge along the same edge, in the adjacent triangle.

A region whose dual graph is a tree is a simple polygon, if a vertex that occurs several times on
the outline counts as several vertices. So a tree of adjacent triangles cuts a triangulated region
open, in linear time, along the edges between its triangles that the tree does not cross. No
geometry of holes is needed.
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


@njit(nogil=True)
def grow_tree(
    twin: np.ndarray,
    root: int,
    depth_first: bool,
    first_edge: int,
    tree: np.ndarray,
    rows: np.ndarray,
    visited: np.ndarray,
    covered: np.ndarray,
    max_covered: int,
) -> int:
    """Grow a tree of up to len(rows) adjacent triangles from `root`; return their number.

    twin (m, 3): see `find_twins`. depth_first: False for a compact region, True for a long region.
    first_edge: the edge (0 to 2) of a triangle to try first. Writes the triangles' indices to
    `rows`, and marks crossed edges, from both sides, in `tree` (m, 3). visited (m,): workspace,
    False before and after. The tree has at most `max_covered` triangles flagged in covered (m,).
    """
    # Half-edges over which to enter triangles. A triangle may occur three times; the second and the
    # third are skipped. The half-edge of the root only encodes the index of the root.
    entries = np.empty(3 * len(rows) + 3, dtype=np.int32)
    entries[0] = 3 * root
    first, last, size = 0, 1, 0
    while first < last and size < len(rows):
        if depth_first:
            last -= 1
            entry = entries[last]
        else:
            entry = entries[first]
            first += 1
        row = entry // 3
        if visited[row]:
            continue
        if covered[row]:
            if max_covered == 0:
                continue
            max_covered -= 1
        visited[row] = True
        rows[size] = row
        size += 1
        if size > 1:
            back = twin[row, entry % 3]
            tree[row, entry % 3] = tree[back // 3, back % 3] = True
        for step in range(3):
            other = twin[row, (step + first_edge) % 3]
            if other >= 0 and not visited[other // 3]:
                entries[last] = other
                last += 1
    for index in range(size):
        visited[rows[index]] = False
    return size


@njit(nogil=True)
def unfold_tree(
    triangles: np.ndarray, twin: np.ndarray, tree: np.ndarray, root: int, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a tree of triangles as a simple polygon: (cycle, local triangles, outline).

    With k = size + 2: cycle (k,), the polygon's vertices counter-clockwise, as indices of points;
    local triangles (size, 3), breadth first, as positions in the cycle; outline (k,), the half-edge
    from each vertex to the next. tree: the marks of `grow_tree`.

    The outline is a linked list of corners, initially the root's. A triangle that is entered over
    the side tail-head inserts a new corner, its apex, between tail and head, even if the point has
    a corner already: the outline then runs along both sides of a cut. Invariant: the apexes of the
    first `discovered` triangles are inserted; `done` of these have been examined for neighbours.
    """
    corner = np.empty(size + 2, dtype=np.int32)  # point of each corner, in order of discovery
    after = np.empty(size + 2, dtype=np.int32)  # the next corner on the outline
    edge = np.empty(size + 2, dtype=np.int32)  # half-edge from the corner to the next
    local = np.empty((size, 3), dtype=np.int32)
    rows = np.empty(size, dtype=np.int32)
    # Edge index (0 to 2) through which a triangle was reached.
    entered = np.empty(size, dtype=np.int32)
    for k in range(3):
        corner[k] = triangles[root, k]
        after[k] = (k + 1) % 3
        edge[k] = 3 * root + k
        local[0, k] = k
    rows[0], entered[0] = root, -1
    done, discovered = 0, 1
    while done < discovered:
        row = rows[done]
        for e in range(3):
            if e == entered[done] or not tree[row, e]:
                continue
            other, entry = twin[row, e] // 3, twin[row, e] % 3  # entry runs from head to tail
            tail, head = local[done, e], local[done, (e + 1) % 3]
            apex = discovered + 2
            corner[apex] = triangles[other, (entry + 2) % 3]
            after[tail], after[apex] = apex, head
            edge[tail] = 3 * other + (entry + 1) % 3
            edge[apex] = 3 * other + (entry + 2) % 3
            rows[discovered], entered[discovered] = other, entry
            local[discovered, entry] = head
            local[discovered, (entry + 1) % 3] = tail
            local[discovered, (entry + 2) % 3] = apex
            discovered += 1
        done += 1
    cycle = np.empty(size + 2, dtype=np.int32)
    outline = np.empty(size + 2, dtype=np.int32)
    position_of = np.empty(size + 2, dtype=np.int32)
    current = 0
    for position in range(size + 2):
        cycle[position], outline[position] = corner[current], edge[current]
        position_of[current] = position
        current = after[current]
    for index in range(size):
        for e in range(3):
            local[index, e] = position_of[local[index, e]]
    return cycle, local, outline


@njit(nogil=True)
def replace_tree_triangles(
    triangles: np.ndarray,
    twin: np.ndarray,
    rows: np.ndarray,
    cycle: np.ndarray,
    outline: np.ndarray,
    better: np.ndarray,
    position_of: np.ndarray,
) -> None:
    """Replace the triangles `rows` (k,) by `better` (k, 3), positions in `cycle`; update `twin`.

    A half-edge of `better` without a twin there is a side of the cycle, and gets the twin of the
    old half-edge: outside the tree or, across a cut, at another position of the outline, where the
    half-edge is new as well. position_of (3 m,): workspace, -1 before and after.
    """
    size = len(cycle)
    inner = link_half_edges(better.reshape(-1))
    new_edge = np.empty(size, dtype=np.int32)  # the new half-edge at each position
    old_twin = np.empty(size, dtype=np.int32)  # the twin of the old half-edge
    for index in range(len(rows)):
        for e in range(3):
            if inner[3 * index + e] < 0:
                new_edge[better[index, e]] = 3 * rows[index] + e
    for position in range(size):
        position_of[outline[position]] = position
        old_twin[position] = twin[outline[position] // 3, outline[position] % 3]
    for index in range(len(rows)):
        for e in range(3):
            triangles[rows[index], e] = cycle[better[index, e]]
            other = inner[3 * index + e]
            if other >= 0:
                twin[rows[index], e] = 3 * rows[other // 3] + other % 3
    for position in range(size):
        side, other = new_edge[position], old_twin[position]
        if other >= 0 and position_of[other] >= 0:
            other = new_edge[position_of[other]]
        twin[side // 3, side % 3] = other
        if other >= 0:
            twin[other // 3, other % 3] = side
    for position in range(size):
        position_of[outline[position]] = -1
