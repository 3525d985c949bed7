"""Properties of single triangulators; test_everywhere verifies all of them."""

import sys
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
import shapely

from tests.triangulators.cases import PAPER, convex, random_simple, twice_area
from triangulators import SkippedError, UnavailableError, find, triangulate, vertices
from triangulators.verify import verify


def test_random_is_uniform_and_seeded():
    draws = 29 * 60
    seen = Counter(
        tuple(sorted(map(tuple, triangulate(PAPER, "random", seed=seed).tolist())))
        for seed in range(draws)
    )
    assert len(seen) == 29
    statistic = sum((count - 60) ** 2 / 60 for count in seen.values())
    assert statistic < 56.9  # chi-squared with 28 degrees of freedom exceeds it 1 time in 1000
    first, second = (triangulate(convex(30), "random", seed=4) for _ in range(2))
    assert np.array_equal(first, second)


def test_random_does_not_overflow():
    assert verify(convex(800), triangulate(convex(800), "random", seed=1)).conforming


def test_strip_zigzags():
    triangles = triangulate(convex(7), "strip")
    shared = [len(set(a) & set(b)) for a, b in pairwise(triangles)]
    assert set(shared) == {2}
    assert max(Counter(triangles.ravel().tolist()).values()) == 3


def test_fan_and_strip_skip_unsupported_polygons():
    comb = shapely.Polygon([(0, 0), (6, 0), (6, 4), (5, 1), (4, 4), (3, 1), (2, 4), (1, 1), (0, 4)])
    for name in ("fan", "strip"):
        with pytest.raises(SkippedError, match=name):
            triangulate(comb, name)


def test_greedy_has_the_shortest_diagonal_and_max_area_the_largest_triangle():
    def extremes(triangles):
        corners = points[triangles]
        pairs = np.sort(np.concatenate([triangles[:, [k, k - 1]] for k in range(3)]), axis=1)
        inside = pairs[~np.isin(pairs[:, 1] - pairs[:, 0], (1, 9))]
        shortest = np.hypot(*(points[inside[:, 0]] - points[inside[:, 1]]).T).min()
        return shortest, max(abs(twice_area(*corner)) for corner in corners)

    rng = np.random.default_rng(3)
    for _ in range(40):
        polygon = random_simple(rng, 10)
        points = vertices(polygon)
        greedy_shortest, _ = extremes(triangulate(polygon, "greedy"))
        _, max_area_largest = extremes(triangulate(polygon, "max-area"))
        for seed in range(20):
            shortest, largest = extremes(triangulate(polygon, "random", seed=seed))
            assert shortest >= greedy_shortest - 1e-12
            assert largest <= max_area_largest + 1e-9


def test_missing_package_reports_install_command(monkeypatch):
    monkeypatch.setitem(sys.modules, "manifold3d", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert find("manifold").find_install_command() == "pip install manifold3d"
    with pytest.raises(UnavailableError, match="pip install manifold3d"):
        triangulate(convex(5), "manifold")
