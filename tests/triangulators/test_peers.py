"""What is particular to some peers; all of them are verified in test_everywhere."""

import sys
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
import shapely

from tests.triangulators.cases import convex, paper_polygon, random_simple
from triangulators import Skipped, Unavailable, find, triangulate, vertices
from triangulators.verify import verify


def test_random_is_uniform_and_seeded():
    draws = 29 * 60
    seen = Counter(
        tuple(sorted(map(tuple, triangulate(paper_polygon(), "random", seed=seed).tolist())))
        for seed in range(draws)
    )
    assert len(seen) == 29
    statistic = sum((count - 60) ** 2 / 60 for count in seen.values())
    assert statistic < 56.9  # chi-squared with 28 degrees of freedom exceeds it 1 time in 1000
    once, again = (triangulate(convex(30), "random", seed=4) for _ in range(2))
    assert np.array_equal(once, again)


def test_random_does_not_overflow_where_counts_do():
    assert verify(convex(800), triangulate(convex(800), "random", seed=1)).conforming


def test_strip_zigzags():
    triangles = triangulate(convex(7), "strip")
    shared = [len(set(a) & set(b)) for a, b in pairwise(triangles)]
    assert set(shared) == {2}
    assert max(Counter(triangles.ravel().tolist()).values()) == 3


def test_fan_and_strip_skip_what_they_cannot_do():
    comb = shapely.Polygon([(0, 0), (6, 0), (6, 4), (5, 1), (4, 4), (3, 1), (2, 4), (1, 1), (0, 4)])
    for name in ("fan", "strip"):
        with pytest.raises(Skipped, match=name):
            triangulate(comb, name)


def test_greedy_takes_the_shortest_diagonal():
    rng = np.random.default_rng(3)
    for _ in range(40):
        polygon = random_simple(rng, 10)
        points, triangles = vertices(polygon), triangulate(polygon, "greedy")
        edges = {
            frozenset(pair) for a, b, c in triangles.tolist() for pair in ((a, b), (b, c), (c, a))
        }
        sides = {frozenset((k, (k + 1) % 10)) for k in range(10)}
        shortest = min(np.hypot(*(points[a] - points[b])) for a, b in map(tuple, edges - sides))
        others = [triangulate(polygon, "random", seed=seed) for seed in range(20)]
        for other in others:
            pairs = {
                frozenset(p) for a, b, c in other.tolist() for p in ((a, b), (b, c), (c, a))
            } - sides
            lengths = [np.hypot(*(points[a] - points[b])) for a, b in map(tuple, pairs)]
            assert min(lengths) >= shortest - 1e-12


def test_max_area_takes_the_largest_triangle():
    rng = np.random.default_rng(3)
    for _ in range(40):
        polygon = random_simple(rng, 10)
        points = vertices(polygon)

        def largest(triangles, points=points):
            a, b, c = np.moveaxis(points[triangles], 1, 0)
            u, v = b - a, c - a
            return np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).max()

        most = largest(triangulate(polygon, "max-area"))
        for seed in range(20):
            assert largest(triangulate(polygon, "random", seed=seed)) <= most + 1e-9


def test_a_missing_package_is_unavailable_with_the_install_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "manifold3d", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert find("manifold").available() == "pip install manifold3d"
    with pytest.raises(Unavailable, match="pip install manifold3d"):
        triangulate(convex(5), "manifold")
