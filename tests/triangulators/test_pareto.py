"""The Pareto front against exhaustive lists, and for polygons too large for a list."""

import numpy as np
import pytest

from tests.triangulators.cases import random_simple, star, with_hole
from triangulators import SkippedError, criteria, triangulate, vertices
from triangulators.criteria import predict
from triangulators.methods.exhaustive import enumerate_triangulations
from triangulators.methods.pareto import pareto_front
from triangulators.verify import verify

PAIR = ("overdraw", "shape")


def test_front_ends_are_the_optima():
    polygon = star(50, spread=0.4)
    front = pareto_front(polygon, "half-perimeter", "shape")
    assert len(front.costs) > 10
    assert (np.diff(front.costs[:, 0]) > 0).all()
    assert (np.diff(front.costs[:, 1]) < 0).all()
    for column, end, name in ((0, 0, "half-perimeter"), (1, -1, "shape")):
        best = triangulate(polygon, "optimal", criterion=name)
        total = criteria.find(name).total(vertices(polygon), best)
        assert front.costs[end, column] == pytest.approx(total, rel=1e-9)


def brute_front(polygon):
    """Return the front (f, 2), ascending in A, by comparing all pairs of triangulations."""
    points = vertices(polygon)
    listed = [predict(points, triangles) for triangles in enumerate_triangulations(polygon)]
    costs = np.array([[sums[name] for name in PAIR] for sums in listed])
    slack = 1e-9 * np.abs(costs).max(axis=0)
    as_good = (costs[None] <= costs[:, None] + slack).all(axis=2)
    better = (costs[None] < costs[:, None] - slack).any(axis=2)
    front = costs[~(as_good & better).any(axis=1)]
    front = front[np.lexsort((front[:, 1], front[:, 0]))]
    fresh = np.r_[True, (np.abs(np.diff(front, axis=0)) > slack).any(axis=1)]
    return front[fresh]


def test_front_points_are_triangulators_by_index():
    rng = np.random.default_rng(4)
    for _ in range(40):
        polygon = random_simple(rng, int(rng.integers(4, 11)))
        expected = brute_front(polygon)
        assert pareto_front(polygon).costs == pytest.approx(expected, rel=1e-7)
        for k, costs in enumerate(expected):
            triangles = triangulate(polygon, "pareto", k=k)
            assert verify(polygon, triangles).conforming
            sums = predict(vertices(polygon), triangles)
            assert [sums[name] for name in PAIR] == pytest.approx(costs, rel=1e-7)
        message = f"out of range; give k from 0 to {len(expected) - 1}"
        with pytest.raises(SkippedError, match=message):
            triangulate(polygon, "pareto", k=len(expected))


def test_unsupported_polygons_are_skipped():
    with pytest.raises(SkippedError, match="101 vertices, more than 100"):
        triangulate(star(101), "pareto")
    with pytest.raises(SkippedError, match="holes"):
        triangulate(with_hole(np.random.default_rng(0), 8, 4), "pareto", k=1)
