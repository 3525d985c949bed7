"""Initial triangulations of a polygon, and the visible pairs of a polygon without holes.

The greedy triangulation has repeatedly the shortest diagonal that crosses no earlier diagonal.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from triangulators.checking.edges import find_edges
from triangulators.compute.kernels import njit
from triangulators.criteria.cost import Cost, compute_total_cost
from triangulators.errors import SkippedError, TriangulationError
from triangulators.geometry.half_edges import find_twins, is_triangulation, link_half_edges
from triangulators.geometry.predicates import do_segments_cross, orientation
from triangulators.geometry.visibility import find_visible_pairs
from triangulators.libraries import delaunay, ear_clipping
from triangulators.polygon import Boundary
from triangulators.verify import insert_dropped_vertices, orient_triangles, verify_boundary

_MAX_GREEDY_VERTICES = 1000  # for the greedy triangulation, which compares all pairs of vertices


def find_initial_triangulations(outline: Boundary) -> Iterator[np.ndarray]:
    """Yield the triangulations (m, 3) of ear clipping and Delaunay that conform after repair.

    If neither conforms, because slivers within rounding error are missing, yield the greedy
    triangulation, for up to 1,000 vertices. Raises `TriangulationError` if nothing conforms.
    """
    is_found = False
    for method in (ear_clipping, delaunay):
        try:
            indices = np.ascontiguousarray(method(outline), dtype=np.int32)
        except TriangulationError:
            continue
        triangles = orient_triangles(outline.points, indices)
        corner = triangles.reshape(-1)
        twin = link_half_edges(corner)
        if not is_triangulation(outline.points, outline.ring_offsets, corner, twin):
            triangles = insert_dropped_vertices(outline, triangles)
            if not verify_boundary(outline, triangles).conforming:
                continue
        is_found = True
        yield outline.site[triangles]
    if not is_found and len(outline.points) <= _MAX_GREEDY_VERTICES:
        triangles = triangulate_greedily(outline.points, outline.edges, find_edges(outline).ends)
        if verify_boundary(outline, triangles).conforming:
            is_found = True
            yield triangles
    if not is_found:
        raise TriangulationError(
            "no initial triangulation: the results of ear clipping and Delaunay do not conform; "
            "remove vertices that lie within a rounding error of an edge"
        )


def find_best_initial(outline: Boundary, cost: Cost) -> np.ndarray:
    """Return the triangulation (m, 3) of lowest cost that `find_initial_triangulations` yields."""
    return min(
        find_initial_triangulations(outline),
        key=lambda triangles: compute_total_cost(outline.points, triangles, cost),
    )


def find_any_triangulation(outline: Boundary) -> np.ndarray:
    """Return an arbitrary triangulation (m, 3) of a polygon; the vertices are sites."""
    return next(find_initial_triangulations(outline))


class Cycle(NamedTuple):
    """A polygon without holes, and the positions j > i that are visible from each position i."""

    cycle: np.ndarray  # (n,): vertex indices, counter-clockwise
    points: np.ndarray  # (n, 2)
    start: np.ndarray  # (n + 1,): `target[start[i]:start[i + 1]]` are visible from i, ascending
    target: np.ndarray


def require_few_vertices(outline: Boundary, who: str, max_vertices: int) -> None:
    """Raise `SkippedError` if a polygon has more vertices than a triangulator supports."""
    if len(outline.edges) > max_vertices:
        raise SkippedError(
            f"{who}: the polygon has {len(outline.edges)} vertices, more than {max_vertices}"
        )


def make_cycle(outline: Boundary, who: str, triangles: np.ndarray | None = None) -> Cycle:
    """Return the ring of a polygon and its visible pairs; raise `SkippedError` if it has holes.

    triangles (m, 3): any triangulation of the polygon, by default an initial one.
    """
    if outline.holes:
        raise SkippedError(f"{who}: the polygon has holes")
    cycle = outline.edges[:, 0].copy()
    points = outline.points[cycle]
    local = find_ring_triangulation(outline, cycle, triangles)
    start, target = find_visible_pairs(points, local, find_twins(local))
    return Cycle(cycle, points, start, target)


def find_ring_triangulation(
    outline: Boundary, cycle: np.ndarray, triangles: np.ndarray | None = None
) -> np.ndarray:
    """Return a triangulation (n - 2, 3), by default an initial one, as positions in `cycle`."""
    n = len(cycle)
    position = np.empty(len(outline.points), dtype=np.int32)
    position[cycle] = np.arange(n, dtype=np.int32)
    triangles = find_any_triangulation(outline) if triangles is None else triangles
    return np.asarray(position[triangles])


def triangulate_greedily(points: np.ndarray, edges: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return the greedy triangulation (m, 3); pairs (p, 2): all points that see each other."""
    size = len(points)
    of_boundary = edges.astype(np.int64)
    keys = of_boundary.min(axis=1) * size + of_boundary.max(axis=1)
    low, high = pairs.min(axis=1).astype(np.int64), pairs.max(axis=1).astype(np.int64)
    diagonals = sort_by_length(points, pairs[~np.isin(low * size + high, keys)])
    selected = diagonals[_select_uncrossed_pairs(points, diagonals)]
    sides = np.concatenate((edges, selected, selected[:, ::-1]))
    directed = np.concatenate((sides, edges[:, ::-1]))
    directed = directed[np.argsort(directed[:, 0], kind="stable")]
    begin = np.searchsorted(directed[:, 0], np.arange(size + 1))
    return _list_triangles(points, sides, begin, directed[:, 1].copy())


def sort_by_length(points: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Sort pairs (p, 2) of points (n, 2) by length, stably."""
    lengths = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
    return pairs[np.argsort(lengths, kind="stable")]


@njit
def _select_uncrossed_pairs(points: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Return flags (p,) of the pairs (p, 2) of points that cross no earlier selected pair."""
    marked = np.zeros(len(pairs), dtype=np.bool_)
    selected = np.empty((len(pairs), 2), dtype=np.int64)  # the first `size` rows are selected pairs
    size = 0
    # The last selected pair that crossed a pair at each vertex, tried first: a tenth of the time.
    blocking = np.full(len(points), -1)
    for index in range(len(pairs)):
        a, b = pairs[index]
        crossed = False
        for other in (blocking[a], blocking[b]):
            if other >= 0 and do_segments_cross(
                points, a, b, selected[other, 0], selected[other, 1]
            ):
                crossed = True
                break
        if crossed:
            continue
        for other in range(size):
            if do_segments_cross(points, a, b, selected[other, 0], selected[other, 1]):
                crossed = True
                blocking[a] = blocking[b] = other
                break
        if not crossed:
            marked[index] = True
            selected[size, 0], selected[size, 1] = a, b
            size += 1
    return marked


@njit
def _list_triangles(
    points: np.ndarray, sides: np.ndarray, begin: np.ndarray, near: np.ndarray
) -> np.ndarray:
    """Return the triangles left of the sides; v is joined to `near[begin[v]:begin[v + 1]]`."""
    triangles = np.empty((len(sides), 3), dtype=np.int32)
    count = 0
    for side in range(len(sides)):
        a, b = sides[side]
        apex = -1
        for index in range(begin[a], begin[a + 1]):
            c = near[index]
            if orientation(points, a, b, c) > 0.0 and (
                apex < 0 or orientation(points, a, c, apex) > 0.0
            ):
                apex = c
        if apex > a and b > a:  # list a triangle only at the side from its lowest vertex
            triangles[count, 0], triangles[count, 1], triangles[count, 2] = a, b, apex
            count += 1
    return triangles[:count].copy()
