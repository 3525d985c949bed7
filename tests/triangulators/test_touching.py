"""Holes that touch a ring off the grid: triangulated exactly."""

import pytest
import shapely

from tests.triangulators.touching import touching_polygons
from triangulators import triangulate
from triangulators.verify import verify

NAMES = ("optimal:half-perimeter", "greedy", "worst:half-perimeter", "optimal:overdraw")


@pytest.mark.parametrize("number", range(len(NAMES)))
def test_300_hostile_polygons_are_triangulated(number):
    for polygon in touching_polygons(seed=number, count=75):
        assert verify(polygon, triangulate(polygon, NAMES[number])).conforming, polygon.wkt


def test_two_holes_that_touch_an_edge_at_one_point():
    square = [(0, 0), (8, 0), (8, 8), (0, 8)]
    holes = [[(4, 0), (2, 2), (3, 3)], [(4, 0), (5, 3), (6, 2)]]
    polygon = shapely.Polygon(square, holes)
    assert polygon.is_valid
    for name in NAMES:
        assert verify(polygon, triangulate(polygon, name)).conforming
    twice = shapely.Polygon([(0, 0), (9, 0), (9, 9)], [[(3, 0), (4, 1), (5, 1)]])
    moved = shapely.affinity.translate(shapely.affinity.scale(twice, 1 / 3, 1 / 3), 0.1, 0.7)
    for name in NAMES:
        assert verify(moved, triangulate(moved, name)).conforming
