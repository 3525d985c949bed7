import numpy as np
import pytest
import shapely

from scenes import load
from triangulators import triangulate
from triangulators.polygon import boundary
from triangulators.polygon_arrays import PolygonArray
from triangulators.verify import (
    check_triangle_indices,
    find_unconfirmed,
    insert_dropped_vertices,
    verify,
)

SQUARE = shapely.box(0, 0, 4, 4)  # (4, 0) (4, 4) (0, 4) (0, 0)


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
        verification = verify(SQUARE, np.array(triangles))
        assert not verification.ok
        assert message != "overlap" or verification.area_error == 0.0
        assert not verification.conforming
        assert any(message in problem for problem in verification.problems), message


@pytest.mark.parametrize("index", [-1, 3, 2**32, 2**63 - 1])
def test_out_of_range_index_is_rejected(index):
    points = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    with pytest.raises(ValueError, match=r"indices outside 0\.\.2"):
        check_triangle_indices(np.array([(index, 1, 2)]), points)


def test_reports_t_junctions_and_repair_removes_them():
    polygon = shapely.Polygon([(0, 0), (2, 0), (4, 0), (4, 2), (4, 4), (2, 4), (0, 4), (0, 2)])
    dropped = np.array([[0, 2, 4], [0, 4, 6]])  # all four midpoints left out
    verification = verify(polygon, dropped)
    assert verification.ok
    assert not verification.conforming
    assert sorted(vertex for vertex, _ in verification.t_junctions) == [1, 3, 5, 7]
    repaired = insert_dropped_vertices(boundary(polygon), dropped)
    assert verify(polygon, repaired).conforming
    assert len(repaired) == 6


def damage(triangles: np.ndarray) -> list[np.ndarray]:
    turned, beyond, twice = triangles.copy(), triangles.copy(), triangles.copy()
    turned[-1] = turned[-1, ::-1]
    beyond[0, 1] = triangles.max() + 1
    twice[0] = twice[-1]
    below = triangles.copy()
    below[0, 0] = -1
    return [triangles, triangles[:-1], turned, beyond, twice, below]


def test_find_unconfirmed_agrees_with_verify():
    polygons = [*load("city:buildings=20").polygons, *load("cad:parts=3").polygons]
    parts = [damage(triangulate(polygon, "ear-clipping")) for polygon in polygons]
    cases = [(p, part) for p, several in zip(polygons, parts, strict=True) for part in several]
    arrays = PolygonArray.from_shapely([polygon for polygon, _ in cases])
    unconfirmed = find_unconfirmed(arrays, {k: part for k, (_, part) in enumerate(cases)})
    wrong = [k for k, case in enumerate(cases) if not verify(*case).conforming]
    assert unconfirmed == wrong
    assert len(wrong) == 5 * len(polygons)
    assert find_unconfirmed(arrays, {}) == []
    assert find_unconfirmed(arrays, {0: cases[0][1], 1: cases[1][1]}) == [1]
