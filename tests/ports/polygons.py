"""Random polygons with holes, integer or real, with collinear or touching vertices; checks."""

from collections.abc import Iterator, Sequence

import numpy as np
import shapely

from tests.ports.languages import Cases
from triangulators.geometry.predicates import compute_orientations
from triangulators.polygon import rings_of

Rings = tuple[np.ndarray, np.ndarray]


def earcut_rings(polygon: shapely.Polygon) -> Rings:
    """Return vertices (n, 2) and ends of rings, uint32, as mapbox_earcut takes them."""
    points, ring_offsets = rings_of(polygon)
    return points, ring_offsets[1:].astype(np.uint32)


def flatten_rings(rings: Sequence[np.ndarray]) -> Rings:
    """Return the vertices (n, 2) and ends, uint32, of rings (k, 2)."""
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    return np.concatenate([ring.reshape(-1, 2) for ring in rings]), ends


_MAX_INTEGER = 2**25


def random_polygons(seed: int, count: int) -> Iterator[Rings]:
    """Yield (points, ring ends) of `count` polygons, reproducible by seed."""
    rng = np.random.default_rng(seed)
    yielded = 0
    while yielded < count:
        for shape in (_make_cells, _make_star, _make_overlay):
            for polygon in shape(rng):
                if yielded < count and polygon.area > 0.0:
                    yield _transform(rng, *earcut_rings(polygon))
                    yielded += 1


def _list_polygons(shape: shapely.Geometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon)]


def _make_cells(rng: np.random.Generator) -> list[shapely.Polygon]:
    """Return unions of grid squares: right angles, touching holes, often collinear vertices."""
    side = int(rng.integers(2, 8))
    x, y = np.nonzero(rng.random((side, side)) < rng.uniform(0.4, 0.9))
    polygons = _list_polygons(shapely.union_all(shapely.box(x, y, x + 1, y + 1)))
    return list(shapely.segmentize(polygons, 1.0)) if rng.random() < 0.5 else polygons


def _make_star(rng: np.random.Generator) -> list[shapely.Polygon]:
    """Return a thin or round star with small stars as holes."""
    outline = _make_ring(rng, int(rng.integers(3, 60)), 0.0, 0.0, 1.0)
    polygon = shapely.make_valid(shapely.Polygon(outline))
    for _ in range(int(rng.integers(0, 4))):
        hole = _make_ring(rng, int(rng.integers(3, 9)), *rng.uniform(-0.5, 0.5, 2), 0.2)
        polygon = polygon.difference(shapely.make_valid(shapely.Polygon(hole)))
    return _list_polygons(polygon)


def _make_ring(rng: np.random.Generator, n: int, x: float, y: float, size: float) -> np.ndarray:
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, n))
    radius = size * rng.uniform(rng.choice([0.1, 0.7]), 1.0, n)
    return np.column_stack((x + radius * np.cos(angle), y + radius * np.sin(angle)))


def _make_overlay(rng: np.random.Generator) -> list[shapely.Polygon]:
    """Return unions of triangles on integer coordinates, with narrow gaps and touching holes."""
    corners = rng.integers(0, 12, (int(rng.integers(2, 9)), 3, 2)).astype(float)
    triangles = shapely.make_valid(shapely.polygons(corners))
    return _list_polygons(shapely.union_all(triangles, grid_size=1.0))


def _transform(rng: np.random.Generator, points: np.ndarray, ends: np.ndarray) -> Rings:
    """Return a polygon moved, scaled and sheared: integers up to 2^25, rounded, or real."""
    low, high = points.min(), points.max()
    extent = max(float(high - low), 1.0)
    kind = int(rng.integers(4))
    if kind == 0 and np.array_equal(points, np.rint(points)):
        # Integers up to the largest exact ones, moved and sheared.
        max_scale = int(_MAX_INTEGER / (2 * max(abs(low), abs(high), 1.0)))
        points = points * int(rng.integers(1, max(2, max_scale)))
        if rng.random() < 0.5:
            points = np.column_stack((points[:, 0], points[:, 1] + np.floor(points[:, 0] / 2.0)))
    elif kind == 1:
        points = np.round(points * (4096.0 / extent))  # as in a map tile, where rings may collapse
    elif kind == 2:
        points = points @ rng.normal(size=(2, 2)) + rng.normal(size=2) * 1000.0
    else:
        points = points * 10.0 ** rng.integers(-6, 7) + rng.normal() * 10.0 ** rng.integers(-3, 9)
    return points, ends


def is_equivalent(cases: Cases, corners: np.ndarray) -> bool:
    """Return whether flips left every triangulation valid, exactly.

    The number of counter-clockwise triangles must not decrease, and the boundary, the edges that
    triangles do not share, must be the same, so that area and vertices are the same, too.
    """
    before, after = (_global_triangles(cases, indices) for indices in (cases.corners, corners))
    positive = [
        int((compute_orientations(cases.points, rows) > 0.0).sum()) for rows in (before, after)
    ]
    borders = [_find_border(rows, len(cases.points)) for rows in (before, after)]
    same = all(np.array_equal(a, b) for a, b in zip(*borders, strict=True))
    return positive[0] <= positive[1] and same and set(before.flat) == set(after.flat)


def _global_triangles(cases: Cases, corners: np.ndarray) -> np.ndarray:
    """Return triangles (m, 3) as indices into all points."""
    first = np.repeat(cases.bounds[:-1, 0], np.diff(cases.bounds[:, 1]))
    return (corners + first).astype(np.int32).reshape(-1, 3)


def _find_border(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return keys of edges, and the excess of one direction over the other where it is not 0."""
    tails, heads = (triangles[:, c].astype(np.int64).ravel() for c in ([0, 1, 2], [1, 2, 0]))
    edges = np.minimum(tails, heads) * count + np.maximum(tails, heads)
    keys, index = np.unique(edges, return_inverse=True)
    excess = np.bincount(index.ravel(), weights=np.where(tails < heads, 1.0, -1.0))
    return keys[excess != 0.0], excess[excess != 0.0]
