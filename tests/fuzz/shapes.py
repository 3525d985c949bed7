"""Random polygons that Hypothesis can make small, as rings that JSON can hold."""

import math
from typing import Any

import numpy as np
import shapely
import shapely.affinity
from hypothesis import assume
from hypothesis import strategies as st

from tests.triangulators.cases import uncrossed

Rings = list[list[list[float]]]
"""Exterior, then holes: rings of [x, y], the first not repeated at the end."""


def polygon_of(rings: Rings) -> shapely.Polygon:
    return shapely.Polygon(rings[0], rings[1:])


@st.composite
def rings(
    draw: st.DrawFn, max_vertices: int = 20, max_holes: int = 2, *, on_grid: bool | None = None
) -> Rings:
    """Draw a valid polygon: collinear runs, repeated vertices, slivers, holes that touch.

    on_grid : on the 1/256 grid, or off it, or (None) either
    """
    size = draw(st.sampled_from([5, 12, 60]))
    area = _simple(draw, draw(st.integers(3, max_vertices)), size)
    for _ in range(draw(st.integers(0, max_holes))):
        hole = _simple(draw, draw(st.integers(3, 6)), 4)
        shift = draw(st.tuples(*[st.integers(0, size)] * 2))
        rest = area.difference(shapely.affinity.translate(hole, *shift))
        if rest.geom_type == "Polygon" and rest.area > 0:
            area = rest
    if on_grid is None:
        on_grid = draw(st.booleans())
    if on_grid:
        squeeze = draw(st.sampled_from([1, 1 / 256]))
        found = [np.round(ring * [1, squeeze] * 256) / 256 for ring in _open_rings(area)]
    else:
        turn = draw(st.floats(0, 2 * math.pi))
        scale = draw(st.floats(1e-3, 1e3))
        turned = shapely.affinity.rotate(area, turn, origin=(0, 0), use_radians=True)
        found = [ring * scale for ring in _open_rings(turned)]
    found = [_subdivided(draw, ring) for ring in found]
    polygon = polygon_of([ring.tolist() for ring in found])
    assume(polygon.is_valid and polygon.area > 0)
    return [ring.tolist() for ring in found]


def _simple(draw: st.DrawFn, vertices: int, size: int) -> shapely.Polygon:
    """Draw a simple polygon on the integer grid."""
    point = st.tuples(*[st.integers(0, size)] * 2)
    points = draw(st.lists(point, min_size=3, max_size=vertices, unique=True))
    polygon = uncrossed(np.array(points))
    assume(polygon.is_valid and polygon.area > 0)
    return polygon


def _open_rings(polygon: shapely.Polygon) -> list[Any]:
    return [shapely.get_coordinates(ring)[:-1] for ring in (polygon.exterior, *polygon.interiors)]


def _subdivided(draw: st.DrawFn, ring: np.ndarray) -> np.ndarray:
    """Repeat a vertex, or halve an edge, here and there; on the grid where the ring is."""
    where = draw(st.integers(-3, len(ring) - 1))
    if where < 0:
        return ring
    following = ring[(where + 1) % len(ring)]
    extra = ring[where] if draw(st.booleans()) else (ring[where] + following) / 2
    return np.insert(ring, where + 1, extra, axis=0)
