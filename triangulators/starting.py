"""Triangulations to start from, and the simple polygon to work on.

Where a library left vertices out they are put back. Where no library's triangulation will do, one
is made of diagonals, shortest first, those kept that cross none kept before: by exact orientations,
so it holds up where vertices lie beside an edge by less than a rounding error.
"""

from typing import NamedTuple

import numpy as np

from triangulators.checking.edges import edges_of
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost, total_cost
from triangulators.errors import Skipped, TriangulationError
from triangulators.geometry.half_edges import is_triangulation, link, twins_of
from triangulators.geometry.predicates import ALL_LEFT, all_left, cross, tolerance, turn, turns
from triangulators.geometry.visibility import visible_pairs
from triangulators.libraries import delaunay, ear_clipping
from triangulators.polygon import Boundary, vertices_on
from triangulators.verify import unmatched_edges, verify_boundary

_EXACT = 1000  # vertices up to which all pairs of them are tried


class Cycle(NamedTuple):
    """A simple polygon: `cycle` (n,), its corners counter-clockwise as indices of `points`' rows.

    `points` (n, 2) are the corners' coordinates; corner i sees `target[start[i]:start[i + 1]]`,
    ascending, all > i (see `visible_pairs`).
    """

    cycle: np.ndarray
    points: np.ndarray
    start: np.ndarray
    target: np.ndarray


def cycle_of(outline: Boundary, who: str) -> Cycle:
    """Return the only ring of a polygon with what its corners see; raises `Skipped` for holes."""
    if outline.holes:
        raise Skipped(f"{who}: the polygon has holes")
    cycle = outline.edges[:, 0].copy()
    points = outline.points[cycle]
    local = ring_triangulation(outline, cycle)
    start, target = visible_pairs(points, local, twins_of(local), len(cycle) ** 2)
    return Cycle(cycle, points, start, target)


def ring_triangulation(outline: Boundary, cycle: np.ndarray) -> np.ndarray:
    """Return some triangulation (n - 2, 3) of a polygon's only ring, as positions in `cycle`."""
    n = len(cycle)
    position = np.empty(len(outline.points), dtype=np.int32)
    position[cycle] = np.arange(n, dtype=np.int32)
    local: np.ndarray = position[outline.site[ear_clipping(outline)]]
    corner = local.reshape(-1)
    if is_triangulation(outline.points[cycle], np.array([n]), corner, link(corner)):
        return local
    return np.asarray(position[starts(outline)[0]])


def starts(outline: Boundary) -> list[np.ndarray]:
    """Return the conforming ones of ear clipping and Delaunay, dropped vertices put back.

    Where neither is, because they leave out slivers that float64 can tell from nothing, the greedy
    triangulation by exact orientations. Raises `TriangulationError` if that fails, too.
    """
    found = []
    for method in (ear_clipping, delaunay):
        try:
            raw = np.ascontiguousarray(method(outline), dtype=np.int32)
        except TriangulationError:
            continue
        triangles = insert_dropped_vertices(outline, left_turning(outline.points, raw))
        if verify_boundary(outline, triangles).conforming:
            found.append(outline.site[triangles])
    if not found and len(outline.points) <= _EXACT:
        triangles = shortest_first(outline, edges_of(outline).ends)
        if verify_boundary(outline, triangles).conforming:
            found.append(triangles)
    if not found:
        raise TriangulationError(
            "neither ear clipping nor Delaunay gave a valid triangulation to start from"
        )
    return found


def best_start(outline: Boundary, cost: Cost) -> np.ndarray:
    """Return the better of ear clipping and Delaunay; raises `TriangulationError` if neither."""
    return min(starts(outline), key=lambda triangles: total_cost(outline.points, triangles, cost))


