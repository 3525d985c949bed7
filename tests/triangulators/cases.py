"""Polygons for tests of triangulators, and all triangulations and costs by brute force."""

import json
import math
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import assume
from hypothesis import strategies as st

from tests.paths import find_shared_data
from triangulators import criteria
from triangulators.criteria.cost import make_cost
from triangulators.polygon import boundary, boundary_area

PAPER = shapely.Polygon([(3, 7), (0, 8), (1, 11), (7, 11), (7, 6), (6, 3), (3, 0), (1, 3), (3, 2)])


@cache
def read_rings(name: str) -> list[tuple[str, list[np.ndarray]]]:
    """Return the rings of a file of third-party data; skip the test if the file is missing."""
    entries = json.loads(find_shared_data(name).read_text())
    return [(e["name"], [np.array(r, dtype=float) for r in e["rings"]]) for e in entries]


@cache
def read_shared(name: str) -> list[tuple[str, shapely.Polygon]]:
    """Return the polygons of a file of third-party data that shapely can represent."""
    usable = [(label, [r for r in rings if len(r) >= 3]) for label, rings in read_rings(name)]
    return [(label, polygon_of(rings)) for label, rings in usable if rings]


def random_simple(rng: np.random.Generator, n: int, size: int = 20) -> shapely.Polygon:
    """Return a random simple polygon on a small grid, often with collinear vertices."""
    while True:
        points = rng.integers(0, size, (n, 2))
        if len(np.unique(points, axis=0)) < n:
            continue
        polygon = uncross_points(points)
        if polygon.is_valid and polygon.area > 0:
            return polygon


def uncross_points(points: np.ndarray) -> shapely.Polygon:
    """Return a polygon through all points (n, 2), usually without self-intersections."""
    distances = np.hypot(*(points[:, None] - points).transpose(2, 0, 1)).tolist()
    order = list(range(len(points)))
    for _ in range(60):
        if not _uncross(distances, order):
            break
    return shapely.Polygon(points[order])


def _uncross(distances: list[list[float]], order: list[int]) -> bool:
    """Reverse each piece that makes the ring shorter (2-opt); return whether any did."""
    changed = False
    n = len(order)
    for i in range(n - 1):
        for j in range(i + 2, n):
            a, b, c, d = order[i], order[i + 1], order[j], order[(j + 1) % n]
            if distances[a][c] + distances[b][d] < distances[a][b] + distances[c][d] - 1e-9:
                order[i + 1 : j + 1] = order[i + 1 : j + 1][::-1]
                changed = True
    return changed


def star(n: int, seed: int = 0, spread: float = 0.15) -> shapely.Polygon:
    """Return a noisy star on the 1/256 px grid, about 800 px wide."""
    return snapped(place_around(n, 1 + np.random.default_rng(seed).uniform(-spread, spread, n)))


def convex(n: int) -> shapely.Polygon:
    return shapely.Polygon(place_around(n, np.ones(n)))


def smooth(n: int) -> shapely.Polygon:
    angle = np.arange(n) * 2 * np.pi / n
    return shapely.Polygon(place_around(n, 1 + 0.2 * np.sin(5 * angle) + 0.1 * np.cos(13 * angle)))


def place_around(n: int, radius: np.ndarray) -> np.ndarray:
    """Return n points at equal angles about (512, 512); `radius` is in units of 400 px."""
    angle = np.arange(n) * 2 * np.pi / n
    return np.column_stack((radius * np.cos(angle), radius * np.sin(angle))) * 400 + 512


def snapped(points: np.ndarray) -> shapely.Polygon:
    return shapely.Polygon(np.round(np.asarray(points) * 256) / 256)


def twice_area(a, b, c) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def diagonals(polygon: shapely.Polygon) -> set[tuple[int, int]]:
    """Return vertex pairs (i < j) that are sides, or whose segment is inside and hits no vertex."""
    points = shapely.get_coordinates(polygon)[:-1]
    n = len(points)
    pairs = {(min(i, j), max(i, j)) for i, j in pairwise([*range(n), 0])}
    for i in range(n):
        for j in range(i + 2, n):
            if (i, j) in pairs:
                continue
            segment = shapely.LineString([points[i], points[j]])
            through = any(
                k not in (i, j) and segment.intersects(shapely.Point(points[k])) for k in range(n)
            )
            inside = polygon.contains(segment) and not segment.within(polygon.boundary)
            if inside and not through:
                pairs.add((i, j))
    return pairs


