"""Verification that triangles are a triangulation of a polygon, and repair of T-junctions.

Take the directed edges of counter-clockwise triangles; an edge cancels the same edge in the
opposite direction. If the edges that remain are the polygon's boundary, the triangles cover each
point as often as the boundary winds around it: once inside, never outside. If edges cancel only
after they are split at vertices that lie on them, these vertices are T-junctions: the triangles
cover the polygon, but the triangulation is not conforming.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from triangulators.compute.kernels import njit
from triangulators.criteria import predict
from triangulators.geometry.half_edges import is_triangulation, link_half_edges
from triangulators.geometry.predicates import compute_orientations, find_edge_tolerance, orientation
from triangulators.polygon import Boundary, boundary, boundary_area, find_vertices_on_edges
from triangulators.polygon_arrays import PolygonArray, offsets_of, rings_at

Edge = tuple[int, int]


@dataclass(frozen=True)
class Verification:
    """The result of `verify`."""

    triangles: int
    expected_triangles: int  # in a conforming triangulation
    area_error: float  # area of triangles minus the polygon's, in square units of the coordinates
    problems: list[str] = field(default_factory=list)  # why the polygon is not covered exactly once
    t_junctions: list[tuple[int, Edge]] = field(default_factory=list)  # (vertex, edge through it)

    @property
    def ok(self) -> bool:
        """Whether the triangles, counter-clockwise, cover the polygon exactly once."""
        return not self.problems

    @property
    def conforming(self) -> bool:
        """Whether the triangles are `ok` and without T-junctions."""
        return self.ok and not self.t_junctions


def verify(polygon: shapely.Polygon, triangles: np.ndarray) -> Verification:
    """Check whether triangles are a triangulation of a valid polygon.

    Parameters
    ----------
    polygon
        A valid polygon; holes are allowed.
    triangles
        (m, 3) indices into `vertices(polygon)`.

    Returns
    -------
    Verification
        `ok` and `conforming` are the answer, `problems` and `t_junctions` the reasons.

    Examples
    --------
    >>> square = shapely.Polygon([(0, 0), (2, 0), (2, 2), (0, 2)])
    >>> verify(square, np.array([(0, 1, 2), (0, 2, 3)])).conforming
    True
    >>> verify(square, np.array([(0, 1, 2)])).problems[0]
    'gap or overlap along the edge between vertices 0 and 2'
    """
    return verify_boundary(boundary(polygon), triangles)


def verify_boundary(outline: Boundary, triangles: np.ndarray) -> Verification:
    """Check whether triangles (m, 3) are a triangulation of a polygon; see `verify`."""
    expected = outline.expected_triangles
    try:
        triangles = check_triangle_indices(triangles, outline.points)
    except ValueError as error:
        return Verification(len(triangles), expected, float("nan"), [str(error)])
    turns = compute_orientations(outline.points, triangles)
    problems = [f"triangle {row} is clockwise" for row in np.flatnonzero(turns < 0.0)[:5]]
    problems += [f"triangle {row} has no area" for row in np.flatnonzero(turns == 0.0)[:5]]
    loose = find_unmatched_edges(outline, triangles)
    junctions: list[tuple[int, Edge]] = []
    if loose:
        on_edges = find_vertices_on_edges(
            outline, np.array(list(loose), np.int32), find_edge_tolerance(outline.points)
        )
        balance: Counter[Edge] = Counter()
        for (a, b), times in loose.items():
            inside = on_edges.get((a, b), [])
            junctions += [(vertex, (a, b)) for vertex in inside]
            for tail, head in pairwise([a, *inside, b]):
                balance[min(tail, head), max(tail, head)] += times if tail < head else -times
        gaps = [edge for edge, times in balance.items() if times]
        problems += [
            f"gap or overlap along the edge between vertices {a} and {b}" for a, b in gaps[:5]
        ]
    if not problems and not junctions and len(triangles) != expected:
        problems.append(f"{len(triangles)} triangles, expected {expected}")
    covered = predict(outline.points, triangles)["area"] if len(triangles) else 0.0
    area_error = covered - boundary_area(outline)
    return Verification(len(triangles), expected, area_error, problems, junctions)


def check_triangle_indices(triangles: Any, points: np.ndarray) -> np.ndarray:
    """Return triangles as int32 (m, 3); raise `ValueError` unless they index `points` (n, 2)."""
    array = np.asarray(triangles)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"triangles have shape {array.shape}, expected (m, 3)")
    if array.size and array.dtype.kind not in "iu":
        raise ValueError(f"triangles are {array.dtype}, expected integer indices")
    rows = np.ascontiguousarray(array, dtype=np.int32)
    overflows = array.dtype.itemsize > rows.itemsize and not np.array_equal(rows, array)
    if overflows or not _are_indices_below(len(points), rows):
        raise ValueError(f"triangles have indices outside 0..{len(points) - 1}")
    return rows


@njit(nogil=True)
def _are_indices_below(count: int, triangles: np.ndarray) -> bool:
    # `triangles.min()` would import SciPy's linear algebra whenever this kernel is loaded (0.13 s).
    in_range = True
    for vertex in triangles.reshape(-1):
        in_range = in_range and 0 <= vertex < count
    return in_range


def find_unmatched_edges(outline: Boundary, triangles: np.ndarray) -> Counter[Edge]:
    """Return the directed edges, pairs of sites, that do not cancel, with their multiplicities.

    A triangle's edge counts 1, a boundary edge -1, and a-b cancels b-a.
    """
    size = len(outline.points)
    corners = outline.site[triangles].astype(np.int64)
    tails = np.concatenate((corners.ravel(), outline.edges[:, 1]))
    heads = np.concatenate((corners[:, [1, 2, 0]].ravel(), outline.edges[:, 0]))
    low, high = np.minimum(tails, heads), np.maximum(tails, heads)
    keys, inverse = np.unique(low * size + high, return_inverse=True)
    balance = np.bincount(inverse, weights=np.where(tails < heads, 1, -1), minlength=len(keys))
    loose: Counter[Edge] = Counter()
    for index in np.flatnonzero(balance).tolist():
        a, b = divmod(int(keys[index]), size)
        times = int(balance[index])
        loose[(a, b) if times > 0 else (b, a)] = abs(times)
    return loose


def find_unconfirmed(polygons: PolygonArray, triangles: Mapping[int, np.ndarray]) -> list[int]:
    """Return the indices of polygons whose triangles a fast check does not confirm.

    These may still cover the polygon, for example with T-junctions: `verify` decides.
    """
    if not triangles:
        return []
    rows = np.concatenate(list(triangles.values())).astype(np.int32)
    row_offsets = offsets_of([len(piece) for piece in triangles.values()])
    arrays = (polygons.coords.astype(np.float64), polygons.ring_offsets, polygons.geom_offsets)
    return list(_list_unconfirmed_polygons(arrays, np.array(list(triangles)), rows, row_offsets))


@njit(nogil=True)
def _list_unconfirmed_polygons(
    polygons: tuple[np.ndarray, np.ndarray, np.ndarray],
    indices: np.ndarray,
    triangles: np.ndarray,
    row_offsets: np.ndarray,
) -> list[int]:
    """Return the indices among `indices` (k,) whose triangles `is_triangulation` rejects."""
    coords, ring_offsets, geom_offsets = polygons
    unconfirmed = [0 for _ in range(0)]
    for k in range(len(indices)):
        points, rings = rings_at(indices[k], coords, ring_offsets, geom_offsets)
        rows = triangles[row_offsets[k] : row_offsets[k + 1]]
        corner = rows.reshape(-1)
        in_range = len(rows) > 0 and _are_indices_below(len(points), rows)
        if not in_range or not is_triangulation(points, rings, corner, link_half_edges(corner)):
            unconfirmed.append(indices[k])
    return unconfirmed


@njit(nogil=True)
def orient_triangles(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return triangles (m, 3), all counter-clockwise, without triangles of zero area."""
    oriented, count = np.empty_like(triangles), 0
    for row in range(len(triangles)):
        a, b, c = triangles[row, 0], triangles[row, 1], triangles[row, 2]
        turn = orientation(points, a, b, c)
        if turn != 0.0:
            oriented[count, 0] = a
            oriented[count, 1], oriented[count, 2] = (b, c) if turn > 0.0 else (c, b)
            count += 1
    return oriented[:count]


