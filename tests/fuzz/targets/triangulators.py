"""Every triangulator on any polygon: a valid triangulation, and none better than the optimum."""

from __future__ import annotations

import numpy as np

from tests.fuzz.shapes import Rings, polygon_of, rings
from tests.fuzz.target import target
from tests.triangulators.cases import all_triangulations
from tests.triangulators.test_everywhere import check
from triangulators import criteria, triangulate, vertices

STEERING = ("overdraw", "half-perimeter", "edge-length", "shape")


@target("triangulators", rings())
def check_triangulators(value: Rings) -> None:
    """What tests/triangulators checks of every triangulator, off the grid too."""
    assert check(polygon_of(value), value) > 0


@target("optimum", rings(max_vertices=8, max_holes=0, on_grid=True))
def check_optimum(value: Rings) -> None:
    """On the grid, where the listing by another program (GEOS decides for it) is exact."""
    polygon = polygon_of(value)
    points = vertices(polygon)
    if len(np.unique(points, axis=0)) < len(points):
        return  # the listing knows a vertex by its place
    everything = [np.array(each) for each in all_triangulations(polygon)]
    for criterion in STEERING:
        cost = criteria.find(criterion)
        costs = [cost.total(points, triangles) for triangles in everything]
        for name, expected in (("optimal", min(costs)), ("worst", max(costs))):
            total = cost.total(points, triangulate(polygon, f"{name}:{criterion}"))
            assert abs(total - expected) <= 1e-9 * max(costs), (name, criterion, total, expected)