def all_triangulations(polygon: shapely.Polygon) -> list[list[tuple[int, int, int]]]:
    """Return every triangulation of a simple polygon, by recursion over the apexes of sides."""
    points = shapely.get_coordinates(polygon)[:-1]
    allowed = diagonals(polygon)

    @cache
    def between(i: int, j: int) -> list[list[tuple[int, int, int]]]:
        if j == i + 1:
            return [[]]
        result = []
        for k in range(i + 1, j):
            sides = ((i, k) in allowed) and ((k, j) in allowed)
            if sides and twice_area(points[i], points[k], points[j]) != 0:
                result += [
                    [(i, k, j), *left, *right] for left in between(i, k) for right in between(k, j)
                ]
        return result

    return between(0, len(points) - 1)


def mean_blocks(triangle, size: int) -> float:
    """Return the mean number of size x size blocks with a covered centre, by a union in GEOS."""
    shape = shapely.Polygon(triangle)
    moves = range(size)
    copies = [shapely.affinity.translate(shape, -dx, -dy) for dx in moves for dy in moves]
    return shapely.union_all(copies).area / size**2


Rings = list[list[list[float]]]
"""Exterior, then holes: rings of [x, y], the first not repeated at the end."""


def polygon_of(rings: Rings) -> shapely.Polygon:
    return shapely.Polygon(rings[0], rings[1:])


@st.composite
def rings(
    draw: st.DrawFn, max_vertices: int = 20, max_holes: int = 2, *, on_grid: bool | None = None
) -> Rings:
    """Draw a valid polygon with collinear vertices, repeated vertices, slivers or touching holes.

    on_grid : True for the 1/256 px grid, False for other coordinates, None for either
    """
    size = draw(st.sampled_from([5, 12, 60, 2000]))
    area = _simple(draw, draw(st.integers(3, max_vertices)), size)
    for _ in range(draw(st.integers(0, max_holes))):
        hole = _simple(draw, draw(st.integers(3, 6)), 4)
        shift = draw(st.tuples(*[st.integers(0, size)] * 2))
        remainder = area.difference(shapely.affinity.translate(hole, *shift))
        if remainder.geom_type == "Polygon" and remainder.area > 0:
            area = remainder
    if on_grid is None:
        on_grid = draw(st.booleans())
    if on_grid:
        squeeze = draw(st.sampled_from([1, 1, 1 / 16, 1 / 256]))
        rings_drawn = [np.round(ring * [1, squeeze] * 256) / 256 for ring in _open_rings(area)]
    else:
        turn = draw(st.floats(0, 2 * math.pi))
        scale = draw(st.floats(1e-3, 1e3))
        turned = shapely.affinity.rotate(area, turn, origin=(0, 0), use_radians=True)
        rings_drawn = [ring * scale for ring in _open_rings(turned)]
    for _ in range(draw(st.integers(0, 3))):
        rings_drawn = [_subdivided(draw, ring) for ring in rings_drawn]
    polygon = polygon_of([ring.tolist() for ring in rings_drawn])
    assume(polygon.is_valid and polygon.area > 0)
    return [ring.tolist() for ring in rings_drawn]