def insert_dropped_vertices(outline: Boundary, triangles: np.ndarray) -> np.ndarray:
    """Split triangles (m, 3) at vertices that lie on their edges; return the new triangles, int32.

    Area, coverage and the order of unsplit triangles do not change. A sliver with a vertex on the
    opposite edge is removed: the triangle across that edge is split there.
    """
    loose = find_unmatched_edges(outline, triangles)
    if not loose:
        return triangles
    inside = find_vertices_on_edges(
        outline, np.array(list(loose), np.int32), find_edge_tolerance(outline.points)
    )
    sites = outline.site[triangles].astype(np.int64)
    keys = sites * len(outline.points) + np.roll(sites, -1, axis=1)
    with_vertex = [tail * len(outline.points) + head for tail, head in inside]
    affected = np.isin(keys, with_vertex).any(axis=1)
    pieces, copied = [], 0
    for row in np.flatnonzero(affected).tolist():
        pieces.append(triangles[copied:row])
        copied, corners = row + 1, triangles[row].tolist()
        chains = []
        for tail, head in zip(corners, corners[1:] + corners[:1], strict=True):
            on_edge = inside.get((int(outline.site[tail]), int(outline.site[head])), [])
            chains.append([tail, *on_edge, head])
        result: list[tuple[int, int, int]] = []
        if not any(set(chain[1:-1]) & set(corners) for chain in chains):
            _split_triangle(chains, result)
        pieces.append(np.array(result, dtype=np.int32).reshape(-1, 3))
    return np.concatenate([*pieces, triangles[copied:]]).astype(np.int32)


def _split_triangle(chains: list[list[int]], result: list[tuple[int, int, int]]) -> None:
    for first in range(3):
        edge, second, third = chains[first], chains[first - 2], chains[first - 1]
        if len(edge) > 2:
            vertex, apex = edge[1], third[0]
            _split_triangle([edge[:2], [vertex, apex], third], result)
            _split_triangle([edge[1:], second, [apex, vertex]], result)
            return
    result.append((chains[0][0], chains[1][0], chains[2][0]))
