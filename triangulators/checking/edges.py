"""Edges of a polygon as `checker` finds them, from its boundary and exact orientations alone.

A pair of sites is an edge if it is a piece of the boundary, or a diagonal: a segment that starts
into the interior at both ends and meets no other boundary edge. Boxes round the boundary's edges,
those of two neighbours in one, and of two such again, say which edges a segment may meet: they are
compared with a margin, orientations are exact.

Order. For each site, those after it are tried. An edge that was met on the way hides what is behind
it: the last few that did are asked first, so most pairs need no walk through the boxes.
"""

from typing import NamedTuple

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.geometry.predicates import turn
from triangulators.polygon import Boundary

_HIDING = 8  # edges that are asked whether they hide a site


class Edges(NamedTuple):
    """Edges of a polygon: ends (e, 2), a < b, ascending; keys (e,) the same as numbers.

    points (n, 2). ways (e,): 1 if a-b is boundary, -1 if b-a is, otherwise 0. holes (h, 4): sites
    of each hole, -1 where it has fewer.
    """

    points: np.ndarray
    ends: np.ndarray
    keys: np.ndarray
    ways: np.ndarray
    holes: np.ndarray

    def find(self, pairs: np.ndarray) -> np.ndarray:
        """Return the number of each pair, (k, 2) or pairs in a row, among the edges; -1: none."""
        pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        wanted = pairs.min(axis=1) * len(self.points) + pairs.max(axis=1)
        at = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        return np.where(self.keys[at] == wanted, at, -1)


def edges_of(outline: Boundary) -> Edges:
    """Return the edges of a polygon."""
    points, n = outline.points, len(outline.points)
    diagonals = diagonals_of(outline)
    pairs = np.sort(np.concatenate((outline.edges, diagonals)).astype(np.int64), axis=1)
    ways = np.zeros(len(pairs), dtype=np.int8)
    ways[: len(outline.edges)] = np.where(outline.edges[:, 0] < outline.edges[:, 1], 1, -1)
    keys = pairs[:, 0] * n + pairs[:, 1]
    order = np.argsort(keys)
    rings = np.split(outline.site, outline.ring_offsets[1:-1])
    holes = np.full((len(rings) - 1, 4), -1, dtype=np.int32)
    for row, ring in zip(holes, rings[1:], strict=True):
        few = np.unique(ring)[:4]
        row[: len(few)] = few
    return Edges(points, pairs[order].astype(np.int32), keys[order], ways[order], holes)


@njit
def around_hole(points: np.ndarray, holes: np.ndarray, a: int, b: int, c: int) -> bool:
    """Whether a triangle of edges, counter-clockwise, runs round a hole.

    No edge of the boundary crosses the triangle's sides, so a hole is inside as a whole or not at
    all, but for corners that it may share with the triangle. Of four sites one is no corner: it
    tells.
    """
    for hole in range(len(holes)):
        for v in holes[hole]:
            if v < 0 or v == a or v == b or v == c:  # noqa: SIM109 - for Numba
                continue
            inside = (
                turn(points, a, b, v) > 0.0
                and turn(points, b, c, v) > 0.0
                and turn(points, c, a, v) > 0.0
            )
            if inside:
                return True
            break
    return False


class _Sides(NamedTuple):
    """The boundary: points (n, 2), edges (b, 2), interior left, and the edge following (b,) each.

    The edges that end at site v are `ending[first[v]:first[v + 1]]`: several where rings touch, and
    the interior there is what all these corners have on their left. boxes (2 s, 4), least x
    and y, greatest x and y: that of edge e is row s + e, and row k is round rows 2 k and 2 k + 1.
    """

    points: np.ndarray
    edges: np.ndarray
    following: np.ndarray
    ending: np.ndarray
    first: np.ndarray
    boxes: np.ndarray


def diagonals_of(outline: Boundary) -> np.ndarray:
    """Return the diagonals (k, 2) between sites; the lower one of a pair need not be the first."""
    points, edges = outline.points, outline.edges
    following = np.arange(1, len(edges) + 1, dtype=np.int32)
    ring_start = 0
    for e in range(len(edges)):
        if edges[e, 1] == edges[ring_start, 0]:
            following[e] = ring_start
            ring_start = e + 1
    ending = np.argsort(edges[:, 1], kind="stable").astype(np.int32)
    first = np.searchsorted(edges[ending, 1], np.arange(len(points) + 1))
    sides = _Sides(points, edges, following, ending, first, _boxes_of(points, edges))
    found: np.ndarray = _diagonals(sides, np.unique(outline.site))
    return found