def _simple(draw: st.DrawFn, vertices: int, size: int) -> shapely.Polygon:
    vertices = min(vertices, size * size // 3)
    point = st.tuples(*[st.integers(0, size)] * 2)
    points = draw(st.lists(point, min_size=vertices, max_size=vertices, unique=True))
    polygon = uncross_points(np.array(points))
    assume(polygon.is_valid and polygon.area > 0)
    return polygon


def _open_rings(polygon: shapely.Polygon) -> list[Any]:
    return [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]


def _subdivided(draw: st.DrawFn, ring: np.ndarray) -> np.ndarray:
    """Repeat some vertices and halve some edges; a ring on the grid stays on it."""
    start = draw(st.integers(-3, len(ring) - 1))
    if start < 0:
        return ring
    following = ring[(start + 1) % len(ring)]
    extra = ring[start] if draw(st.booleans()) else (ring[start] + following) / 2
    return np.insert(ring, start + 1, extra, axis=0)


def pose(polygon: shapely.Polygon, name: Any = "half-perimeter", sign: float = 1.0) -> tuple:
    """Return the boundary of a polygon, and the cost by a criterion or function."""
    outline = boundary(polygon)
    cost = make_cost(criteria.find(name), boundary_area(outline), outline.expected_triangles, sign)
    return outline, cost


def record_calls(monkeypatch: pytest.MonkeyPatch, module: Any, name: str) -> list[tuple]:
    """Return a list that records (arguments, result) of each call of a function."""
    real, calls = getattr(module, name), []

    def call(*arguments: Any) -> Any:
        calls.append((arguments, real(*arguments)))
        return calls[-1][1]

    monkeypatch.setattr(module, name, call)
    return calls


def hard_polygons(max_vertices: int = 24) -> st.SearchStrategy[shapely.Polygon]:
    """Return a strategy of valid polygons on the 1/256 px grid, without holes."""
    return rings(max_vertices, 0, on_grid=True).map(polygon_of)


@cache
def glyphs(characters: str) -> list[tuple[str, shapely.Polygon]]:
    """Return letters of DejaVu Sans at 256 px, even-odd filled, on the 1/256 px grid."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    letters = []
    for character in characters:
        path = TextPath((0, 0), character, size=256, prop=FontProperties(family="DejaVu Sans"))
        area = shapely.Polygon()
        for ring in path.to_polygons():
            piece = shapely.Polygon(np.round(ring * 256) / 256) if len(ring) > 3 else area
            area = area.symmetric_difference(piece) if piece.is_valid else area
        parts = shapely.get_parts(shapely.set_precision(area, 1 / 256))
        letters += [(character, part) for part in parts if part.geom_type == "Polygon"]
    return letters


def with_hole(rng: np.random.Generator, exterior: int, hole: int) -> shapely.Polygon:
    while True:
        outer = random_simple(rng, exterior, 40)
        inner = shapely.get_coordinates(random_simple(rng, hole, 12))[:-1]
        shift = rng.integers(0, 30, 2)
        polygon = shapely.Polygon(outer.exterior, [inner + shift])
        if polygon.is_valid and shapely.Polygon(inner + shift).within(outer):
            return polygon


def with_holes(rng: np.random.Generator, exterior: int, holes: int) -> shapely.Polygon:
    """Return a random simple polygon on a small grid, with triangular and quadrilateral holes."""
    while True:
        polygon = random_simple(rng, exterior, 14)
        for _ in range(60):
            ring = random_simple(rng, int(rng.integers(3, 5)), 4)
            corners = shapely.get_coordinates(ring)[:-1] + rng.integers(0, 12, 2)
            cut = shapely.Polygon(polygon.exterior, [*polygon.interiors, corners])
            polygon = cut if cut.is_valid else polygon
            if len(polygon.interiors) == holes:
                return polygon


def touching_polygons(seed: int, count: int) -> Iterator[shapely.Polygon]:
    """Yield `count` polygons with one to three holes that touch a ring up to rounding.

    A vertex of each hole is a rounded point of another ring's edge: on the edge, a rounding error
    to either side, or at a vertex.
    """
    rng = np.random.default_rng(seed)
    yielded = 0
    while yielded < count:
        scale = float(rng.choice([1.0, 0.1, 1 / 3, 1e-3, 1e5 / 7]))
        shift = float(rng.choice([0.0, 0.0, 0.3, 1e3 / 3, 1e6 / 7]))
        outer = shapely.get_coordinates(random_simple(rng, int(rng.integers(4, 10)), 16))[:-1]
        polygon = shapely.Polygon(outer * scale + shift)
        for _ in range(int(rng.integers(1, 4))):
            polygon = _touched(rng, polygon, scale)
        if polygon.interiors and polygon.is_valid:
            yielded += 1
            yield polygon


def _touched(rng: np.random.Generator, polygon: shapely.Polygon, scale: float) -> shapely.Polygon:
    """Return the polygon with one more hole at one of its edges, or unchanged."""
    rings = [polygon.exterior, *polygon.interiors]
    for _ in range(30):
        ring = shapely.get_coordinates(rings[int(rng.integers(len(rings)))])
        side = int(rng.integers(len(ring) - 1))
        a, b = ring[side], ring[side + 1]
        share = float(rng.choice([0.5, 1 / 3, 0.1, 0.7, rng.random(), 0.0]))
        touch = a + (b - a) * share
        if rng.random() < 0.3:
            touch = np.nextafter(touch, touch + rng.normal(size=2))
        far_points = touch + rng.uniform(-5, 5, (int(rng.integers(2, 4)), 2)) * scale
        hole = shapely.Polygon([touch, *far_points])
        if not hole.is_valid or hole.area < 1e-3 * scale**2:
            continue
        cut = shapely.Polygon(polygon.exterior, [*polygon.interiors, hole.exterior])
        if cut.is_valid:
            return cut
    return polygon
