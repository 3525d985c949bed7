"""A shapely polygon as arrays of vertices, rings and boundary edges.

Most polygons are a simple ring, which `find_ring_orientation` recognises if a float64 filter is
certain; for a building, this takes a tenth of the time of GEOS's general validity test. GEOS tests
all other polygons, and provides the reasons for error messages.
"""

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely

from triangulators.compute.kernels import njit
from triangulators.errors import InvalidPolygonError
from triangulators.geometry.predicates import ORIENTATION_FILTER, find_touching_vertices, orient
from triangulators.polygon_arrays import offsets_of

MAX_SIMPLE_VERTICES = 96  # larger rings are tested by GEOS: comparing all pairs of edges is slow

UNSURE, COUNTERCLOCKWISE, CLOCKWISE = 0, 1, -1  # results of `find_ring_orientation`


class Boundary(NamedTuple):
    """A polygon's boundary, oriented so that the interior lies on the left.

    Edges of length zero are omitted, and edges with a vertex of another ring on them are split.
    """

    points: np.ndarray  # (n, 2): `vertices(polygon)`
    ring_offsets: np.ndarray  # (h + 2,): offsets of the rings in `points`
    site: np.ndarray  # (n,): the first vertex with equal coordinates; rings that touch share a site
    edges: np.ndarray  # (b, 2): directed boundary edges between sites, ring by ring
    holes: int  # number of interiors

    @property
    def expected_triangles(self) -> int:
        """Number of triangles in every conforming triangulation, by Euler's formula.

        2V - B - 2(1 - h), with V sites, B boundary edges and h holes: n + 2h - 2 for n vertices if
        no vertex is repeated.
        """
        if self.simple:
            return len(self.edges) - 2
        return 2 * len(np.unique(self.edges)) - len(self.edges) - 2 * (1 - self.holes)

    @property
    def has_plain_rings(self) -> bool:
        """Whether no vertex is repeated, and no vertex lies on another ring."""
        count = len(self.points)
        return len(self.edges) == count and bool((self.site == np.arange(count)).all())

    @property
    def simple(self) -> bool:
        """Whether the boundary is a single ring without repeated vertices."""
        return self.holes == 0 and len(self.edges) == len(self.points)


def check_polygon(polygon: shapely.Polygon) -> None:
    """Raise `InvalidPolygonError` with the reason unless `polygon` is a valid polygon."""
    if not isinstance(polygon, shapely.Polygon):
        raise InvalidPolygonError(f"expected a shapely Polygon, got {type(polygon).__name__}")
    if polygon.is_empty:
        raise InvalidPolygonError("the polygon is empty")
    if not polygon.is_valid:
        if not np.isfinite(shapely.get_coordinates(polygon)).all():
            raise InvalidPolygonError("the polygon has coordinates that are NaN or infinite")
        raise InvalidPolygonError(f"the polygon is not valid: {shapely.is_valid_reason(polygon)}")


def rings_of(polygon: shapely.Polygon) -> tuple[np.ndarray, np.ndarray]:
    """Return the vertices (n, 2) and the offsets of the rings, (h + 2,) int64."""
    lengths = shapely.get_num_points(shapely.get_rings(polygon))
    coordinates = shapely.get_coordinates(polygon)
    is_distinct = np.ones(len(coordinates), dtype=bool)
    is_distinct[np.cumsum(lengths) - 1] = False  # shapely repeats a ring's first vertex at the end
    return coordinates[is_distinct], offsets_of(lengths - 1)


def vertices(polygon: shapely.Polygon) -> np.ndarray:
    """Return the vertices of a polygon, which triangulations index.

    Parameters
    ----------
    polygon
        A polygon, valid or not.

    Returns
    -------
    ndarray
        (n, 2) float64: the exterior ring, then the interiors in order. The first vertex of a ring
        is not repeated at the end.

    Examples
    --------
    >>> vertices(shapely.Polygon([(0, 0), (2, 0), (0, 1)])).tolist()
    [[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]]
    """
    return rings_of(polygon)[0]


def find_sites(points: np.ndarray) -> np.ndarray:
    """Return, for each point (n, 2), the index (n,) of the first point with equal coordinates."""
    numbers = np.ascontiguousarray(points).view(np.complex128).ravel()
    _, first, which = np.unique(numbers, return_index=True, return_inverse=True)
    return first[which].astype(np.int32)


