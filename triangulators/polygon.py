"""A shapely polygon as arrays: its vertices, its rings, its boundary edges."""

from collections.abc import Callable
from functools import lru_cache, wraps
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np
import shapely

from triangulators.errors import InvalidPolygon
from triangulators.geometry.predicates import on_segment, touching
from triangulators.geometry.simple_ring import LEFT, UNSURE, winding

Result = TypeVar("Result")

_BRUTE_FORCE = 2000  # edges; beyond, touching rings are looked for with a tree


class Boundary(NamedTuple):
    """A polygon's boundary, oriented so that the interior lies on the left.

    `points` (n, 2) are `vertices(polygon)` and `ends` (h + 1,) where its rings end; `site` (n,)
    maps a vertex to the first vertex with the same coordinates, so that rings which touch share a
    site; `edges` (b, 2) are directed boundary edges between sites, ring after ring: those of
    length zero are left out, and those on which another ring's vertex lies are split there;
    `holes` counts interiors.
    """

    points: np.ndarray
    ends: np.ndarray
    site: np.ndarray
    edges: np.ndarray
    holes: int

    @property
    def expected_triangles(self) -> int:
        """Triangles in every conforming triangulation: 2V - B - 2(1 - h), by Euler's formula.

        V distinct vertices, B edges: n + 2h - 2 where no vertex is repeated.
        """
        if self.simple:
            return len(self.edges) - 2
        return 2 * len(np.unique(self.edges)) - len(self.edges) - 2 * (1 - self.holes)

    @property
    def simple(self) -> bool:
        """Whether the boundary is one ring without repeated vertices."""
        return self.holes == 0 and len(self.edges) == len(self.points)


def check(polygon: shapely.Polygon) -> None:
    """Raise `InvalidPolygon`, saying what and where, unless `polygon` is a valid polygon."""
    if not isinstance(polygon, shapely.Polygon):
        raise InvalidPolygon(f"expected a shapely Polygon, got {type(polygon).__name__}")
    if polygon.is_empty:
        raise InvalidPolygon("the polygon is empty")
    if not polygon.is_valid:
        if not np.isfinite(shapely.get_coordinates(polygon)).all():
            raise InvalidPolygon("the polygon has coordinates that are NaN or infinite")
        raise InvalidPolygon(f"the polygon is not valid: {shapely.is_valid_reason(polygon)}")


def rings_of(polygon: shapely.Polygon) -> tuple[np.ndarray, np.ndarray]:
    """Return (vertices, ring ends): (n, 2) float64 and (h + 1,) uint32, as mapbox_earcut takes."""
    lengths = shapely.get_num_points(shapely.get_rings(polygon))
    coordinates = shapely.get_coordinates(polygon)
    ends = np.cumsum(lengths)
    keep = np.ones(len(coordinates), dtype=bool)
    keep[ends - 1] = False  # shapely repeats a ring's first vertex at its end
    return coordinates[keep], (ends - np.arange(1, len(ends) + 1)).astype(np.uint32)


def vertices(polygon: shapely.Polygon) -> np.ndarray:
    """Return the polygon's vertices, (n, 2) float64: exterior ring, then the interiors in order.

    No ring's first vertex is repeated at its end. Triangulations index these rows.

        >>> vertices(shapely.Polygon([(0, 0), (2, 0), (0, 1)])).tolist()
        [[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]]
    """
    return rings_of(polygon)[0]


def sites(points: np.ndarray) -> np.ndarray:
    """Map each of (n, 2) points to the first one with equal coordinates, shape (n,) int32."""
    if len(points) == 0:
        return np.empty(0, dtype=np.int32)
    order = np.lexsort((points[:, 1], points[:, 0]))  # stable: equal points stay in order
    ordered = points[order]
    fresh = np.r_[True, np.any(ordered[1:] != ordered[:-1], axis=1)]
    result = np.empty(len(points), dtype=np.int32)
    result[order] = order[np.flatnonzero(fresh)][np.cumsum(fresh) - 1]
    return result


def signed_area(ring: np.ndarray) -> float:
    """Return the area of an open ring (n, 2), positive if counter-clockwise."""
    x, y = (ring - ring[0]).T  # shifted, so that large coordinates do not cancel
    return float(np.dot(x, np.roll(y, -1)) - np.dot(np.roll(x, -1), y)) / 2.0


def boundary(polygon: shapely.Polygon) -> Boundary:
    """Return the `Boundary` of a valid polygon."""
    outline = _of_simple_ring(polygon)
    return boundary_of_rings(*rings_of(polygon)) if outline is None else outline


