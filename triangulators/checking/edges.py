"""Edges of a polygon for `checker`, computed from the boundary with exact orientations.

An edge is a boundary edge or a diagonal: a segment between two sites that starts into the interior
at both ends and meets no boundary edge between the ends. A binary tree of bounding boxes, compared
with a margin, finds the boundary edges that a segment may meet; then exact orientations decide.

Each site is paired with all later sites. A boundary edge that a segment from the site meets hides
the sites behind the edge: the last eight such edges are tested first, which saves most searches.
"""

from typing import NamedTuple

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import orientation
from triangulators.polygon import Boundary

_MAX_HIDING = 8  # number of boundary edges that are tested before the tree is searched


class Edges(NamedTuple):
    """Boundary edges and diagonals a-b of a polygon."""

    points: np.ndarray  # (n, 2)
    ends: np.ndarray  # (e, 2): pairs of sites a < b, in ascending order
    keys: np.ndarray  # (e,): a n + b, for binary search
    directions: np.ndarray  # (e,): 1 if a-b is a boundary edge, interior left, -1 if b-a, else 0
    holes: np.ndarray  # (h, 4): up to four sites of each hole, padded with -1

    def find_indices(self, pairs: np.ndarray) -> np.ndarray:
        """Return the edge index (k,) of each pair of sites (k, 2), -1 if there is no such edge."""
        pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        sought = pairs.min(axis=1) * len(self.points) + pairs.max(axis=1)
        nearest = np.minimum(np.searchsorted(self.keys, sought), len(self.keys) - 1)
        return np.where(self.keys[nearest] == sought, nearest, -1)


def find_edges(outline: Boundary) -> Edges:
    """Return the boundary edges and all diagonals of a polygon."""
    points, n = outline.points, len(outline.points)
    diagonals = find_diagonals(outline)
    pairs = np.sort(np.concatenate((outline.edges, diagonals)).astype(np.int64), axis=1)
    directions = np.zeros(len(pairs), dtype=np.int8)
    directions[: len(outline.edges)] = np.where(outline.edges[:, 0] < outline.edges[:, 1], 1, -1)
    keys = pairs[:, 0] * n + pairs[:, 1]
    order = np.argsort(keys)
    rings = np.split(outline.site, outline.ring_offsets[1:-1])
    holes = np.full((len(rings) - 1, 4), -1, dtype=np.int32)
    for row, ring in zip(holes, rings[1:], strict=True):
        samples = np.unique(ring)[:4]
        row[: len(samples)] = samples
    return Edges(points, pairs[order].astype(np.int32), keys[order], directions[order], holes)


