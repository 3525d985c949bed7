"""What a device found, into triangles in the order in which the CPU gives them.

A device gives each apex k the base (i, j) of its triangle: every corner of a ring but the first and
the last is the apex of exactly one. So the triangles are a binary tree. The pair (i, j) is the side
of one more triangle, whose base is longer: that of apex j, if it begins at i too, else that of apex
i. The tree is walked from the pair (0, n - 1) as the CPU walks its table.

Nothing that comes from a driver is trusted. It has to be such a tree, all its triangles have to
turn left, so that they are a triangulation, and their diagonals have to add up to the cost that
came with them. A ring of which one of these does not hold is left to the CPU.
"""

import numpy as np

from triangulators.compute.copies import copy_rows
from triangulators.compute.kernels import njit
from triangulators.geometry.order import walk_of
from triangulators.gpu.rings import MOST, Rings
from triangulators.optimum.small_ring import SMALL


@njit(nogil=True)
def place(
    which: np.ndarray,
    bases: np.ndarray,
    worst: bool,
    rings: Rings,
    starts: np.ndarray,
    triangles: np.ndarray,
    done: np.ndarray,
) -> None:
    """Write the triangles of the rings `which`; mark those in `done` that are as they should be.

    bases: (n,) uint32, as many as corners: the cost of the ring at its first, i | j << 16 at apex
    k; worst: whether the longest diagonals were looked for. For the others see `Batch`.
    """
    begins, corners, longest, turned = rings.begins, rings.corners, rings.longest, rings.turned
    below = np.empty((MOST, 2), dtype=np.int32)
    stack = np.empty(MOST, dtype=np.int32)
    for task in range(len(which)):
        index = which[task]
        begin, end = begins[index], begins[index + 1]
        own = triangles[starts[index] : starts[index + 1]]
        base, ring = bases[begin:end], corners[begin:end]
        least = longest[index] if worst else -1
        if not _walk(base, ring, least, below, stack, own):
            continue
        n = end - begin
        if turned[index]:
            for row in range(n - 2):
                for e in range(3):
                    own[row, e] = n - 1 - own[row, e]
        if n > SMALL:
            copy_rows(walk_of(own, n), own)
        done[index] = True


@njit(nogil=True)
def _walk(
    bases: np.ndarray,
    corners: np.ndarray,
    longest: int,
    below: np.ndarray,
    stack: np.ndarray,
    triangles: np.ndarray,
) -> bool:
    """Write the triangles (n - 2, 3) of a ring; False if they are no triangulation of that cost.

    longest: w + h of the box where diagonals cost that less their length, -1 where they cost it.
    """
    n = len(bases)
    stack[0] = _grow(bases, below)
    if stack[0] < 0:
        return False
    height, found, total = 1, 0, np.int64(0)
    while height > 0:
        height -= 1
        k = stack[height]
        i, j = np.int64(bases[k] & 0xFFFF), np.int64(bases[k] >> 16)
        ax, ay = np.int64(corners[k, 0]) - corners[i, 0], np.int64(corners[k, 1]) - corners[i, 1]
        bx, by = np.int64(corners[j, 0]) - corners[i, 0], np.int64(corners[j, 1]) - corners[i, 1]
        if ax * by - ay * bx <= 0:
            return False
        if j - i < n - 1:
            length = abs(bx) + abs(by)
            total += length if longest < 0 else longest - length
        left, right = below[k, 0], below[k, 1]
        # As `small_ring` and `edge_table` have it: the new vertex last and the smaller side first,
        # or in the ring's order and the right side first; of more than SMALL, `walk` follows.
        if n <= SMALL:
            triangles[found, 0], triangles[found, 1], triangles[found, 2] = j, i, k
            if k - i <= j - k:
                left, right = right, left
        else:
            triangles[found, 0], triangles[found, 1], triangles[found, 2] = i, k, j
        found += 1
        if left >= 0:
            stack[height] = left
            height += 1
        if right >= 0:
            stack[height] = right
            height += 1
    return found == n - 2 and total == np.int64(bases[0])


@njit(nogil=True)
def _grow(bases: np.ndarray, below: np.ndarray) -> int:
    """Link each apex below the one whose triangle has its base for a side; return the top or -1.

    below (n, 2): the apexes over the sides (i, k) and (k, j) of apex k, -1 where that is none.
    """
    n, top = len(bases), -1
    below[:n] = -1
    for k in range(1, n - 1):
        i, j = np.int64(bases[k] & 0xFFFF), np.int64(bases[k] >> 16)
        if not i < k < j < n:
            return -1
        if j - i == n - 1:
            if top >= 0:
                return -1
            top = k
        elif j < n - 1 and np.int64(bases[j] & 0xFFFF) == i and below[j, 0] < 0:
            below[j, 0] = k
        elif i > 0 and np.int64(bases[i] >> 16) == j and below[i, 1] < 0:
            below[i, 1] = k
        else:
            return -1
    return top
