"""The Pareto front against the full list, and where no list is possible."""

import numpy as np
import pytest

from tests.triangulators.cases import random_simple, star
from triangulators import criteria, triangulate, vertices
from triangulators.exhaustive import tabulate
from triangulators.pareto import pareto_front
from triangulators.verify import verify


def test_equals_the_front_of_all_triangulations():
    rng = np.random.default_rng(9)
    for _ in range(40):
        polygon = random_simple(rng, int(rng.integers(4, 11)))
        table = tabulate(polygon)
        costs = np.column_stack((table["overdraw"], table["shape"]))
        expected = {
            tuple(np.round(row, 6))
            for row in costs
            if not np.any(np.all(costs <= row + 1e-9, axis=1) & np.any(costs < row - 1e-9, axis=1))
        }
        front = pareto_front(polygon)
        assert {tuple(np.round(row, 6)) for row in front.costs} == expected
        for row, triangles in zip(front.costs, front.triangles, strict=True):
            assert verify(polygon, triangles).conforming
            for name, value in zip(("overdraw", "shape"), row, strict=True):
                total = criteria.find(name).total(vertices(polygon), triangles)
                assert total == pytest.approx(value, rel=1e-9)


def test_its_ends_are_the_two_optima():
    polygon = star(50, spread=0.4)
    front = pareto_front(polygon, "half-perimeter", "shape")
    assert len(front.costs) > 10
    assert (np.diff(front.costs[:, 0]) > 0).all()
    assert (np.diff(front.costs[:, 1]) < 0).all()
    for column, end, name in ((0, 0, "half-perimeter"), (1, -1, "shape")):
        best = triangulate(polygon, "optimal", criterion=name)
        total = criteria.find(name).total(vertices(polygon), best)
        assert front.costs[end, column] == pytest.approx(total, rel=1e-9)
