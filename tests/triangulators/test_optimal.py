"""The optimum against brute force, exhaustive lists, certificates and other triangulators."""

import numba
import numpy as np
import pytest
import shapely

from tests.triangulators.cases import (
    convex,
    random_simple,
    smooth,
    star,
)
from triangulators import certify, criteria, triangulate, triangulate_with_gap, vertices
from triangulators.checking.evidence import has_exact_sums
from triangulators.criteria import CRITERIA
from triangulators.criteria.cost import make_cost
from triangulators.methods.exhaustive import enumerate_triangulations
from triangulators.polygon import boundary
from triangulators.verify import verify


@numba.njit
def squared_height(ax, ay, bx, by, cx, cy):
    return (max(ay, by, cy) - min(ay, by, cy)) ** 2


def test_optimum_equals_exhaustive_for_all_criteria():
    rng = np.random.default_rng(300)
    tested = [*CRITERIA.values(), criteria.find(squared_height)]
    tested.append(criteria.find("mixed", alpha=1.0, beta=0.2, gamma=3.0))
    tested.append(criteria.find("calibrated", coefficients={"half_perimeter": 1, "bbox_area": 0.5}))
    for case in range(300):
        polygon = random_simple(rng, int(rng.integers(4, 11)))
        points = vertices(polygon)
        everything = enumerate_triangulations(polygon)
        for criterion in tested:
            totals = [criterion.total(points, triangles) for triangles in everything]
            label = case, criterion.name, polygon.wkt
            for end, expected in (("optimal", min(totals)), ("worst", max(totals))):
                extreme = triangulate(polygon, end, criterion=criterion)
                assert verify(polygon, extreme).conforming
                total = criterion.total(points, extreme)
                assert total == pytest.approx(expected, rel=1e-9), label


@pytest.mark.parametrize("criterion", ["edge-length", "shape", "beauty"])
def test_optimum_of_many_vertices_is_proven(criterion):
    for polygon in (convex(60), smooth(150), star(300)):
        best = triangulate(polygon, "optimal", criterion=criterion)
        assert certify(polygon, best, criterion).proven


def test_gap_is_zero_if_sums_are_exact():
    polygons = [star(n, seed=n) for n in (12, 40, 150)]
    for polygon in polygons:
        for name in ("overdraw", "half-perimeter"):
            assert triangulate_with_gap(polygon, "optimal", criterion=name)[1] == 0.0
        # Whole coordinates up to 2^40: half-perimeters add up in doubles, areas do not.
        large = shapely.transform(polygon, lambda xy: xy * 256 * (2**22 + 1))
        assert 0.0 < triangulate_with_gap(large, "optimal", criterion="overdraw")[1] < 1e-11
        assert triangulate_with_gap(large, "optimal", criterion="half-perimeter")[1] == 0.0
        larger = shapely.transform(polygon, lambda xy: xy * 256 * (2**34 + 1))
        assert 0.0 < triangulate_with_gap(larger, "optimal:half-perimeter")[1] < 1e-11


def test_gap_is_zero_if_optimal_sum_is_exact():
    # A box may have 2^48 units, and eight triangles 2^53 with their areas: these have far less.
    x = np.linspace(0.0, 2.0**24, 5)
    top = np.column_stack((x, [3.0, 2.0, 3.0, 2.0, 3.0]))
    polygon = shapely.Polygon([*np.column_stack((x, np.zeros(5))), *top[::-1]])
    cost = make_cost(criteria.find("overdraw"), polygon.area, 8)
    assert not has_exact_sums(boundary(polygon), cost)
    assert triangulate_with_gap(polygon, "optimal:overdraw")[1] == 0.0


@pytest.mark.parametrize("polygon", [smooth(1500), star(1200)], ids=["smooth", "star"])
def test_windows_are_between_peers_and_optimum(polygon):
    points = vertices(polygon)
    windowed = triangulate(polygon, "optimal:half-perimeter", limit=500)
    assert verify(polygon, windowed).conforming
    total = criteria.find("half-perimeter").total
    cost = total(points, windowed)
    exact = total(points, triangulate(polygon, "optimal:half-perimeter", limit=5000))
    assert exact * (1 - 1e-12) <= cost <= exact * 1.05
    for peer in ("ear-clipping", "delaunay"):
        assert cost <= total(points, triangulate(polygon, peer))


def test_windows_with_holes():
    centres = shapely.MultiPoint([(332, 512), (512, 512), (692, 512), (512, 692), (512, 332)])
    polygon = smooth(900).difference(centres.buffer(12, quad_segs=10))
    triangles = triangulate(polygon, "optimal:overdraw", limit=300)
    assert verify(polygon, triangles).conforming
    total = criteria.find("overdraw").total
    for peer in ("ear-clipping", "delaunay"):
        peer_cost = total(vertices(polygon), triangulate(polygon, peer))
        assert total(vertices(polygon), triangles) <= peer_cost


def test_same_seed_gives_same_result():
    polygon = smooth(800)
    first, second = (triangulate(polygon, "optimal", limit=200, seed=3) for _ in range(2))
    assert np.array_equal(first, second)