def checked_boundary(polygon: shapely.Polygon) -> Boundary:
    """Do `check` and `boundary` in one; what is plainly a simple ring is valid without a test."""
    outline = _of_simple_ring(polygon) if isinstance(polygon, shapely.Polygon) else None
    if outline is None:
        check(polygon)
        outline = boundary_of_rings(*rings_of(polygon))
    return outline


def _of_simple_ring(polygon: shapely.Polygon) -> Boundary | None:
    coordinates = shapely.get_coordinates(polygon)
    turning = winding(coordinates)
    if turning == UNSURE:
        return None
    n = len(coordinates) - 1
    site, edges = _numbers(n, turning == LEFT)
    return Boundary(coordinates[:n], np.array((n,), np.uint32), site.copy(), edges.copy(), 0)


@lru_cache(maxsize=256)
def _numbers(n: int, left: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the sites and the boundary edges of a simple ring of n vertices."""
    site = np.arange(n, dtype=np.int32)
    ring = site if left else site[::-1]
    return site, np.column_stack((ring, np.roll(ring, -1)))


def as_polygon(outline: Boundary) -> shapely.Polygon:
    """Return the polygon that a `Boundary` was made of."""
    rings = np.split(outline.points, outline.ends[:-1])
    return shapely.Polygon(rings[0], rings[1:])


def boundary_of_rings(points: np.ndarray, ends: np.ndarray) -> Boundary:
    """Return the `Boundary` of rings given as in `rings_of`, the exterior first."""
    site = sites(points)
    edges = []
    start = 0
    for number, end in enumerate(ends.tolist()):
        ring = site[start:end]
        if (signed_area(points[start:end]) > 0.0) != (number == 0):
            ring = ring[::-1]
        pairs = np.column_stack((ring, np.roll(ring, -1)))
        edges.append(pairs[pairs[:, 0] != pairs[:, 1]])
        start = end
    joined = np.concatenate(edges)
    if len(ends) > 1:
        joined = _split_where_rings_touch(points, joined)
    return Boundary(points, ends, site, joined, len(ends) - 1)


def _split_where_rings_touch(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Split edges at the vertices that lie on them, exactly: as GEOS judges validity.

    A vertex beside an edge by less than a rounding error is not on it: what is between them is a
    sliver of the polygon, and triangulated as one.
    """
    allowed = 0.0
    if len(edges) <= _BRUTE_FORCE:
        found = touching(points, edges, allowed)
    else:
        tree = shapely.STRtree(shapely.linestrings(points[edges]))
        near, edge = tree.query(shapely.points(points[edges[:, 0]]))
        vertex = edges[near, 0]
        other = (edges[edge] != vertex[:, None]).all(axis=1)  # most are an end of their edge
        found = [
            (e, v)
            for e, v in zip(edge[other].tolist(), vertex[other].tolist(), strict=True)
            if on_segment(points, v, edges[e, 0], edges[e, 1], allowed)
        ]
    if not found:
        return edges
    inside: dict[int, list[int]] = {}
    for e, v in found:
        inside.setdefault(int(e), []).append(int(v))
    chains = []
    for e, (a, b) in enumerate(edges.tolist()):
        direction = points[b] - points[a]
        # Once each, also where several rings touch the edge at one point.
        on_it = set(inside.get(e, ()))
        between = sorted(on_it, key=lambda v: float(np.dot(points[v] - points[a], direction)))
        chain = [a, *between, b]
        chains += list(pairwise(chain))
    return np.array(chains, dtype=edges.dtype)


def boundary_area(outline: Boundary) -> float:
    """Return the polygon's area from its oriented boundary edges."""
    shifted = outline.points - outline.points[0]
    a, b = shifted[outline.edges[:, 0]], shifted[outline.edges[:, 1]]
    return float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])) / 2.0


def remembered(most: int) -> Callable[[Callable[[Boundary], Result]], Callable[[Boundary], Result]]:
    """Decorate a function of a `Boundary`: its results for the last `most` outlines are kept.

    Outlines of equal vertices and rings are one. Callers share a result: they must not change it.
    """

    def decorate(compute: Callable[[Boundary], Result]) -> Callable[[Boundary], Result]:
        @lru_cache(maxsize=most)
        def kept(points: bytes, ends: tuple[int, ...]) -> Result:
            corners = np.frombuffer(points).reshape(-1, 2).copy()  # a writable one, as earcut wants
            return compute(boundary_of_rings(corners, np.array(ends, np.uint32)))

        @wraps(compute)
        def look_up(outline: Boundary) -> Result:
            return kept(outline.points.tobytes(), tuple(outline.ends.tolist()))

        return look_up

    return decorate
