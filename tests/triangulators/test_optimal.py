"""The optimum against brute force."""

import numpy as np
import pytest
import shapely

from tests.triangulators.cases import all_triangulations, brute_cost, random_simple, star
from triangulators import Skipped, names, triangulate, vertices
from triangulators.criteria import predict
from triangulators.registry import find
from triangulators.verify import verify


def brute_costs(polygon, name):
    points = vertices(polygon)
    costs = {}

    def cost(triangle):
        if triangle not in costs:
            costs[triangle] = brute_cost(name, *points[list(triangle)])
        return costs[triangle]

    return [sum(cost(t) for t in triangles) for triangles in all_triangulations(polygon)]


def test_equals_brute_force_on_500_random_polygons():
    rng = np.random.default_rng(20240)
    for case in range(500):
        polygon = random_simple(rng, int(rng.integers(5, 11)))
        points = vertices(polygon)
        for name in ("overdraw", "half-perimeter"):
            costs = brute_costs(polygon, name)
            key = name.replace("-", "_")
            best = predict(points, triangulate(polygon, "optimal", criterion=name))[key]
            worst = predict(points, triangulate(polygon, "worst", criterion=name))[key]
            assert best == pytest.approx(min(costs), rel=1e-12), (case, name, polygon.wkt)
            assert worst == pytest.approx(max(costs), rel=1e-12), (case, name, polygon.wkt)


def test_no_peer_beats_the_optimum():
    for seed in range(20):
        polygon = star(12 + 4 * seed, seed, spread=0.4)
        points = vertices(polygon)
        for name in ("overdraw", "half-perimeter", "edge-length"):
            key = name.replace("-", "_")
            best = triangulate(polygon, f"optimal:{name}")
            assert verify(polygon, best).conforming
            limit = predict(points, best)[key] * (1 - 1e-12)
            for peer in names(available_only=True):
                if find(peer).criteria:
                    continue
                try:
                    cost = predict(points, triangulate(polygon, peer))[key]
                except Skipped:
                    continue
                assert cost >= limit, (seed, name, peer)


def test_a_hole_is_cut_open():
    polygon = shapely.Polygon([(0, 0), (8, 0), (8, 8), (0, 8)], [[(2, 2), (2, 6), (6, 6), (6, 2)]])
    assert verify(polygon, triangulate(polygon, "optimal")).conforming
