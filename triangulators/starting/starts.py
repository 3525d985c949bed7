"""Triangulations to start from, and the simple polygon to work on."""

from typing import NamedTuple

import numpy as np

from triangulators.checking.edges import edges_of
from triangulators.criteria.cost import Cost, evaluate
from triangulators.errors import Skipped, TriangulationError
from triangulators.geometry.half_edges import is_triangulation, link, twins_of
from triangulators.geometry.predicates import turns
from triangulators.geometry.visibility import visible_pairs
from triangulators.libraries import delaunay, ear_clipping
from triangulators.polygon import Boundary
from triangulators.starting.diagonals import shortest_first
from triangulators.starting.repair import insert_dropped_vertices
from triangulators.verify import verify_boundary

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
    local = position[outline.site[ear_clipping.triangulate(outline)]]
    corner = local.reshape(-1)
    if is_triangulation(outline.points[cycle], np.array([n]), corner, link(corner)):
        return local
    return position[starts(outline)[0]]


def starts(outline: Boundary) -> list[np.ndarray]:
    """Return the conforming ones of ear clipping and Delaunay, dropped vertices put back.

    Where neither is, because they leave out slivers that float64 can tell from nothing, the greedy
    triangulation by exact orientations. Raises `TriangulationError` if that fails, too.
    """
    found = []
    for method in (ear_clipping, delaunay):
        try:
            raw = np.ascontiguousarray(method.triangulate(outline), dtype=np.int32)
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
    return min(starts(outline), key=lambda triangles: evaluate(outline.points, triangles, cost))


def left_turning(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return int32 triangles wound counter-clockwise, those without area left out."""
    triangles = np.ascontiguousarray(triangles, dtype=np.int32)
    orientation = turns(points, triangles)
    if (orientation > 0.0).all():
        return triangles
    triangles = np.where((orientation < 0.0)[:, None], triangles[:, [0, 2, 1]], triangles)
    return np.ascontiguousarray(triangles[orientation != 0.0])
