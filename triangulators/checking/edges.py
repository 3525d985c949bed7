"""Edges of a polygon as `checker` finds them, from its boundary and exact orientations alone.

A pair of sites is an edge if it is a piece of the boundary, or a diagonal: a segment that starts
into the interior at both ends and meets no other boundary edge. Boundary edges are kept by the
cells of a grid, and a segment looks only into the cells that it runs through: which cells is
computed with a margin, orientations are exact.

Order. For each site, those after it are tried. An edge that was met on the way hides what is behind
it: the last few that did are asked first, so most pairs need no walk through the grid.
"""

from typing import NamedTuple

import numpy as np

from triangulators.compute.kernels import njit
from triangulators.devices import shared_out
from triangulators.geometry.predicates import turn
from triangulators.polygon import Boundary

_FEW, _SLICES = 2000, 16  # sites from which on they are shared out among threads; slices
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
        """Return the number of each pair (k, 2) among the edges, -1 where it is none."""
        pairs = np.asarray(pairs, dtype=np.int64).reshape(-1, 2)
        wanted = pairs.min(axis=1) * len(self.points) + pairs.max(axis=1)
        at = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        return np.where(self.keys[at] == wanted, at, -1)


def edges_of(outline: Boundary) -> Edges:
    """Return the edges of a polygon."""
    points, n = outline.points, len(outline.points)
    diagonals = _diagonals_of(points, outline.edges, outline.site)
    pairs = np.sort(np.concatenate((outline.edges, diagonals)).astype(np.int64), axis=1)
    ways = np.zeros(len(pairs), dtype=np.int8)
    ways[: len(outline.edges)] = np.where(outline.edges[:, 0] < outline.edges[:, 1], 1, -1)
    keys = pairs[:, 0] * n + pairs[:, 1]
    order = np.argsort(keys)
    rings = np.split(outline.site, outline.ends[:-1])
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
    the interior there is what all these corners have on their left.
    """

    points: np.ndarray
    edges: np.ndarray
    following: np.ndarray
    ending: np.ndarray
    first: np.ndarray


class _Grid(NamedTuple):
    """Cells x cells boxes from `low` (2,) on, of `size` (2,).

    Cell i, column after column, has the edges `items[start[i]:start[i + 1]]`.
    """

    low: np.ndarray
    size: np.ndarray
    cells: int
    start: np.ndarray
    items: np.ndarray


def _diagonals_of(points: np.ndarray, edges: np.ndarray, site: np.ndarray) -> np.ndarray:
    """Return the diagonals (k, 2) between sites; edges (b, 2) have the interior left.

    site (n,): see `Boundary`. The lower site of a pair need not be the first.
    """
    following = np.arange(1, len(edges) + 1, dtype=np.int32)
    ring_start = 0
    for e in range(len(edges)):
        if edges[e, 1] == edges[ring_start, 0]:
            following[e] = ring_start
            ring_start = e + 1
    ending = np.argsort(edges[:, 1], kind="stable").astype(np.int32)
    first = np.searchsorted(edges[ending, 1], np.arange(len(points) + 1))
    sides = _Sides(points, edges, following, ending, first)
    cells = max(1, min(512, int(np.sqrt(len(edges) / 2.0))))
    size = np.maximum(np.ptp(points, axis=0), 1e-300) * (1.0 + 1e-9) / cells
    low = points.min(axis=0)
    grid = _Grid(low, size, cells, *_edges_of_cells(points, edges, low, size, cells))
    sites = np.unique(site).astype(np.int32)
    slices = _SLICES if len(sites) > _FEW else 1

    def each(number: int) -> np.ndarray:
        found: np.ndarray = _diagonals(sides, grid, sites, number, slices)
        return found

    return np.concatenate(shared_out(each, slices))


@njit
def _cells(a: float, b: float, low: float, size: float, cells: int) -> tuple[int, int]:
    """Return the first and last cell, along one axis, of what is between a and b, with a margin."""
    margin = 1e-6 * size
    first = int(np.floor((min(a, b) - margin - low) / size))
    last = int(np.floor((max(a, b) + margin - low) / size))
    return max(0, first), min(cells - 1, last)


@njit
def _rows(
    ax: float,
    ay: float,
    bx: float,
    by: float,
    low: np.ndarray,
    size: np.ndarray,
    cells: int,
    column: int,
) -> tuple[int, int]:
    """Return the first and last row of cells that a segment meets in a column."""
    left, right = low[0] + column * size[0], low[0] + (column + 1) * size[0]
    if bx < ax:
        ax, ay, bx, by = bx, by, ax, ay
    y0, y1 = ay, by
    if bx > ax:
        if left > ax:
            y0 = ay + (by - ay) * ((left - ax) / (bx - ax))
        if right < bx:
            y1 = ay + (by - ay) * ((right - ax) / (bx - ax))
    return _cells(y0, y1, low[1], size[1], cells)


@njit
def _edges_of_cells(
    points: np.ndarray, edges: np.ndarray, low: np.ndarray, size: np.ndarray, cells: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (start, items) of `_Grid`: edges are counted in one sweep and written in another."""
    start = np.zeros(cells * cells + 2, dtype=np.int64)
    items = np.empty(0, dtype=np.int32)
    for sweep in range(2):
        for e in range(len(edges)):
            a, b = edges[e, 0], edges[e, 1]
            ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
            first, last = _cells(ax, bx, low[0], size[0], cells)
            for column in range(first, last + 1):
                bottom, top = _rows(ax, ay, bx, by, low, size, cells, column)
                for row in range(bottom, top + 1):
                    cell = column * cells + row
                    # start[cell + 1] is where the next one of `cell` goes: in the end its end.
                    if sweep == 0:
                        start[cell + 2] += 1
                    else:
                        items[start[cell + 1]] = e
                        start[cell + 1] += 1
        if sweep == 0:
            start = start.cumsum()
            items = np.empty(start[-1], dtype=np.int32)
    return start[:-1].copy(), items


