"""Edge costs: integer and float dynamic programs give the same cost."""

from itertools import chain

import numpy as np
import pytest
import shapely

from harness.frame import View, make_frame
from scenes import load
from tests.triangulators.cases import convex, random_simple, smooth, snapped, star
from triangulators import criteria, triangulate, vertices
from triangulators.criteria.cost import make_cost, replace_fields
from triangulators.criteria.criterion import FEATURES
from triangulators.geometry.predicates import find_grid_unit
from triangulators.initial import make_cycle
from triangulators.optimum import full_table, visible_lists
from triangulators.optimum.full_table import solve_ring
from triangulators.optimum.visible_lists import INT32_LIMIT, solve_visible_pairs, weigh_pairs
from triangulators.polygon import boundary
from triangulators.verify import verify

H = np.array([1.0, 0.0, 0.0])
A = np.array([0.0, 1.0, 0.0])
E = np.array([0.0, 0.0, 1.0])


def solve_all(ring, criterion, sign=1.0):
    """The recurrence with a cost for each triangle, in float64."""
    cost = replace_fields(make_cost(criteria.find(criterion), 1.0, 1, sign), is_box=False)
    best = solve_visible_pairs(ring.points, ring.start, ring.target, cost)
    return criteria.find(criterion).total(ring.points, best)


def solve_dense(ring, box):
    """The dense dynamic program, without visibility."""
    triangles = np.empty((len(ring) - 2, 3), dtype=np.int32)
    assert solve_ring(ring, box, triangles) < np.inf
    return triangles


@pytest.mark.parametrize("n", [130, 300])
def test_dense_and_sparse_programs_have_equal_cost(n):
    assert find_grid_unit(vertices(convex(n))) == 0.0
    for polygon in (snapped(vertices(convex(n))), snapped(vertices(smooth(n))), convex(n)):
        ring = make_cycle(boundary(polygon), "test")
        for name, box in (("overdraw", A), ("half-perimeter", H)):
            cost = criteria.find(name).total(ring.points, solve_dense(ring.points, box))
            assert cost == pytest.approx(solve_all(ring, name), rel=1e-12)


@pytest.mark.parametrize(("criterion", "box"), [("half-perimeter", H), ("edge-length", E)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_edge_costs_equal_triangle_costs(criterion, box, sign):
    # Ear clipping leaves corners on edges in it.
    twice = shapely.Polygon([(3, 3.5), *[(4, 4)] * 2, (3, 3), (3, 2), *[(3, 1)] * 2, (2, 0)])
    for polygon in (star(40, spread=0.4), star(90), convex(33), smooth(64), twice):
        ring = make_cycle(boundary(polygon), "test")
        expected = solve_all(ring, criterion, sign)
        cost = make_cost(criteria.find(criterion), 1.0, 1, sign)
        assert cost["box"].tolist() == (sign * box).tolist()
        edge_optimum = solve_visible_pairs(ring.points, ring.start, ring.target, cost)
        assert verify(polygon, ring.cycle[edge_optimum]).conforming
        total = criteria.find(criterion).total(ring.points, edge_optimum)
        assert total == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("above", [False, True])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_sums_are_exact_around_int32_limit(monkeypatch, above, sign):
    # The longest diagonals of a flat polygon come next to n (w + h): a zigzag, taken by `worst`.
    n = 128  # with fewer corners no grid reaches the guard
    width = INT32_LIMIT // n - 4 * n - 1 + (8 * n if above else 0)
    step = np.arange(n // 2)
    right = np.column_stack((width - (step - n // 4) ** 2 // n, 4 * step))
    left = np.column_stack(((step - n // 4) ** 2 // n, 4 * step + 2))
    ring = np.concatenate((right, left[::-1])).astype(np.float64)
    ring[0, 1] += 1  # so that nothing coarser than 1 is a unit
    span = np.ptp(ring, axis=0).sum()
    assert (n * span >= INT32_LIMIT) == above
    assert find_grid_unit(ring) == 1.0
    start = np.r_[0, np.cumsum(np.arange(n - 1, -1, -1))]
    target = np.concatenate([np.arange(i + 1, n) for i in range(n)]).astype(np.int32)
    weight = weigh_pairs(ring, start, target, sign * H)
    assert weight.dtype == (np.int64 if above else np.int32)
    criterion = criteria.find("half-perimeter")
    cost, total = make_cost(criterion, 1.0, 1, sign), criterion.total
    costs = [total(ring, solve_visible_pairs(ring, start, target, cost))]
    monkeypatch.setattr(visible_lists, "INT32_LIMIT", 0)
    assert weigh_pairs(ring, start, target, sign * H).dtype == np.int64
    costs.append(total(ring, solve_visible_pairs(ring, start, target, cost)))
    assert len(set(costs)) == 1
    if sign < 0.0:
        assert costs[0] > 0.9 * n * width


def test_optimum_on_frames_equals_triangle_recurrence_exactly():
    compared = 0
    scenes = [load(name).polygons[::7] for name in ("city", "cad", "glyphs")]
    for polygon in chain.from_iterable(make_frame(scene, View(1024)).polygons for scene in scenes):
        if polygon.interiors or len(vertices(polygon)) > 250:
            continue
        outline = boundary(polygon)
        ring = make_cycle(outline, "test")
        assert find_grid_unit(ring.points) > 0.0
        for name in ("half-perimeter", "overdraw"):
            triangles = triangulate(polygon, f"optimal:{name}")
            expected = solve_all(ring, name)
            assert criteria.find(name).total(outline.points, triangles) == expected
            compared += 1
    assert compared > 100


def test_dense_program_is_exact_for_box_and_edge_mixtures():
    """A diagonal is an edge of two triangles, a side of the boundary of one."""
    weights = np.zeros(len(FEATURES))
    weights[FEATURES.index("bbox_area")], weights[FEATURES.index("edge_length")] = 1.0, 30.0
    mixture = criteria.Criterion("mixture", "", tuple(weights))
    random = np.random.default_rng(5)
    differ = 0
    for _ in range(60):
        polygon = random_simple(random, 9, 30)
        ring = (outline := boundary(polygon)).points[outline.edges[:, 0]]
        dense_cost = mixture.total(ring, solve_dense(ring, np.array([0.0, 1.0, 30.0])))
        for name in ("exhaustive", "optimal"):
            best = triangulate(polygon, name, criterion=mixture)
            optimal_cost = mixture.total(vertices(polygon), best)
            assert dense_cost == pytest.approx(optimal_cost, rel=1e-12), (name, polygon.wkt)
        single = mixture.total(ring, solve_dense(ring, np.array([0.0, 1.0, 15.0])))
        differ += dense_cost < single * (1 - 1e-9)
    assert differ > 5


def test_grid_unit_is_the_coarsest():
    points = vertices(random_simple(np.random.default_rng(1), 12, 50))
    odd = points * 2 + 1
    for unit in (2.0**-8, 1.0, 2.0**30, 2.0**-200):
        assert find_grid_unit(odd * unit) == unit
    assert find_grid_unit(points + 0.1) == 0.0
    assert find_grid_unit(np.ascontiguousarray(points * 0.1)) == 0.0


@pytest.mark.parametrize(
    ("step", "bend", "expected"), [(1, 0.0, True), (2, 0.0, False), (1, 0.8, False)]
)
def test_is_convex_requires_left_turns_and_one_winding(step, bend, expected):
    angle = 2.0 * np.pi * step * np.arange(5) / 5
    radius = np.where(np.arange(5) == 2, 1.0 - bend, 1.0)
    assert full_table._is_convex(radius * np.cos(angle), radius * np.sin(angle), 5) == expected
