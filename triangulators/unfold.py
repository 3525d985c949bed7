"""Cut a triangulated region open along its own diagonals, into one simple polygon.

A region whose triangles hang together as a tree is a simple polygon, if vertices are told apart by
where on its outline they are met. So choosing a tree of neighbouring triangles *is* choosing the
cuts, holes need no geometry, and the triangulation at hand is one of the polygon's own.
"""

from typing import NamedTuple

import numpy as np
from numba import njit


class Unfolded(NamedTuple):
    """A simple polygon cut out of a triangulation.

    `cycle` (k,) are its corners, counter-clockwise, as indices of points (a point met several
    times has several corners); `triangles` (k - 2, 3) are positions in `cycle`.
    """

    cycle: np.ndarray
    triangles: np.ndarray


def neighbours(triangles: np.ndarray, count: int) -> np.ndarray:
    """Return (m, 3): the triangle across the edge from corner e to corner e + 1, or -1.

    triangles: (m, 3), of `count` points, all wound the same way.
    """
    tails = triangles.astype(np.int64).ravel()
    heads = np.roll(triangles, -1, axis=1).astype(np.int64).ravel()
    keys = np.minimum(tails, heads) * count + np.maximum(tails, heads)
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    first = np.flatnonzero(ordered[1:] == ordered[:-1])
    result = np.full(len(keys), -1, dtype=np.int32)
    result[order[first]] = order[first + 1] // 3
    result[order[first + 1]] = order[first] // 3
    return result.reshape(-1, 3)


@njit(cache=True)
def unfold(
    triangles: np.ndarray, across: np.ndarray, tree: np.ndarray, root: int, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unfold the tree of triangles hanging from `root`; return (cycle, local triangles, rows).

    triangles: (m, 3); across: their `neighbours`; tree: (m, 3) bool, whether the region goes on
    across that edge (the same from both sides); size: triangles in the region. `rows` (size,) are
    the rows of `triangles` that the local triangles stand for.
    """
    corner = np.empty(size + 2, dtype=np.int32)  # point of each corner, in order of discovery
    after = np.empty(size + 2, dtype=np.int32)  # the corner next on the outline
    local = np.empty((size, 3), dtype=np.int32)
    rows = np.empty(size, dtype=np.int32)
    start = np.empty(size, dtype=np.int32)  # corner of the row that is its local corner 0
    for k in range(3):
        corner[k] = triangles[root, k]
        after[k] = (k + 1) % 3
        local[0, k] = k
    rows[0], start[0] = root, -1
    done, known = 0, 1
    while done < known:
        row = rows[done]
        for e in range(3):
            other = across[row, e]
            if e == start[done] or not tree[row, e]:
                continue
            tail, head = local[done, e], local[done, (e + 1) % 3]
            entry = 0
            while (
                triangles[other, entry] != corner[head]
                or triangles[other, (entry + 1) % 3] != corner[tail]
            ):
                entry += 1
            apex = known + 2
            corner[apex] = triangles[other, (entry + 2) % 3]
            after[tail], after[apex] = apex, head
            rows[known], start[known] = other, entry
            local[known, entry] = head
            local[known, (entry + 1) % 3] = tail
            local[known, (entry + 2) % 3] = apex
            known += 1
        done += 1
    cycle = np.empty(size + 2, dtype=np.int32)
    place = np.empty(size + 2, dtype=np.int32)
    current = 0
    for position in range(size + 2):
        cycle[position] = corner[current]
        place[current] = position
        current = after[current]
    for index in range(size):
        for e in range(3):
            local[index, e] = place[local[index, e]]
    return cycle, local, rows


@njit(cache=True)
def spanning_tree(across: np.ndarray, root: int, order: np.ndarray) -> tuple[np.ndarray, int]:
    """Return a tree (m, 3) over the triangles reachable from `root`, and how many they are.

    Depth first, trying the edges of each triangle in the order of `order` (m,), a number 0..5 for
    each triangle: different numbers give different cuts.
    """
    permutations = np.array(
        [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]], dtype=np.int32
    )
    tree = np.zeros(across.shape, dtype=np.bool_)
    seen = np.zeros(len(across), dtype=np.bool_)
    stack = [(root, -1)]
    size = 0
    while len(stack) > 0:
        row, parent = stack.pop()
        if seen[row]:
            continue
        seen[row] = True
        size += 1
        for e in range(3):
            if parent >= 0 and across[row, e] == parent:
                for f in range(3):
                    if across[parent, f] == row:
                        tree[row, e] = tree[parent, f] = True
                        break
                break
        for e in permutations[order[row]]:
            if across[row, e] >= 0 and not seen[across[row, e]]:
                stack.append((across[row, e], row))  # noqa: PERF401 - compiled
    return tree, size
