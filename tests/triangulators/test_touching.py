"""Holes that touch a ring off the grid: triangulated exactly, or refused in one line."""

import pytest
import shapely

from tests.triangulators.touching import touching_polygons
from triangulators import TriangulationError, triangulate
from triangulators.verify import verify

NAMES = ("optimal:half-perimeter", "greedy", "worst:half-perimeter", "optimal:overdraw")


@pytest.mark.parametrize("number", range(len(NAMES)))
def test_300_hostile_polygons_are_triangulated(number):
    done, refused = 0, []
    for polygon in touching_polygons(seed=number, count=75):
        try:
            triangles = triangulate(polygon, NAMES[number])
        except TriangulationError as error:
            refused.append(str(error))
            continue
        assert verify(polygon, triangles).conforming, polygon.wkt
        done += 1
    assert not any("\n" in message for message in refused)
    assert done >= 73, refused  # what is refused is GEOS's and earcut's failure to begin with


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