def left_turning(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return int32 triangles wound counter-clockwise, those without area left out."""
    triangles = np.ascontiguousarray(triangles, dtype=np.int32)
    if all_left(points, triangles) == ALL_LEFT:
        return triangles
    orientation = turns(points, triangles)
    triangles = np.where((orientation < 0.0)[:, None], triangles[:, [0, 2, 1]], triangles)
    return np.ascontiguousarray(triangles[orientation != 0.0])


def insert_dropped_vertices(outline: Boundary, triangles: np.ndarray) -> np.ndarray:
    """Split triangles at vertices that lie on their edges; return (m', 3) int32.

    Each T-junction is resolved by drawing the vertex to the opposite corner. Area, coverage and
    winding do not change; triangles without T-junctions keep their place and order. A sliver
    with a corner on its own opposite edge goes: the triangle across that edge is split there.
    """
    loose = unmatched_edges(outline, triangles)
    if not loose:
        return triangles
    inside = vertices_on(outline, np.array(list(loose), np.int32), tolerance(outline.points))
    result: list[tuple[int, int, int]] = []
    for corners in triangles.tolist():
        chains = []
        for tail, head in zip(corners, corners[1:] + corners[:1], strict=True):
            on_edge = inside.get((int(outline.site[tail]), int(outline.site[head])), [])
            chains.append([tail, *on_edge, head])
        if not any(set(chain[1:-1]) & set(corners) for chain in chains):
            _split(chains, result)
    return np.array(result, dtype=np.int32).reshape(-1, 3)


def _split(chains: list[list[int]], result: list[tuple[int, int, int]]) -> None:
    """Append the pieces of a triangle given by the vertices along each of its three edges."""
    for first in range(3):
        edge, second, third = chains[first], chains[first - 2], chains[first - 1]
        if len(edge) > 2:
            vertex, apex = edge[1], third[0]
            _split([edge[:2], [vertex, apex], third], result)
            _split([edge[1:], second, [apex, vertex]], result)
            return
    result.append((chains[0][0], chains[1][0], chains[2][0]))


def shortest_first(outline: Boundary, pairs: np.ndarray) -> np.ndarray:
    """Return the greedy triangulation (m, 3), between sites.

    pairs (p, 2): sites that see each other; edges of the boundary may be among them.
    """
    points, edges = outline.points, outline.edges
    size = len(points)
    of_boundary = edges.astype(np.int64)
    keys = of_boundary.min(axis=1) * size + of_boundary.max(axis=1)
    low, high = pairs.min(axis=1).astype(np.int64), pairs.max(axis=1).astype(np.int64)
    diagonals = by_length(points, pairs[~np.isin(low * size + high, keys)])
    kept = diagonals[_keep(points, diagonals)]
    sides = np.concatenate((edges, kept, kept[:, ::-1]))
    both_ways = np.concatenate((sides, edges[:, ::-1]))
    both_ways = both_ways[np.argsort(both_ways[:, 0], kind="stable")]
    begin = np.searchsorted(both_ways[:, 0], np.arange(size + 1))
    return _triangles(points, sides, begin, both_ways[:, 1].copy())


def by_length(points: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return pairs (p, 2) of points (n, 2), the shortest first; those of equal length as given."""
    lengths = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
    return pairs[np.argsort(lengths, kind="stable")]


@njit
def _keep(points: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Mark the pairs of points that cross no earlier one kept.

    Most pairs cross one, and pairs that share an end often cross the same. So `blocking[v]`, the
    last one found to cross a pair from v, is asked first: a tenth of the time at 3,000 vertices.
    """
    kept = np.zeros(len(pairs), dtype=np.bool_)
    chosen = np.empty((len(pairs), 2), dtype=np.int64)  # the pairs kept, in order: size of them
    size = 0
    blocking = np.full(len(points), -1)
    for index in range(len(pairs)):
        a, b = pairs[index]
        crossed = False
        for other in (blocking[a], blocking[b]):
            if other >= 0 and cross(points, a, b, chosen[other, 0], chosen[other, 1]):
                crossed = True
                break
        if crossed:
            continue
        for other in range(size):
            if cross(points, a, b, chosen[other, 0], chosen[other, 1]):
                crossed = True
                blocking[a] = blocking[b] = other
                break
        if not crossed:
            kept[index] = True
            chosen[size, 0], chosen[size, 1] = a, b
            size += 1
    return kept


@njit
def _triangles(
    points: np.ndarray, sides: np.ndarray, begin: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Return the triangle left of each side (s, 2), once.

    Sides run with the interior on their left, diagonals both ways; v is joined to
    `near[begin[v]:begin[v + 1]]`. The triangle left of a-b is closed by what follows b around a,
    counter-clockwise, for its angle there is less than a half-turn.
    """
    found = np.empty((len(sides), 3), dtype=np.int32)
    count = 0
    for side in range(len(sides)):
        a, b = sides[side]
        apex = -1
        for place in range(begin[a], begin[a + 1]):
            c = near[place]
            if turn(points, a, b, c) > 0.0 and (apex < 0 or turn(points, a, c, apex) > 0.0):
                apex = c
        if apex > a and b > a:  # once: it is found from each of its sides
            found[count, 0], found[count, 1], found[count, 2] = a, b, apex
            count += 1
    return found[:count].copy()
