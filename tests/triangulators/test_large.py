"""Large polygons go by windows."""

import numpy as np
import pytest
import shapely

from tests.triangulators.cases import convex, smooth, star
from triangulators import triangulate, vertices
from triangulators.criteria import predict
from triangulators.verify import verify


@pytest.mark.parametrize("polygon", [smooth(1500), star(1200)], ids=["smooth", "star"])
def test_windows_are_between_the_peers_and_the_optimum(polygon):
    points = vertices(polygon)
    windowed = triangulate(polygon, "optimal:half-perimeter", limit=500)
    assert verify(polygon, windowed).conforming
    cost = predict(points, windowed)["half_perimeter"]
    exact = triangulate(polygon, "optimal:half-perimeter", limit=5000)
    assert cost >= predict(points, exact)["half_perimeter"] * (1 - 1e-12)
    assert cost <= predict(points, exact)["half_perimeter"] * 1.05
    for peer in ("ear-clipping", "delaunay"):
        assert cost <= predict(points, triangulate(polygon, peer))["half_perimeter"]


def test_windows_with_holes():
    shell = shapely.get_coordinates(smooth(900))
    holes = [
        shapely.get_coordinates(convex(40))[:-1] * 0.03 + [512 + 180 * x, 512 + 180 * y]
        for x, y in ((-1, 0), (0, 0), (1, 0), (0, 1), (0, -1))
    ]
    polygon = shapely.Polygon(shell, holes)
    assert polygon.is_valid
    triangles = triangulate(polygon, "optimal:overdraw", limit=300)
    assert verify(polygon, triangles).conforming
    cost = predict(vertices(polygon), triangles)["overdraw"]
    for peer in ("ear-clipping", "delaunay"):
        assert cost <= predict(vertices(polygon), triangulate(polygon, peer))["overdraw"]


def test_the_same_seed_gives_the_same_result():
    polygon = smooth(800)
    once, again = (triangulate(polygon, "optimal", limit=200, seed=3) for _ in range(2))
    assert np.array_equal(once, again)