def boundary(polygon: shapely.Polygon) -> Boundary:
    """Return the `Boundary` of a valid polygon."""
    outline = _make_simple_boundary(polygon)
    return make_boundary(*rings_of(polygon)) if outline is None else outline


def checked_boundary(polygon: shapely.Polygon) -> Boundary:
    """Return a polygon's `Boundary`; raise `InvalidPolygonError` if the polygon is invalid."""
    outline = _make_simple_boundary(polygon) if isinstance(polygon, shapely.Polygon) else None
    if outline is None:
        check_polygon(polygon)
        outline = make_boundary(*rings_of(polygon))
    return outline


def _make_simple_boundary(polygon: shapely.Polygon) -> Boundary | None:
    """Return the `Boundary` of a certainly simple ring, or None; see `find_ring_orientation`."""
    coordinates = shapely.get_coordinates(polygon)
    orientation = find_ring_orientation(coordinates)
    if orientation == UNSURE:
        return None
    n = len(coordinates) - 1
    site, edges = _make_simple_ring_edges(n, orientation == COUNTERCLOCKWISE)
    return Boundary(coordinates[:n], np.array((0, n)), site.copy(), edges.copy(), 0)


@njit(nogil=True)
def find_ring_orientation(coordinates: np.ndarray) -> int:
    """Return COUNTERCLOCKWISE or CLOCKWISE if a ring is certainly simple, otherwise UNSURE.

    coordinates (n + 1, 2): closed, as in shapely. A polygon with holes is UNSURE.
    """
    n = len(coordinates) - 1
    if n < 3 or n > MAX_SIMPLE_VERTICES:
        return UNSURE
    x, y = coordinates[0, 0], coordinates[0, 1]
    if coordinates[n, 0] != x or coordinates[n, 1] != y:
        return UNSURE
    area, span = 0.0, 0.0
    for a in range(n):
        ax, ay = coordinates[a, 0], coordinates[a, 1]
        bx, by = coordinates[a + 1, 0], coordinates[a + 1, 1]
        if a > 0 and ax == x and ay == y:
            return UNSURE
        if not (abs(ax) < 1e150 and abs(ay) < 1e150):  # NaN, or products would overflow
            return UNSURE
        span = max(span, abs(ax - x), abs(ay - y))
        area += (ax - x) * (by - y) - (ay - y) * (bx - x)
        # Return UNSURE if the next edge runs back along edge a.
        c = a + 2 if a + 2 <= n else 1
        cx, cy = coordinates[c, 0], coordinates[c, 1]
        ahead = (bx - ax) * (cx - bx) + (by - ay) * (cy - by)
        if not ahead > 0.0 and orient(ax, ay, bx, by, cx, cy) == 0.0:
            return UNSURE
    for a in range(n):
        if not _meets_no_later_edge(coordinates, a, n):
            return UNSURE
    if not abs(area) > 1e-12 * span * span * n:
        return UNSURE
    return COUNTERCLOCKWISE if area > 0.0 else CLOCKWISE


@njit(nogil=True)
def _meets_no_later_edge(coordinates: np.ndarray, a: int, n: int) -> bool:
    """Whether edge a of a ring of n edges certainly meets none of the edges a + 2, a + 3, ...."""
    ax, ay = coordinates[a, 0], coordinates[a, 1]
    bx, by = coordinates[a + 1, 0], coordinates[a + 1, 1]
    low_x, high_x = min(ax, bx), max(ax, bx)
    low_y, high_y = min(ay, by), max(ay, by)
    for c in range(a + 2, n if a > 0 else n - 1):
        cx, cy = coordinates[c, 0], coordinates[c, 1]
        dx, dy = coordinates[c + 1, 0], coordinates[c + 1, 1]
        if max(cx, dx) < low_x or min(cx, dx) > high_x:
            continue
        if max(cy, dy) < low_y or min(cy, dy) > high_y:
            continue
        if _find_side(ax, ay, bx, by, cx, cy) * _find_side(ax, ay, bx, by, dx, dy) == 1:
            continue
        if _find_side(cx, cy, dx, dy, ax, ay) * _find_side(cx, cy, dx, dy, bx, by) == 1:
            continue
        return False
    return True