@njit
def surrounds_hole(points: np.ndarray, holes: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether the counter-clockwise triangle a, b, c, whose sides are edges, surrounds a hole.

    No edge of the boundary crosses the triangle's sides, so the first of the hole's four sites that
    is not a vertex of the triangle decides.
    """
    for hole in range(len(holes)):
        for v in holes[hole]:
            if v < 0 or v == a or v == b or v == c:  # noqa: SIM109 - for Numba
                continue
            inside = (
                orientation(points, a, b, v) > 0.0
                and orientation(points, b, c, v) > 0.0
                and orientation(points, c, a, v) > 0.0
            )
            if inside:
                return True
            break
    return False


class _Sides(NamedTuple):
    """The boundary of a polygon, with a tree of bounding boxes.

    The edges `ending[first[v]:first[v + 1]]` end at site v, several if rings touch there; the
    interior at v is inside the angles of all these with their next edges. Row s + e of `boxes`
    bounds edge e, row k < s bounds rows 2 k and 2 k + 1.
    """

    points: np.ndarray  # (n, 2)
    edges: np.ndarray  # (b, 2): directed, with the interior on the left
    following: np.ndarray  # (b,): index of the next edge of the ring
    ending: np.ndarray  # (b,)
    first: np.ndarray  # (n + 1,)
    boxes: np.ndarray  # (2 s, 4), s a power of two: min x, min y, max x, max y


def find_diagonals(outline: Boundary) -> np.ndarray:
    """Return the diagonals (k, 2), each once, as pairs of sites in ascending order."""
    points, edges = outline.points, outline.edges
    following = np.arange(1, len(edges) + 1, dtype=np.int32)
    ring_start = 0
    for e in range(len(edges)):
        if edges[e, 1] == edges[ring_start, 0]:
            following[e] = ring_start
            ring_start = e + 1
    ending = np.argsort(edges[:, 1], kind="stable").astype(np.int32)
    first = np.searchsorted(edges[ending, 1], np.arange(len(points) + 1))
    sides = _Sides(points, edges, following, ending, first, _build_box_tree(points, edges))
    diagonals: np.ndarray = _list_diagonals(sides, np.unique(outline.site))
    return diagonals


@njit
def _build_box_tree(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the boxes (2 s, 4) of `_Sides` for b edges; the last s - b rows are empty boxes."""
    size = 1
    while size < len(edges):
        size *= 2
    boxes = np.empty((2 * size, 4))
    for k in range(2 * size - 1, 0, -1):
        if k < size:
            low, high = boxes[2 * k], boxes[2 * k + 1]
            for axis in range(2):
                boxes[k, axis] = min(low[axis], high[axis])
                boxes[k, 2 + axis] = max(low[2 + axis], high[2 + axis])
        elif k < size + len(edges):
            a, b = points[edges[k - size, 0]], points[edges[k - size, 1]]
            for axis in range(2):
                boxes[k, axis], boxes[k, 2 + axis] = min(a[axis], b[axis]), max(a[axis], b[axis])
        else:
            boxes[k] = np.array((np.inf, np.inf, -np.inf, -np.inf))
    return boxes


@njit
def _starts_inside(sides: _Sides, a: int, b: int) -> bool:
    """Whether the segment from site a to site b starts strictly into the interior at a."""
    points, edges, following, ending, first, _boxes = sides
    for index in range(first[a], first[a + 1]):
        e = ending[index]
        before, after = edges[e, 0], edges[following[e], 1]
        left_of_out = orientation(points, a, after, b) > 0.0
        left_of_in = orientation(points, before, a, b) > 0.0
        convex = orientation(points, before, a, after) > 0.0
        if convex:
            if not (left_of_out and left_of_in):
                return False
        elif not (left_of_out or left_of_in):
            # At a straight or reflex angle b must be strictly left of one of the two sides.
            return False
    return True


@njit
def _do_segments_meet(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the segments a-b and c-d, without a common end, have a point in common."""
    c_side, d_side = orientation(points, a, b, c), orientation(points, a, b, d)
    if (c_side > 0.0 and d_side > 0.0) or (c_side < 0.0 and d_side < 0.0):
        return False
    a_side, b_side = orientation(points, c, d, a), orientation(points, c, d, b)
    if (a_side > 0.0 and b_side > 0.0) or (a_side < 0.0 and b_side < 0.0):
        return False
    if c_side == 0.0 and d_side == 0.0:  # on one line: compare the boxes
        for axis in range(2):
            if max(points[a, axis], points[b, axis]) < min(points[c, axis], points[d, axis]):
                return False
            if max(points[c, axis], points[d, axis]) < min(points[a, axis], points[b, axis]):
                return False
    return True


@njit
def _find_meeting_edge(sides: _Sides, scale: float, a: int, b: int, stack: np.ndarray) -> int:
    """Return the index of a boundary edge that a-b meets, -1 if there is none, -2 if a-b is one.

    a-b starts into the interior at both ends. A box is skipped if the segment's box does not meet
    it, or if the segment's line passes it at more than the rounding error, a multiple of `scale`.
    """
    points, edges, _following, _ending, _first, boxes = sides
    ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
    dx, dy = bx - ax, by - ay
    low_x, high_x, low_y, high_y = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
    margin = 1e-14 * scale * (abs(dx) + abs(dy))
    size = len(boxes) // 2
    stack[0] = 1
    height = 1
    while height > 0:
        height -= 1
        node = stack[height]
        min_x, min_y, max_x, max_y = boxes[node]
        if min_x > high_x or max_x < low_x or min_y > high_y or max_y < low_y:
            continue
        distance = dx * (0.5 * (min_y + max_y) - ay) - dy * (0.5 * (min_x + max_x) - ax)
        reach = 0.5 * (abs(dx) * (max_y - min_y) + abs(dy) * (max_x - min_x))
        if abs(distance) > reach + margin:
            continue
        if node < size:
            stack[height], stack[height + 1] = 2 * node, 2 * node + 1
            height += 2
            continue
        c, d = edges[node - size]
        if c == a or c == b or d == a or d == b:  # noqa: SIM109 - for Numba
            # An edge that shares an end with the segment does not meet it elsewhere, because the
            # segment starts into the interior. The exception: the edge is the segment.
            if (c == a or c == b) and (d == a or d == b):  # noqa: SIM109
                return -2
        elif _do_segments_meet(points, a, b, c, d):
            return int(node - size)
    return -1


@njit
def _is_hidden(points: np.ndarray, a: int, hiding: np.ndarray, b: int) -> bool:
    """Whether the segment a-b crosses an edge of `hiding` (k, 2); move that edge to the front.

    a is left of all these edges.
    """
    for index in range(len(hiding)):
        c, d = hiding[index, 0], hiding[index, 1]
        if (
            orientation(points, c, d, b) < 0.0
            and orientation(points, a, c, b) > 0.0
            and orientation(points, a, d, b) < 0.0
        ):
            _move_to_front(hiding, index, c, d)
            return True
    return False


@njit
def _move_to_front(hiding: np.ndarray, index: int, c: int, d: int) -> None:
    for k in range(index, 0, -1):
        hiding[k] = hiding[k - 1]
    hiding[0, 0], hiding[0, 1] = c, d


@njit(nogil=True)
def _list_diagonals(sides: _Sides, sites: np.ndarray) -> np.ndarray:
    """Return the pairs (k, 2) of sites that see each other, except boundary edges."""
    points, edges = sides.points, sides.edges
    scale = np.abs(points).max()
    diagonals = np.empty((16 + 4 * len(sites), 2), dtype=np.int32)
    hiding = np.empty((_MAX_HIDING, 2), dtype=np.int32)
    stack = np.empty(128, dtype=np.int64)
    count = 0
    for i in range(len(sites)):
        if count + len(sites) > len(diagonals):
            grown = np.empty((2 * (count + len(sites)), 2), dtype=np.int32)
            grown[:count] = diagonals[:count]
            diagonals = grown
        a, hiding_count = sites[i], 0
        for b in sites[i + 1 :]:
            if (
                not _starts_inside(sides, a, b)
                or not _starts_inside(sides, b, a)
                or _is_hidden(points, a, hiding[:hiding_count], b)
            ):
                continue
            meeting = _find_meeting_edge(sides, scale, a, b, stack)
            if meeting == -1:
                diagonals[count, 0], diagonals[count, 1] = a, b
                count += 1
            elif meeting >= 0:
                c, d = edges[meeting, 0], edges[meeting, 1]
                sign = orientation(points, c, d, a)
                if sign != 0.0:  # an edge collinear with a hides no site
                    hiding_count = min(hiding_count + 1, _MAX_HIDING)
                    _move_to_front(
                        hiding, hiding_count - 1, c if sign > 0.0 else d, d if sign > 0.0 else c
                    )
    return diagonals[:count]