@njit
def _boxes_of(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the boxes (2 s, 4) of `_Sides`; the s - b rows at the end are round nothing."""
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
    """Whether the segment from a to b starts strictly into the interior; see `_Sides`."""
    points, edges, following, ending, first, _boxes = sides
    for place in range(first[a], first[a + 1]):
        e = ending[place]
        before, after = edges[e, 0], edges[following[e], 1]
        left_of_out = turn(points, a, after, b) > 0.0
        left_of_in = turn(points, before, a, b) > 0.0
        convex = turn(points, before, a, after) > 0.0
        if convex:
            if not (left_of_out and left_of_in):
                return False
        elif not (left_of_out or left_of_in):
            # Straight or reflex: left of either side will do, unless it runs along one of them.
            return False
    return True


@njit
def _meets(points: np.ndarray, a: int, b: int, c: int, d: int) -> bool:
    """Whether the segments a-b and c-d, without a common end, have a point in common."""
    c_side, d_side = turn(points, a, b, c), turn(points, a, b, d)
    if (c_side > 0.0 and d_side > 0.0) or (c_side < 0.0 and d_side < 0.0):
        return False
    a_side, b_side = turn(points, c, d, a), turn(points, c, d, b)
    if (a_side > 0.0 and b_side > 0.0) or (a_side < 0.0 and b_side < 0.0):
        return False
    if c_side == 0.0 and d_side == 0.0:  # on one line
        for axis in range(2):
            if max(points[a, axis], points[b, axis]) < min(points[c, axis], points[d, axis]):
                return False
            if max(points[c, axis], points[d, axis]) < min(points[a, axis], points[b, axis]):
                return False
    return True


@njit
def _meeting(sides: _Sides, scale: float, a: int, b: int, stack: np.ndarray) -> int:
    """Return an edge that the segment a-b meets, -1 if there is none, -2 where it is an edge.

    It starts inside at both ends. scale: the largest coordinate's size; stack: room for two rows
    for each halving of the boxes. A box is passed over that the segment's own does not meet, or
    that lies on one side of the line through it by more than rounding.
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
        left, bottom, right, top = boxes[node]
        if left > high_x or right < low_x or bottom > high_y or top < low_y:
            continue
        beside = dx * (0.5 * (bottom + top) - ay) - dy * (0.5 * (left + right) - ax)
        reach = 0.5 * (abs(dx) * (top - bottom) + abs(dy) * (right - left))
        if abs(beside) > reach + margin:
            continue
        if node < size:
            stack[height], stack[height + 1] = 2 * node, 2 * node + 1
            height += 2
            continue
        c, d = edges[node - size]
        if c == a or c == b or d == a or d == b:  # noqa: SIM109 - for Numba
            # Edges at an end leave it elsewhere, or the segment would not start inside; unless
            # one is the segment itself.
            if (c == a or c == b) and (d == a or d == b):  # noqa: SIM109
                return -2
        elif _meets(points, a, b, c, d):
            return int(node - size)
    return -1


@njit
def _is_behind_one(points: np.ndarray, a: int, hiding: np.ndarray, b: int) -> bool:
    """Whether the segment a-b crosses one of the edges `hiding` (k, 2); it goes first.

    They have a on their left, so it does if b is on their right and between the rays to their ends.
    """
    for place in range(len(hiding)):
        c, d = hiding[place, 0], hiding[place, 1]
        if (
            turn(points, c, d, b) < 0.0
            and turn(points, a, c, b) > 0.0
            and turn(points, a, d, b) < 0.0
        ):
            _to_front(hiding, place, c, d)
            return True
    return False


@njit
def _to_front(hiding: np.ndarray, place: int, c: int, d: int) -> None:
    """Put an edge c-d first, in place of that at `place`; those before it go one further."""
    for at in range(place, 0, -1):
        hiding[at] = hiding[at - 1]
    hiding[0, 0], hiding[0, 1] = c, d


@njit(nogil=True)
def _diagonals(sides: _Sides, sites: np.ndarray) -> np.ndarray:
    """Return the pairs of sites that see each other, but for the boundary's edges.

    `hiding` holds edges that met a segment from the same site; the one that hid something last
    comes first. It only saves time: an edge that is not in it is met in `_meeting`.
    """
    points, edges = sides.points, sides.edges
    scale = np.abs(points).max()
    found = np.empty((16 + 4 * len(sites), 2), dtype=np.int32)
    hiding = np.empty((_HIDING, 2), dtype=np.int32)
    stack = np.empty(128, dtype=np.int64)
    count = 0
    for i in range(len(sites)):
        if count + len(sites) > len(found):
            grown = np.empty((2 * (count + len(sites)), 2), dtype=np.int32)
            grown[:count] = found[:count]
            found = grown
        a, known = sites[i], 0
        for b in sites[i + 1 :]:
            if (
                not _starts_inside(sides, a, b)
                or not _starts_inside(sides, b, a)
                or _is_behind_one(points, a, hiding[:known], b)
            ):
                continue
            met = _meeting(sides, scale, a, b, stack)
            if met == -1:
                found[count, 0], found[count, 1] = a, b
                count += 1
            elif met >= 0:
                c, d = edges[met, 0], edges[met, 1]
                way = turn(points, c, d, a)
                if way != 0.0:  # in line with a it hides nothing but itself
                    known = min(known + 1, _HIDING)
                    _to_front(hiding, known - 1, c if way > 0.0 else d, d if way > 0.0 else c)
    return found[:count]
