"""Cut a triangulated region open along its own diagonals, into one simple polygon.

A region whose triangles hang together as a tree is a simple polygon, if vertices are told apart by
where on its outline they are met. So choosing a tree of neighbouring triangles *is* choosing the
cuts, holes need no geometry, and the triangulation at hand is one of the polygon's own.

`grow` chooses the tree, `unfold` walks it from its root and gives the polygon as a cycle of
corners, and `fold_back` puts another triangulation of that cycle in the place of the tree's. All
take a time that goes by the triangles of the tree, but for `grow` and `fold_back`, which also clear
a mark for each triangle of the whole.

Half-edges are numbers as in `half_edges`; twin (m, 3) is what `twins_of` gives.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.half_edges import link


@njit(nogil=True)
def grow(
    twin: np.ndarray,
    root: int,
    most: int,
    depth_first: bool,
    turn: int,
    tree: np.ndarray,
    rows: np.ndarray,
) -> int:
    """Grow a tree of neighbouring triangles from `root`; return how many, `most` or fewer.

    Breadth first makes a compact region, depth first a long one; the edges of a triangle are taken
    from number `turn` on. Each choice leaves other edges uncrossed, which are the cuts. Writes the
    triangles to `rows` and marks, in `tree` (m, 3), the edges crossed, from both sides. `tree`
    comes in without marks.
    """
    # Half-edges over which to enter triangles. A triangle may be there three times: it is entered
    # once, and passed over later. The root's is there for its number; it is entered over none.
    ahead = np.empty(3 * most + 3, dtype=np.int32)
    ahead[0] = 3 * root
    first, last, size = 0, 1, 0
    seen = np.zeros(len(twin), dtype=np.bool_)
    while first < last and size < most:
        if depth_first:
            last -= 1
            entry = ahead[last]
        else:
            entry = ahead[first]
            first += 1
        row = entry // 3
        if seen[row]:
            continue
        seen[row] = True
        rows[size] = row
        size += 1
        if size > 1:
            back = twin[row, entry % 3]
            tree[row, entry % 3] = tree[back // 3, back % 3] = True
        for step in range(3):
            other = twin[row, (step + turn) % 3]
            if other >= 0 and not seen[other // 3]:
                ahead[last] = other
                last += 1
    return size


@njit(nogil=True)
def unfold(
    triangles: np.ndarray, twin: np.ndarray, tree: np.ndarray, root: int, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut a tree of triangles out; return (cycle, local triangles, outline).

    triangles: (m, 3); tree: (m, 3), as left by `grow`; size: triangles in the tree, that of `root`.
    With k = size + 2: cycle (k,) holds the corners counter-clockwise, as indices of points; local
    triangles (size, 3) are the tree's, breadth first, as positions in the cycle; outline (k,) holds
    the half-edge that follows each corner.

    The outline is a linked list, at first of the root's three corners. A triangle that is reached
    over the side tail-head puts its apex between them, as a corner of its own, whether or not its
    point is a corner already: that is the cut. Invariant: the first `done` triangles have met all
    their neighbours, those up to `known` are on the outline.
    """
    corner = np.empty(size + 2, dtype=np.int32)  # point of each corner, in order of discovery
    after = np.empty(size + 2, dtype=np.int32)  # the corner next on the outline
    edge = np.empty(size + 2, dtype=np.int32)  # half-edge from the corner to that one
    local = np.empty((size, 3), dtype=np.int32)
    rows = np.empty(size, dtype=np.int32)
    entered = np.empty(size, dtype=np.int32)  # edge through which a triangle was reached
    for k in range(3):
        corner[k] = triangles[root, k]
        after[k] = (k + 1) % 3
        edge[k] = 3 * root + k
        local[0, k] = k
    rows[0], entered[0] = root, -1
    done, known = 0, 1
    while done < known:
        row = rows[done]
        for e in range(3):
            if e == entered[done] or not tree[row, e]:
                continue
            other, entry = twin[row, e] // 3, twin[row, e] % 3  # entry runs from head to tail
            tail, head = local[done, e], local[done, (e + 1) % 3]
            apex = known + 2
            corner[apex] = triangles[other, (entry + 2) % 3]
            after[tail], after[apex] = apex, head
            edge[tail] = 3 * other + (entry + 1) % 3
            edge[apex] = 3 * other + (entry + 2) % 3
            rows[known], entered[known] = other, entry
            local[known, entry] = head
            local[known, (entry + 1) % 3] = tail
            local[known, (entry + 2) % 3] = apex
            known += 1
        done += 1
    cycle = np.empty(size + 2, dtype=np.int32)
    outline = np.empty(size + 2, dtype=np.int32)
    place = np.empty(size + 2, dtype=np.int32)
    current = 0
    for position in range(size + 2):
        cycle[position], outline[position] = corner[current], edge[current]
        place[current] = position
        current = after[current]
    for index in range(size):
        for e in range(3):
            local[index, e] = place[local[index, e]]
    return cycle, local, outline


@njit(nogil=True)
def fold_back(
    triangles: np.ndarray,
    twin: np.ndarray,
    rows: np.ndarray,
    cycle: np.ndarray,
    outline: np.ndarray,
    better: np.ndarray,
) -> None:
    """Replace the triangles `rows` by `better` (positions in `cycle`), twins included.

    Row r of `better` takes the place of triangle rows[r]. Its half-edges are linked among
    themselves (`inner`); what has no twin there is a side of the cycle, from a position to the
    next, and takes over the twin of the half-edge that was on the outline there. That is one
    outside or, across a cut, on another place of the outline, which was replaced as well.
    """
    size = len(cycle)
    inner = link(better.reshape(-1))
    fresh = np.empty(size, dtype=np.int32)  # the new half-edge at each position
    beyond = np.empty(size, dtype=np.int32)  # the twin that the old one had
    position_of = np.full(twin.size, -1, dtype=np.int32)  # of the old one
    for index in range(len(rows)):
        for e in range(3):
            if inner[3 * index + e] < 0:
                fresh[better[index, e]] = 3 * rows[index] + e
    for position in range(size):
        position_of[outline[position]] = position
        beyond[position] = twin[outline[position] // 3, outline[position] % 3]
    for index in range(len(rows)):
        for e in range(3):
            triangles[rows[index], e] = cycle[better[index, e]]
            other = inner[3 * index + e]
            if other >= 0:
                twin[rows[index], e] = 3 * rows[other // 3] + other % 3
    for position in range(size):
        own, other = fresh[position], beyond[position]
        if other >= 0 and position_of[other] >= 0:
            other = fresh[position_of[other]]
        twin[own // 3, own % 3] = other
        if other >= 0:
            twin[other // 3, other % 3] = own
