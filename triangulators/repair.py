"""Repair of a library's triangles: orientation, and vertices that were dropped."""

import numpy as np

from triangulators.geometry.predicates import ALL_LEFT, all_left, tolerance, turns
from triangulators.polygon import Boundary, vertices_on
from triangulators.verify import unmatched_edges


def left_turning(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return int32 triangles oriented counter-clockwise, without those of no area."""
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
