"""Which corners of a simple polygon see each other, by walking a triangulation of it.

From a corner the view widens triangle by triangle through the edges that remain in sight. Source:
Q. Xu et al., F. Bungiu et al., "Efficient computation of visibility polygons" (triangular
expansion), 2014. The work is proportional to the triangles seen, not to pairs of corners times
edges, and only orientations are evaluated.

Derivation. From corner v, an edge right-left of a triangle that has v for its apex is a window.
Through it one looks into the triangle beyond, whose third corner is the apex of two more windows.
What remains in sight is the cone between two rays from v, through the corners `view_right` and
`view_left` that have narrowed it so far. The apex is inside the cone, right of it or left of it:

    inside: v sees it, the cone splits, and both windows beyond are looked through;
    right of the cone (on its ray too): only the left window is in sight, the cone stays;
    left of it: only the right window.

Each window is looked through at most once from each corner, because the triangles hang together
as a tree.

Rounding. The two tests are orientations of v and two other corners, decided exactly, so a corner on
a ray is hidden by the corner that the ray goes through: the segment to it would touch the boundary.

Loop order. Windows are taken from a stack, the right one on top of the apex and that on top of the
left one. So corners are met in the order of the cycle, and the lists of visible pairs come out
ascending without being sorted. Only corners after v are wanted; windows that lie wholly before it
are never looked through.
"""

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import turn


@njit(nogil=True)
def visible_pairs(
    points: np.ndarray, triangles: np.ndarray, twin: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (start, target): corner i sees `target[start[i]:start[i + 1]]`, ascending, all > i.

    points: (n, 2), a counter-clockwise cycle; triangles: (n - 2, 3), any triangulation of it, and
    `twin` (n - 2, 3), see `half_edges`. Sides of the polygon are included; a diagonal counts if its
    open segment meets the boundary nowhere. Stops early, with `start[n] > most`, if there are more
    than `most` pairs.
    """
    n = len(points)
    start = np.zeros(n + 1, dtype=np.int64)
    target = np.empty(max(4 * n, 16), dtype=np.int32)
    side = np.empty(n, dtype=np.int32)  # the half-edge from each corner to the next
    for row in range(len(triangles)):
        for e in range(3):
            if triangles[row, (e + 1) % 3] == (triangles[row, e] + 1) % n:
                side[triangles[row, e]] = 3 * row + e
    stack = np.empty((3 * n + 16, 5), dtype=np.int32)
    found = 0
    for v in range(n):
        if found + n > len(target):
            grown = np.empty(2 * len(target) + n, dtype=np.int32)
            grown[:found] = target[:found]
            target = grown
        start[v] = found
        if found > most:
            start[n] = found
            return start, target
        # The triangles at v, counter-clockwise: h is the half-edge of the next one that leaves v.
        h = side[v]
        while h >= 0:
            row, e = h // 3, h % 3
            right, left = triangles[row, (e + 1) % 3], triangles[row, (e + 2) % 3]
            if right < v:
                break
            target[found] = right
            found += 1
            if twin[row, (e + 1) % 3] >= 0:
                stack[0, 0], stack[0, 1], stack[0, 2] = twin[row, (e + 1) % 3], right, left
                found = _look(points, triangles, twin, v, v, stack, target, found)
            h = twin[row, (e + 2) % 3]
            if h < 0 and left > v:
                target[found] = left
                found += 1
    start[n] = found
    # Without the space that it has grown into, of which a view would keep all.
    return start, target[:found].copy()


@njit(nogil=True)
def _look(
    points: np.ndarray,
    triangles: np.ndarray,
    twin: np.ndarray,
    v: int,
    floor: int,
    stack: np.ndarray,
    target: np.ndarray,
    found: int,
) -> int:
    """Append the corners > floor seen from v through a window to `target`, in order.

    stack: work to do, the last first: (the window's half-edge in the triangle beyond, which runs
    left to right; right end, left end, right and left of the view), or a corner to report, written
    (-1, corner, ...). The window is in its first row, without the view.
    """
    height = 1
    stack[0, 3], stack[0, 4] = stack[0, 1], stack[0, 2]
    while height > 0:
        height -= 1
        window, right, left = stack[height, 0], stack[height, 1], stack[height, 2]
        if window < 0:
            target[found] = right
            found += 1
            continue
        view_right, view_left = stack[height, 3], stack[height, 4]
        row, e = window // 3, window % 3
        apex = triangles[row, (e + 2) % 3]
        over_right, over_left = twin[row, (e + 1) % 3], twin[row, (e + 2) % 3]
        hidden_right = turn(points, v, view_right, apex) <= 0.0
        hidden_left = not hidden_right and turn(points, v, apex, view_left) <= 0.0
        split = not (hidden_right or hidden_left)
        # With floor v, corners of a cycle before v list v themselves, and nothing lies beyond.
        seen = split and apex > floor
        if not hidden_left and apex > floor and over_left >= 0:
            stack[height, 0], stack[height, 1], stack[height, 2] = over_left, apex, left
            stack[height, 3] = apex if split else view_right
            stack[height, 4] = view_left
            height += 1
        if seen:
            stack[height, 0], stack[height, 1] = -1, apex
            height += 1
        if not hidden_right and over_right >= 0:
            stack[height, 0], stack[height, 1], stack[height, 2] = over_right, right, apex
            stack[height, 3] = view_right
            stack[height, 4] = apex if split else view_left
            height += 1
    return found


@njit
def visible_sites(points: np.ndarray, triangles: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """Return the pairs (p, 2) of points, a < b, that see each other in any triangulated polygon.

    points: (n, 2); triangles: (m, 3), with their twins. Edges of triangles are included.
    """
    n = len(points)
    stack = np.empty((3 * len(triangles) + 16, 5), dtype=np.int32)
    seen = np.empty(3 * len(triangles) + 16, dtype=np.int32)
    pairs = np.empty((max(4 * n, 16), 2), dtype=np.int32)
    found = 0
    for row in range(len(triangles)):
        for e in range(3):
            v = triangles[row, e]
            right, left = triangles[row, (e + 1) % 3], triangles[row, (e + 2) % 3]
            seen[0] = right
            count = 1
            if twin[row, (e + 2) % 3] < 0:
                seen[1] = left
                count = 2
            if twin[row, (e + 1) % 3] >= 0:
                stack[0, 0], stack[0, 1], stack[0, 2] = twin[row, (e + 1) % 3], right, left
                count = _look(points, triangles, twin, v, -1, stack, seen, count)
            if found + count > len(pairs):
                grown = np.empty((2 * (found + count), 2), dtype=np.int32)
                grown[:found] = pairs[:found]
                pairs = grown
            for index in range(count):
                if seen[index] > v:
                    pairs[found, 0], pairs[found, 1] = v, seen[index]
                    found += 1
    return pairs[:found]