@njit
def _starts_inside(
    points: np.ndarray,
    edges: np.ndarray,
    following: np.ndarray,
    ending: np.ndarray,
    first: np.ndarray,
    a: int,
    b: int,
) -> bool:
    """Whether the segment from a to b starts strictly into the interior; see `_Sides`."""
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
def _meeting(
    points: np.ndarray,
    edges: np.ndarray,
    a: int,
    b: int,
    grid: _Grid,
    asked: np.ndarray,
    stamp: int,
) -> int:
    """Return an edge that the segment a-b meets, -1 if there is none, -2 where it is an edge.

    asked (b,): the stamp of the segment that each edge was last asked about.
    """
    low, size, cells, start, items = grid
    ax, ay, bx, by = points[a, 0], points[a, 1], points[b, 0], points[b, 1]
    first, last = _cells(ax, bx, low[0], size[0], cells)
    for index in range(last - first + 1):
        column = first + index if bx >= ax else last - index  # from a on: what blocks is often near
        bottom, top = _rows(ax, ay, bx, by, low, size, cells, column)
        for row in range(bottom, top + 1):
            cell = column * cells + row
            for place in range(start[cell], start[cell + 1]):
                e = items[place]
                if asked[e] == stamp:  # long edges are in many cells
                    continue
                asked[e] = stamp
                c, d = edges[e, 0], edges[e, 1]
                if c == a or c == b or d == a or d == b:  # noqa: SIM109 - for Numba
                    # Edges at an end leave it elsewhere, or the segment would not start inside;
                    # unless one is the segment itself.
                    if (c == a or c == b) and (d == a or d == b):  # noqa: SIM109
                        return -2
                    continue
                if _meets(points, a, b, c, d):
                    return e
    return -1


@njit
def _is_behind_one(points: np.ndarray, a: int, hiding: np.ndarray, count: int, b: int) -> bool:
    """Whether the segment a-b crosses one of the first `count` edges of `hiding`; it goes first.

    They have a on their left, so it does if b is on their right and between the rays to their ends.
    """
    for place in range(count):
        c, d = hiding[place, 0], hiding[place, 1]
        if (
            turn(points, c, d, b) < 0.0
            and turn(points, a, c, b) > 0.0
            and turn(points, a, d, b) < 0.0
        ):
            _to_front(hiding, place)
            return True
    return False


@njit
def _to_front(hiding: np.ndarray, place: int) -> None:
    """Move an edge of `hiding` to the first place; those before it go one further."""
    c, d = hiding[place, 0], hiding[place, 1]
    for at in range(place, 0, -1):
        hiding[at] = hiding[at - 1]
    hiding[0, 0], hiding[0, 1] = c, d


@njit(nogil=True)
def _diagonals(
    sides: _Sides, grid: _Grid, sites: np.ndarray, number: int, slices: int
) -> np.ndarray:
    """Return the pairs of every `slices`-th of `sites`, from `number` on, with later ones."""
    edges = sides.edges
    found = np.empty((16 + 4 * len(edges), 2), dtype=np.int32)
    count = 0
    seen = np.empty(len(sites), dtype=np.int32)
    asked = np.full(len(edges), -1, dtype=np.int64)
    for i in range(number, len(sites), slices):
        more = _seen_after(sides, grid, sites, i, seen, asked)
        if count + more > len(found):
            grown = np.empty((2 * (count + more), 2), dtype=np.int32)
            grown[:count] = found[:count]
            found = grown
        found[count : count + more, 0] = sites[i]
        found[count : count + more, 1] = seen[:more]
        count += more
    return found[:count]


@njit
def _seen_after(
    sides: _Sides, grid: _Grid, sites: np.ndarray, i: int, seen: np.ndarray, asked: np.ndarray
) -> int:
    """Write the sites after `sites[i]` that it sees to `seen`; return how many there are.

    seen (n,): room; asked (b,): see `_meeting`. `hiding` holds up to eight edges that met a segment
    from here, with this site on their left, and `known` says how many; the one that hid something
    last comes first. It only saves time: an edge that is not in it is met in `_meeting`.
    """
    points, edges, following, ending, first = sides
    a = sites[i]
    hiding = np.empty((_HIDING, 2), dtype=np.int32)
    known, count = 0, 0
    for b in sites[i + 1 :]:
        if (
            not _starts_inside(points, edges, following, ending, first, a, b)
            or not _starts_inside(points, edges, following, ending, first, b, a)
            or _is_behind_one(points, a, hiding, known, b)
        ):
            continue
        stamp = np.int64(a) * len(points) + b  # of this segment and no other
        met = _meeting(points, edges, a, b, grid, asked, stamp)
        if met == -1:
            seen[count] = b
            count += 1
        elif met >= 0:
            c, d = edges[met, 0], edges[met, 1]
            way = turn(points, c, d, a)
            if way != 0.0:  # in line with a it hides nothing but itself
                known = min(known + 1, _HIDING)
                hiding[known - 1, 0] = c if way > 0.0 else d
                hiding[known - 1, 1] = d if way > 0.0 else c
                _to_front(hiding, known - 1)
    return count
