"""Random polygons with holes, whole and real, with collinear and touching vertices; and checks."""

from collections.abc import Iterator

import numpy as np
import shapely

from tests.ports.languages import Cases
from triangulators.geometry.predicates import turns
from triangulators.polygon import rings_of

Rings = tuple[np.ndarray, np.ndarray]


def earcut_rings(polygon: shapely.Polygon) -> Rings:
    """Return vertices (n, 2) and where each ring ends, uint32, as mapbox_earcut takes them."""
    points, ring_offsets = rings_of(polygon)
    return points, ring_offsets[1:].astype(np.uint32)


_LARGE = 2**25


def random_polygons(seed: int, count: int) -> Iterator[Rings]:
    """Yield (points, ring ends) of `count` polygons; the same for the same seed."""
    rng = np.random.default_rng(seed)
    made = 0
    while made < count:
        for shape in (_cells, _star, _pieces):
            for polygon in shape(rng):
                if made < count and polygon.area > 0.0:
                    yield _placed(rng, *earcut_rings(polygon))
                    made += 1


def _parts(shape: shapely.Geometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon)]


def _cells(rng: np.random.Generator) -> list[shapely.Polygon]:
    """Squares of a grid: right angles, holes that touch, and every corner of a square a vertex."""
    side = int(rng.integers(2, 8))
    x, y = np.nonzero(rng.random((side, side)) < rng.uniform(0.4, 0.9))
    found = _parts(shapely.union_all(shapely.box(x, y, x + 1, y + 1)))
    return [shapely.segmentize(each, 1.0) for each in found] if rng.random() < 0.5 else found


def _star(rng: np.random.Generator) -> list[shapely.Polygon]:
    """A star, thin or round, with small ones for holes."""
    outline = _ring(rng, int(rng.integers(3, 60)), 0.0, 0.0, 1.0)
    polygon = shapely.make_valid(shapely.Polygon(outline))
    for _ in range(int(rng.integers(0, 4))):
        hole = _ring(rng, int(rng.integers(3, 9)), *rng.uniform(-0.5, 0.5, 2), 0.2)
        polygon = polygon.difference(shapely.make_valid(shapely.Polygon(hole)))
    return _parts(polygon)


def _ring(rng: np.random.Generator, n: int, x: float, y: float, size: float) -> np.ndarray:
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, n))
    radius = size * rng.uniform(rng.choice([0.1, 0.7]), 1.0, n)
    return np.column_stack((x + radius * np.cos(angle), y + radius * np.sin(angle)))


def _pieces(rng: np.random.Generator) -> list[shapely.Polygon]:
    """Triangles put together, often on whole coordinates: narrow gaps and touching holes."""
    corners = rng.integers(0, 12, (int(rng.integers(2, 9)), 3, 2)).astype(float)
    return _parts(shapely.union_all(shapely.make_valid(shapely.polygons(corners)), grid_size=1.0))


def _placed(rng: np.random.Generator, points: np.ndarray, ends: np.ndarray) -> Rings:
    """Return a polygon moved, scaled and sheared: some whole, up to 2^25, some on no grid."""
    low, high = points.min(), points.max()
    room = max(float(high - low), 1.0)
    kind = int(rng.integers(4))
    if kind == 0 and np.array_equal(points, np.rint(points)):
        # Whole: the largest exact ones, moved and sheared.
        scale = int(rng.integers(1, max(2, int(_LARGE / (2 * max(abs(low), abs(high), 1.0))))))
        points = points * scale
        if rng.random() < 0.5:
            points = np.column_stack((points[:, 0], points[:, 1] + np.floor(points[:, 0] / 2.0)))
    elif kind == 1:
        points = np.round(points * (4096.0 / room))  # as in a tile: touches, folds, collapses
    elif kind == 2:
        points = points @ rng.normal(size=(2, 2)) + rng.normal(size=2) * 1000.0
    else:
        points = points * 10.0 ** rng.integers(-6, 7) + rng.normal() * 10.0 ** rng.integers(-3, 9)
    return points, ends


def is_as_before(cases: Cases, corners: np.ndarray) -> bool:
    """Whether flips kept every triangulation valid, exactly.

    No more triangles fail to turn left, and what triangles do not share, which is the boundary, is
    the same edges: so are the covered area and the vertices.
    """
    before, after = (_all(cases, own) for own in (cases.corners, corners))
    lefts = [int((turns(cases.points, rows) > 0.0).sum()) for rows in (before, after)]
    borders = [_border(rows, len(cases.points)) for rows in (before, after)]
    same = all(np.array_equal(a, b) for a, b in zip(*borders, strict=True))
    return lefts[0] <= lefts[1] and same and np.array_equal(np.unique(before), np.unique(after))


def _all(cases: Cases, corners: np.ndarray) -> np.ndarray:
    """Return triangles (m, 3) as indices of all points."""
    first = np.repeat(cases.bounds[:-1, 0], np.diff(cases.bounds[:, 1]))
    return (corners + first).astype(np.int32).reshape(-1, 3)


def _border(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return edges and how much more often they are met in one direction than in the other."""
    tails, heads = (
        triangles.astype(np.int64).ravel(),
        triangles[:, [1, 2, 0]].astype(np.int64).ravel(),
    )
    keys, place = np.unique(
        np.minimum(tails, heads) * count + np.maximum(tails, heads), return_inverse=True
    )
    more = np.bincount(place.ravel(), weights=np.where(tails < heads, 1.0, -1.0))
    return keys[more != 0.0], more[more != 0.0]
