import numpy as np

from scenes import load
from tests.ports.polygons import earcut_rings, random_polygons
from tests.triangulators.cases import smooth, star
from triangulators.geometry.ear_clipping import MAX_VERTICES, clip_ears_of_ring, run_earcut


def test_triangles_equal_those_of_earcut():
    """Also for clockwise rings, and above 80 vertices, where earcut uses a spatial index."""
    rings = [(points, ends) for points, ends in random_polygons(8, 3000) if len(ends) == 1]
    rings += [earcut_rings(polygon) for polygon in load("city").polygons if not polygon.interiors]
    rings += [earcut_rings(shape) for shape in (smooth(300), star(400, spread=0.4), star(250))]
    equal = large = 0
    for number, (points, ends) in enumerate(rings):
        if number % 2:
            points = np.ascontiguousarray(points[::-1])
        triangles = clip_ears_of_ring(points)
        if len(triangles):
            assert np.array_equal(triangles.ravel(), run_earcut(points, ends))
            equal += 1
            large += len(points) > MAX_VERTICES
    assert equal > 0.6 * len(rings) > 1000
    assert large == 3


def test_rings_with_few_ears_equal_earcut():
    """A vertex on a straight edge blocks an ear; the last vertex of a full turn is an ear."""
    straight = [(3.0, 2.0), (2.0, 2.0), (1.0, 2.0), (3.0, 0.0)]
    crossing = [(2, 1), (2, 2), (2, 0), (3, 2), (0, 3), (1, 0), (3, 0), (3, 3)]
    for ring in (straight, crossing):
        points = np.array(ring, dtype=np.float64)
        triangles = clip_ears_of_ring(points)
        assert len(triangles) == len(ring) - 2
        ends = np.array([len(ring)], dtype=np.uint32)
        assert np.array_equal(triangles.ravel(), run_earcut(points, ends))


def test_rings_that_earcut_repairs_are_left_to_earcut():
    collinear = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (4.0, 4.0)])
    closed = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 0.0)])
    crossing = np.array([(0.0, 0.0), (4.0, 4.0), (4.0, 0.0), (0.0, 4.0)])
    for points in (collinear[:2], closed, crossing, np.zeros((5, 2)), np.full((4, 2), np.nan)):
        assert clip_ears_of_ring(points).shape == (0, 3)
