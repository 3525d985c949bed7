"""Cut a triangulated region open along its own diagonals, into one simple polygon.

A region whose triangles hang together as a tree is a simple polygon, if vertices are told apart by
where on its outline they are met. So choosing a tree of neighbouring triangles *is* choosing the
cuts, holes need no geometry, and the triangulation at hand is one of the polygon's own.
"""

import numpy as np

from triangulators.compute.kernels import njit


def neighbours(triangles: np.ndarray, count: int) -> np.ndarray:
    """Return (m, 3): the triangle across the edge from corner e to corner e + 1, or -1.

    triangles: (m, 3), of `count` points, all wound the same way.
    """
    return neighbours_of(np.ascontiguousarray(triangles, dtype=np.int32), count)


@njit(nogil=True)
def neighbours_of(triangles: np.ndarray, count: int) -> np.ndarray:
    """Do the work of `neighbours`, for int32 triangles."""
    # Half-edges are chained by their tail; the twin of a-b is looked for among those that leave b.
    half_edges = 3 * len(triangles)
    chain = np.empty(half_edges, dtype=np.int32)
    latest = np.full(count, -1, dtype=np.int32)
    result = np.full((len(triangles), 3), -1, dtype=np.int32)
    for h in range(half_edges):
        row, e = h // 3, h % 3
        tail, head = triangles[row, e], triangles[row, (e + 1) % 3]
        twin = latest[head]
        while twin >= 0 and triangles[twin // 3, (twin + 1) % 3] != tail:
            twin = chain[twin]
        if twin >= 0:
            result[row, e] = twin // 3
            result[twin // 3, twin % 3] = row
        chain[h] = latest[tail]
        latest[tail] = h
    return result


@njit(nogil=True)
def grow(
    across: np.ndarray,
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
    ahead = np.empty((3 * most + 3, 2), dtype=np.int32)  # (triangle, the one it was reached from)
    ahead[0, 0], ahead[0, 1] = root, -1
    first, last, size = 0, 1, 0
    seen = np.zeros(len(across), dtype=np.bool_)
    while first < last and size < most:
        if depth_first:
            last -= 1
            row, parent = ahead[last, 0], ahead[last, 1]
        else:
            row, parent = ahead[first, 0], ahead[first, 1]
            first += 1
        if seen[row]:
            continue
        seen[row] = True
        rows[size] = row
        size += 1
        if parent >= 0:
            e = 0
            while across[row, e] != parent:
                e += 1
            f = 0
            while across[parent, f] != row:
                f += 1
            tree[row, e] = tree[parent, f] = True
        for step in range(3):
            other = across[row, (step + turn) % 3]
            if other >= 0 and not seen[other]:
                ahead[last, 0], ahead[last, 1] = other, row
                last += 1
    return size


@njit(nogil=True)
def unfold(
    triangles: np.ndarray, across: np.ndarray, tree: np.ndarray, root: int, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut a tree of triangles out; return (cycle, local triangles, outline).

    triangles: (m, 3); across: their neighbours; tree: (m, 3), as left by `grow`; size: triangles
    in the tree, that of `root`. With k = size + 2: cycle (k,) holds the corners counter-clockwise,
    as indices of points; local triangles (size, 3) are the tree's, as positions in the cycle;
    outline (k,) holds the half-edge 3 * row + e that follows each corner.
    """
    corner = np.empty(size + 2, dtype=np.int32)  # point of each corner, in order of discovery
    after = np.empty(size + 2, dtype=np.int32)  # the corner next on the outline
    edge = np.empty(size + 2, dtype=np.int32)  # half-edge to that corner
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
            other = across[row, e]
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
def _twins(triangles: np.ndarray, across: np.ndarray, half_edges: np.ndarray) -> np.ndarray:
    """Return the half-edge on the other side of each of `half_edges`, or -1."""
    result = np.full(len(half_edges), -1, dtype=np.int32)
    for index in range(len(half_edges)):
        row, e = half_edges[index] // 3, half_edges[index] % 3
        other = across[row, e]
        if other >= 0:
            f = 0
            while triangles[other, f] != triangles[row, (e + 1) % 3]:
                f += 1
            result[index] = 3 * other + f
    return result


@njit(nogil=True)
def fold_back(
    triangles: np.ndarray,
    across: np.ndarray,
    rows: np.ndarray,
    cycle: np.ndarray,
    outline: np.ndarray,
    better: np.ndarray,
) -> None:
    """Replace the triangles `rows` by `better` (positions in `cycle`), neighbours included."""
    size = len(cycle)
    inner = neighbours_of(better, size)
    row_at = np.empty(size, dtype=np.int32)
    edge_at = np.empty(size, dtype=np.int32)
    for index in range(len(rows)):
        for e in range(3):
            position = better[index, e]
            if inner[index, e] < 0:
                row_at[position], edge_at[position] = index, e
    # Beyond an outline edge lies a triangle outside or, across a cut, another outline edge.
    position_of = np.full(across.size, -1, dtype=np.int32)
    for position in range(size):
        position_of[outline[position]] = position
    beyond = _twins(triangles, across, outline)
    for index in range(len(rows)):
        for e in range(3):
            triangles[rows[index], e] = cycle[better[index, e]]
            if inner[index, e] >= 0:
                across[rows[index], e] = rows[inner[index, e]]
    for position in range(size):
        row, e = rows[row_at[position]], edge_at[position]
        if beyond[position] < 0:
            across[row, e] = -1
        elif position_of[beyond[position]] >= 0:
            across[row, e] = rows[row_at[position_of[beyond[position]]]]
        else:
            across[row, e] = beyond[position] // 3
            across[beyond[position] // 3, beyond[position] % 3] = row
