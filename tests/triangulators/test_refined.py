"""Flips: valid, never worse than where they began, and close to the optimum."""

import numba
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from harness.frame import View, make_frame
from scenes import load
from tests.triangulators.cases import hard_polygons, random_simple, star, with_hole
from triangulators import criteria, triangulate, triangulate_many, vertices
from triangulators.criteria import predict
from triangulators.verify import verify

SUMS = [name for name in criteria.CRITERIA if name != "complexity"]


@numba.njit
def squared_height(ax, ay, bx, by, cx, cy):
    return (max(ay, by, cy) - min(ay, by, cy)) ** 2


def flips_that_gain(polygon, triangles, criterion):
    """Count, over pairs of triangles, the flips that would lessen a criterion."""
    points, gaining = vertices(polygon), 0
    across = {}
    for row, corners in enumerate(triangles.tolist()):
        for k in range(3):
            across[corners[k], corners[k - 2]] = (row, corners[k - 1])
    for (a, b), (row, c) in across.items():
        if (b, a) not in across or a > b:
            continue
        other, d = across[b, a]
        new = np.array([(a, d, c), (d, b, c)])
        u, v = points[new[:, 1]] - points[new[:, 0]], points[new[:, 2]] - points[new[:, 0]]
        if (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > 1e-9).all():
            old = criterion.total(points, triangles[[row, other]])
            gaining += criterion.total(points, new) < old - 1e-9 * (1.0 + abs(old))
    return gaining


@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(hard_polygons())
def test_it_is_a_triangulation_and_never_worse_than_its_start(polygon):
    points = vertices(polygon)
    ears = triangulate(polygon, "ear-clipping", repair=True)
    for name in ("half-perimeter", "edge-length", "overdraw"):
        criterion = criteria.find(name)
        found = triangulate(polygon, f"refined:{name}")
        assert verify(polygon, found).conforming, polygon.wkt
        cost, start = criterion.total(points, found), criterion.total(points, ears)
        best = criterion.total(points, triangulate(polygon, f"optimal:{name}"))
        assert best * (1 - 1e-9) - 1e-9 <= cost <= start * (1 + 1e-9) + 1e-9, polygon.wkt


@pytest.mark.parametrize("criterion", [*SUMS, "mixed=1/0.5/0", squared_height])
def test_no_flip_gains_any_more(criterion):
    rng = np.random.default_rng(3)
    wanted = criteria.find(criterion)
    for polygon in [random_simple(rng, 15) for _ in range(10)] + [with_hole(rng, 12, 5), star(80)]:
        triangles = triangulate(polygon, "refined", criterion=criterion)
        assert verify(polygon, triangles).conforming
        if wanted.normalise is None:  # else two triangles have other weights than the polygon
            assert flips_that_gain(polygon, triangles, wanted) == 0


def test_alone_it_means_the_half_perimeter():
    polygon = star(60, spread=0.4)
    alone = triangulate(polygon, "refined")
    assert np.array_equal(alone, triangulate(polygon, "refined:half-perimeter"))
    assert not np.array_equal(alone, triangulate(polygon, "refined:overdraw"))


@pytest.mark.parametrize("name", ["refined", "refined:edge-length", "refined:shape"])
def test_a_batch_gives_what_one_at_a_time_gives(name):
    rng = np.random.default_rng(8)
    polygons = [random_simple(rng, int(rng.integers(3, 30)), 40) for _ in range(60)]
    polygons += [with_hole(rng, 10, 4) for _ in range(10)] + [star(250)]
    result = triangulate_many(polygons, name)
    assert not result.failed
    for polygon, triangles in zip(polygons, result, strict=True):
        assert np.array_equal(triangles, triangulate(polygon, name))


def test_on_a_city_it_is_within_two_percent_of_the_optimum():
    polygons = make_frame(load("city").polygons[::5], View(1024)).polygons
    total = dict.fromkeys(("ear-clipping", "delaunay", "refined", "optimal:half-perimeter"), 0.0)
    for polygon in polygons:
        points = vertices(polygon)
        for name in total:
            total[name] += predict(points, triangulate(polygon, name))["half_perimeter"]
    assert total["refined"] <= total["optimal:half-perimeter"] * 1.02
    assert total["refined"] < min(total["delaunay"], total["ear-clipping"])