@njit(nogil=True)
def _find_side(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> int:
    """Return 1 if c is certainly left of a-b, -1 if certainly right, 0 if uncertain or on a-b."""
    positive, negative = (ax - cx) * (by - cy), (ay - cy) * (bx - cx)
    determinant = positive - negative
    if abs(determinant) <= ORIENTATION_FILTER * (abs(positive) + abs(negative)):
        return 0
    return 1 if determinant > 0.0 else -1


@lru_cache(maxsize=256)
def _make_simple_ring_edges(n: int, is_counterclockwise: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the sites (n,) and the boundary edges (n, 2) of a simple ring of n vertices."""
    site = np.arange(n, dtype=np.int32)
    ring = site if is_counterclockwise else site[::-1]
    return site, np.column_stack((ring, np.roll(ring, -1)))


@njit(nogil=True)
def twice_ring_area(points: np.ndarray) -> float:
    """Return twice the signed area of a ring (n, 2), positive if counter-clockwise."""
    area = 0.0
    for k in range(len(points)):
        after = points[k + 1] if k + 1 < len(points) else points[0]
        area += (points[k, 0] - points[0, 0]) * (after[1] - points[0, 1])
        area -= (points[k, 1] - points[0, 1]) * (after[0] - points[0, 0])
    return area


@njit(nogil=True)
def orient_rings(points: np.ndarray, ring_offsets: np.ndarray) -> np.ndarray:
    """Return vertex indices (n,) ring by ring, the exterior counter-clockwise, holes clockwise."""
    ring = np.empty(len(points), dtype=np.int32)
    for number in range(len(ring_offsets) - 1):
        start, end = ring_offsets[number], ring_offsets[number + 1]
        is_counterclockwise = twice_ring_area(points[start:end]) > 0.0
        for k in range(start, end):
            ring[k] = k if is_counterclockwise == (number == 0) else end - 1 - (k - start)
    return ring


def make_boundary(points: np.ndarray, ring_offsets: np.ndarray) -> Boundary:
    """Return the `Boundary` of the rings of a valid polygon.

    If rings touch, edges are split at vertices exactly on an edge, as GEOS's validity test decides.
    If a vertex is within rounding error of an edge, the sliver between belongs to the polygon.
    """
    site = find_sites(points)
    edges = []
    for ring in np.split(orient_rings(points, ring_offsets), ring_offsets[1:-1]):
        corners = site[ring]
        pairs = np.column_stack((corners, np.roll(corners, -1)))
        edges.append(pairs[pairs[:, 0] != pairs[:, 1]])
    outline = Boundary(points, ring_offsets, site, np.concatenate(edges), len(ring_offsets) - 2)
    inside = find_vertices_on_edges(outline, outline.edges, 0.0) if outline.holes else {}
    if not inside:
        return outline
    chains = [[a, *inside.get((a, b), ()), b] for a, b in outline.edges.tolist()]
    split = [pair for chain in chains for pair in pairwise(chain)]
    return outline._replace(edges=np.array(split, dtype=site.dtype))


def find_vertices_on_edges(
    outline: Boundary, edges: np.ndarray, allowed: float
) -> dict[tuple[int, int], list[int]]:
    """Return the vertices inside each edge a-b, from a to b; omit edges without any."""
    points, candidates = outline.points, np.unique(outline.edges)
    candidates = candidates[np.argsort(points[candidates, 0])]
    incidences = find_touching_vertices(points, edges, candidates, allowed)
    inside: dict[tuple[int, int], list[int]] = {}
    for number, v in sorted(incidences):
        a, b = edges[number].tolist()
        inside.setdefault((a, b), []).append(v)
    for (a, b), between in inside.items():
        along = (points[between] - points[a]) @ (points[b] - points[a])
        inside[a, b] = [between[k] for k in np.argsort(along, kind="stable").tolist()]
    return inside


def boundary_area(outline: Boundary) -> float:
    """Return the area of a polygon, in square units of its coordinates."""
    shifted = outline.points - outline.points[0]
    a, b = shifted[outline.edges[:, 0]], shifted[outline.edges[:, 1]]
    return float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])) / 2.0
