"""The verifier finds what is wrong, and nothing where nothing is."""

import numpy as np
import pytest
import shapely

from scenes import load
from triangulators import triangulate
from triangulators.polygon import boundary
from triangulators.polygon_arrays import PolygonArray
from triangulators.repair import insert_dropped_vertices
from triangulators.verify import find_unconfirmed, rows_of, verify

SQUARE = shapely.box(0, 0, 4, 4)  # (4, 0) (4, 4) (0, 4) (0, 0)


def test_accepts_a_triangulation():
    found = verify(SQUARE, np.array([[0, 1, 2], [0, 2, 3]]))
    assert found.ok
    assert found.conforming
    assert found.area_error == 0.0
    assert found.triangles == found.expected_triangles == 2


def test_rejects_what_is_not_a_triangulation():
    cases = {
        "clockwise": [[0, 2, 1], [0, 2, 3]],
        "gap or overlap": [[0, 1, 2]],
        "overlap": [[0, 1, 2], [0, 1, 2]],
        "no area": [[0, 1, 2], [0, 2, 3], [1, 1, 2]],
        "outside 0..3": [[0, 1, 4]],
        "expected (m, 3)": [[0, 1], [2, 3]],
    }
    for message, triangles in cases.items():
        found = verify(SQUARE, np.array(triangles))
        assert not found.ok
        assert message != "overlap" or found.area_error == 0.0
        assert not found.conforming
        assert any(message in problem for problem in found.problems), (message, found.problems)


@pytest.mark.parametrize("index", [-1, 3, 2**32, 2**63 - 1])
def test_no_index_beyond_the_points_is_taken_for_another(index):
    points = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    with pytest.raises(ValueError, match=r"indices outside 0\.\.2"):
        rows_of(np.array([(index, 1, 2)]), points)


def test_reports_t_junctions_and_repair_removes_them():
    polygon = shapely.Polygon([(0, 0), (2, 0), (4, 0), (4, 2), (4, 4), (2, 4), (0, 4), (0, 2)])
    dropped = np.array([[0, 2, 4], [0, 4, 6]])  # all four midpoints left out
    found = verify(polygon, dropped)
    assert found.ok
    assert not found.conforming
    assert sorted(vertex for vertex, _ in found.t_junctions) == [1, 3, 5, 7]
    repaired = insert_dropped_vertices(boundary(polygon), dropped)
    assert verify(polygon, repaired).conforming
    assert len(repaired) == 6


def test_rings_that_touch_and_repeated_vertices_are_counted_by_euler():
    outer = [(0, 0), (8, 0), (8, 8), (0, 8)]
    at_a_side = shapely.Polygon(outer, [[(0, 2), (4, 6), (6, 4), (6, 2)]])
    at_a_corner = shapely.Polygon(outer, [[(0, 0), (4, 6), (6, 4), (6, 2)]])
    repeated = shapely.Polygon([(0, 0), (0, 0), (4, 0), (4, 4), (4, 4), (0, 4)])
    assert [boundary(p).expected_triangles for p in (at_a_side, at_a_corner, repeated)] == [7, 6, 2]
    for polygon in (at_a_side, at_a_corner, repeated):
        triangles = shapely.constrained_delaunay_triangles(polygon)
        assert len(triangles.geoms) == boundary(polygon).expected_triangles


def damaged(triangles: np.ndarray) -> list[np.ndarray]:
    """The triangles, and what they become in five ways of being wrong."""
    turned, beyond, twice = triangles.copy(), triangles.copy(), triangles.copy()
    turned[-1] = turned[-1, ::-1]
    beyond[0, 1] = triangles.max() + 1
    twice[0] = twice[-1]
    below = triangles.copy()
    below[0, 0] = -1
    return [triangles, triangles[:-1], turned, beyond, twice, below]


def test_many_at_once_are_judged_as_one_by_one():
    polygons = [*load("city:buildings=20").polygons, *load("cad:parts=3").polygons]
    cases = [
        (polygon, part)
        for polygon in polygons
        for part in damaged(triangulate(polygon, "ear-clipping"))
    ]
    arrays = PolygonArray.from_shapely([polygon for polygon, _ in cases])
    unconfirmed = find_unconfirmed(arrays, {k: part for k, (_, part) in enumerate(cases)})
    wrong = [k for k, case in enumerate(cases) if not verify(*case).conforming]
    assert unconfirmed == wrong
    assert len(wrong) == 5 * len(polygons)
    assert find_unconfirmed(arrays, {}) == []
    assert find_unconfirmed(arrays, {0: cases[0][1], 1: cases[1][1]}) == [1]
