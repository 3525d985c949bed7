"""Hostile polygons: holes that touch another ring at a point off the grid, valid by GEOS."""

from collections.abc import Iterator

import numpy as np
import shapely

from tests.triangulators.cases import random_simple


def touching_polygons(seed: int, count: int) -> Iterator[shapely.Polygon]:
    """Yield `count` polygons with one to three holes, each touching a ring where rounding puts it.

    A corner of a hole is a point of another ring's edge, as float64 has it: on it, beside it on
    either side by less than the last digit, or at a vertex of it.
    """
    rng = np.random.default_rng(seed)
    made = 0
    while made < count:
        scale = float(rng.choice([1.0, 0.1, 1 / 3, 1e-3, 1e5 / 7]))
        shift = float(rng.choice([0.0, 0.0, 0.3, 1e3 / 3, 1e6 / 7]))
        outer = shapely.get_coordinates(random_simple(rng, int(rng.integers(4, 10)), 16))[:-1]
        polygon = shapely.Polygon(outer * scale + shift)
        for _ in range(int(rng.integers(1, 4))):
            polygon = _touched(rng, polygon, scale)
        if polygon.interiors and polygon.is_valid:
            made += 1
            yield polygon


def _touched(rng: np.random.Generator, polygon: shapely.Polygon, scale: float) -> shapely.Polygon:
    """Return the polygon with one more hole at one of its edges, or as it was."""
    rings = [polygon.exterior, *polygon.interiors]
    for _ in range(30):
        ring = shapely.get_coordinates(rings[int(rng.integers(len(rings)))])
        side = int(rng.integers(len(ring) - 1))
        a, b = ring[side], ring[side + 1]
        share = float(rng.choice([0.5, 1 / 3, 0.1, 0.7, rng.random(), 0.0]))
        touch = a + (b - a) * share
        if rng.random() < 0.3:
            touch = np.nextafter(touch, touch + rng.normal(size=2))
        others = touch + rng.uniform(-5, 5, (int(rng.integers(2, 4)), 2)) * scale
        hole = shapely.Polygon([touch, *others])
        if not hole.is_valid or hole.area < 1e-3 * scale**2:
            continue
        cut = shapely.Polygon(polygon.exterior, [*polygon.interiors, hole.exterior])
        if cut.is_valid:
            return cut
    return polygon
