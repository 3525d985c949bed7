"""Visible pairs of vertices of a simple polygon, by triangular expansion.

Source: Q. Xu et al., F. Bungiu et al., "Efficient computation of visibility polygons" (triangular
expansion), 2014. The time is proportional to the number of triangles seen from all vertices, and
only orientations are evaluated.

Derivation. The edge right-left opposite to v in a triangle at v is a window of v. The triangle
behind the window has a third vertex, the apex, and two more edges, the next windows. The view
through a window is the cone between the rays from v through the vertices `view_right` and
`view_left` that narrowed the view so far. The apex is inside, right of or left of the cone:

    inside: v sees the apex, the cone splits, and both windows are visible;
    right of the cone or on the right ray: only the left window is visible, the cone stays;
    left of the cone or on the left ray: only the right window.

Each window is visited at most once from each vertex, because the dual graph is a tree. Both tests
are exact orientations of three vertices. A vertex on a ray is hidden by the vertex that defines the
ray: the segment from v would touch the boundary.

Loop order. A stack has the right window on top, then the apex, then the left window, so visible
vertices are appended in the order of the cycle, without sorting. Only vertices after v are
appended; windows whose vertices are all before v are never visited.
"""

import numpy as np

from triangulators.compute.kernels import copy_row, copy_rows, njit
from triangulators.geometry.predicates import orientation


@njit(nogil=True)
def find_visible_pairs(
    points: np.ndarray, triangles: np.ndarray, twin: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (start, target): `target[start[i]:start[i + 1]]` are the vertices > i that i sees.

    points (n, 2): a counter-clockwise cycle; triangles (n - 2, 3): any triangulation. Lists ascend
    and include sides.
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
    count = 0
    for v in range(n):
        if count + n > len(target):
            grown = np.empty(2 * len(target) + n, dtype=np.int32)
            copy_row(target[:count], grown)
            target = grown
        start[v] = count
        # Visit the triangles at v counter-clockwise; h is the half-edge from v of the next
        # triangle.
        h = side[v]
        while h >= 0:
            row, e = h // 3, h % 3
            right, left = triangles[row, (e + 1) % 3], triangles[row, (e + 2) % 3]
            if right < v:
                break
            target[count] = right
            count += 1
            if twin[row, (e + 1) % 3] >= 0:
                stack[0, 0], stack[0, 1], stack[0, 2] = twin[row, (e + 1) % 3], right, left
                count = _append_seen_through_window(
                    points, triangles, twin, v, v, stack, target, count
                )
            h = twin[row, (e + 2) % 3]
            if h < 0 and left > v:
                target[count] = left
                count += 1
    start[n] = count
    # Return a copy, because a view would keep all of the oversized array in memory.
    return start, target[:count].copy()


@njit(nogil=True)
def _append_seen_through_window(
    points: np.ndarray,
    triangles: np.ndarray,
    twin: np.ndarray,
    v: int,
    floor: int,
    stack: np.ndarray,
    target: np.ndarray,
    count: int,
) -> int:
    """Append the vertices > floor that v sees through a window to `target`; return the new count.

    stack (k, 5): workspace; on entry row 0 has the first three columns of the window. A row is a
    window: half-edge of the triangle behind it, from left to right; right end; left end; vertices
    on the right and left rays that bound the view. Or it is (-1, vertex, ...): a vertex to append.
    """
    height = 1
    stack[0, 3], stack[0, 4] = stack[0, 1], stack[0, 2]
    while height > 0:
        height -= 1
        window, right, left = stack[height, 0], stack[height, 1], stack[height, 2]
        if window < 0:
            target[count] = right
            count += 1
            continue
        view_right, view_left = stack[height, 3], stack[height, 4]
        row, e = window // 3, window % 3
        apex = triangles[row, (e + 2) % 3]
        over_right, over_left = twin[row, (e + 1) % 3], twin[row, (e + 2) % 3]
        hidden_right = orientation(points, v, view_right, apex) <= 0.0
        hidden_left = not hidden_right and orientation(points, v, apex, view_left) <= 0.0
        split = not (hidden_right or hidden_left)
        # `find_visible_pairs` passes v as `floor`: a pair is listed only at its lower index.
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
    return count


@njit
def find_visible_sites(points: np.ndarray, triangles: np.ndarray, twin: np.ndarray) -> np.ndarray:
    """Return the pairs (p, 2) of points, a < b, that see each other, including boundary edges."""
    n = len(points)
    stack = np.empty((3 * len(triangles) + 16, 5), dtype=np.int32)
    seen = np.empty(3 * len(triangles) + 16, dtype=np.int32)
    pairs = np.empty((max(4 * n, 16), 2), dtype=np.int32)
    size = 0
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
                count = _append_seen_through_window(
                    points, triangles, twin, v, -1, stack, seen, count
                )
            if size + count > len(pairs):
                grown = np.empty((2 * (size + count), 2), dtype=np.int32)
                copy_rows(pairs[:size], grown)
                pairs = grown
            for index in range(count):
                if seen[index] > v:
                    pairs[size, 0], pairs[size, 1] = v, seen[index]
                    size += 1
    return pairs[:size]
