"""Initial triangulations of a polygon, and the visible pairs of a polygon without holes."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from triangulators.checking.edges import find_edges
from triangulators.criteria.cost import Cost, compute_total_cost
from triangulators.errors import SkippedError, TriangulationError
from triangulators.geometry.half_edges import find_twins, is_triangulation, link_half_edges
from triangulators.geometry.shortest_diagonals import triangulate_greedily
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
        if not _is_triangulation(outline, triangles):
            triangles = insert_dropped_vertices(outline, triangles)
            accepted = _is_triangulation(outline, triangles)
            if not accepted and not verify_boundary(outline, triangles).conforming:
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


def _is_triangulation(outline: Boundary, triangles: np.ndarray) -> bool:
    corner = triangles.reshape(-1)
    twin = link_half_edges(corner)
    return bool(is_triangulation(outline.points, outline.ring_offsets, corner, twin))


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


def make_cycle(outline: Boundary, who: str) -> Cycle:
    """Return the ring of a polygon and its visible pairs; raise `SkippedError` if it has holes."""
    if outline.holes:
        raise SkippedError(f"{who}: the polygon has holes")
    cycle = outline.edges[:, 0].copy()
    points = outline.points[cycle]
    local = find_ring_triangulation(outline, cycle)
    start, target = find_visible_pairs(points, local, find_twins(local), len(cycle) ** 2)
    return Cycle(cycle, points, start, target)


def find_ring_triangulation(outline: Boundary, cycle: np.ndarray) -> np.ndarray:
    """Return any triangulation (n - 2, 3) of a polygon without holes, as positions in `cycle`."""
    n = len(cycle)
    position = np.empty(len(outline.points), dtype=np.int32)
    position[cycle] = np.arange(n, dtype=np.int32)
    return np.asarray(position[find_any_triangulation(outline)])
