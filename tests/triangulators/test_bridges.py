"""Optima of polygons with holes by walks of bridges, against brute force and certificates."""

import numpy as np
import pytest
import shapely

from tests.endurance.brute_force import SmallPolygon
from tests.triangulators.cases import pose, read_shared, with_hole, with_holes
from triangulators import criteria, triangulate, vertices
from triangulators.certificate import bridges, proof
from triangulators.certificate.bridges import solve_by_bridges
from triangulators.certificate.candidates import find_candidates, weigh_candidates
from triangulators.certificate.proof import minimise_cost
from triangulators.checking.evidence import compute_costs
from triangulators.criteria.cost import compute_total_cost, make_cost
from triangulators.initial import find_any_triangulation
from triangulators.optimum.any_cost import INFEASIBLE_COST
from triangulators.polygon import boundary
from triangulators.verify import verify

CRITERIA = ("expected-quads", "exact-quads", "half-perimeter", "shape")


def make_bridge_arguments(polygon, name, sign=1.0):
    """Return the cost, and the arguments of `solve_by_bridges`."""
    outline, cost = pose(polygon, name, sign)
    candidates = find_candidates(outline, find_any_triangulation(outline), 10**6)
    weights = weigh_candidates(outline.points, candidates.triangles, cost)
    alive = np.ones(len(weights), dtype=np.bool_)
    return cost, (candidates, outline.ring_offsets, alive, weights, INFEASIBLE_COST)


def check_against_brute_force(polygon: shapely.Polygon, name: str) -> None:
    """Compare both extremes; rings that touch are left to other programs, but must be right."""
    rings = [list(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    total, small = criteria.find(name).total, SmallPolygon(rings)
    points, outline = vertices(polygon), boundary(polygon)
    for sign in (1.0, -1.0):

        def cost(corners: list[tuple[float, float]], sign: float = sign) -> float:
            return sign * total(np.array(corners), np.array([[0, 1, 2]]))

        expected = sign * float(small.optimum(cost)[0])
        if outline.holes and outline.has_plain_rings:
            record, arguments = make_bridge_arguments(polygon, name, sign)
            triangles = arguments[0].triangles[solve_by_bridges(*arguments)]
            found = sign * compute_total_cost(outline.points, triangles, record)
            assert verify(polygon, triangles).conforming, polygon.wkt
            assert found == pytest.approx(expected, rel=1e-9, abs=1e-9), polygon.wkt
        if sign > 0.0:
            best = triangulate(polygon, "optimal", criterion=name)
            assert total(points, best) == pytest.approx(expected, rel=1e-9, abs=1e-9), polygon.wkt


@pytest.mark.parametrize(("number", "name"), list(enumerate(CRITERIA)))
def test_optimum_equals_brute_force(number, name):
    rng = np.random.default_rng(number)
    for attempt in range(8):
        polygon = with_holes(rng, int(rng.integers(4, 8)), int(rng.integers(1, 3)))
        if attempt % 2 == 0:
            polygon = with_hole(rng, 5, 6)  # a concave hole has pockets
        scale, shift = float(rng.choice([0.25, 1.0, 3.0])), float(rng.choice([0.0, 0.5]))
        moved = shapely.transform(polygon, lambda points, by=scale, to=shift: points * by + to)
        check_against_brute_force(moved, name)


def test_exclusion_leaves_few_ways_to_cut(monkeypatch):
    """Real polygons with three holes and more need no linear program."""
    outlines = [boundary(p) for _, p in read_shared("helsinki.json") if p.is_valid]
    outlines = [o for o in outlines if o.holes > 2 and o.has_plain_rings]
    assert len(outlines) > 4
    monkeypatch.setattr(proof, "LinearProgram", None)
    for outline in outlines:
        cost = make_cost(criteria.find("half-perimeter"), 1.0, 1)
        triangles, gap = minimise_cost(outline, cost, np.inf)
        assert gap == 0.0
        assert len(triangles) == outline.expected_triangles


def test_too_many_ways_to_cut_give_no_solution(monkeypatch):
    polygon = with_holes(np.random.default_rng(2), 9, 2)
    _, arguments = make_bridge_arguments(polygon, "expected-quads")
    assert len(solve_by_bridges(*arguments)) == boundary(polygon).expected_triangles
    monkeypatch.setattr(bridges, "MAX_CUTS", 0)
    assert len(solve_by_bridges.py_func(*arguments)) == 0
    arguments[2][:] = False
    assert len(solve_by_bridges(*arguments)) == 0


@pytest.mark.parametrize("name", ["expected-quads", "expected-blocks", "shape", "exact-quads"])
def test_blocks_of_triangles_have_the_costs_of_single_ones(name):
    rng = np.random.default_rng(3)
    points = np.round(rng.uniform(0.0, 9.0, (60, 2)) * 256) / 256
    points[:9, 1] = points[0, 1]  # triangles without area
    triangles = rng.integers(0, 60, (700, 3)).astype(np.int32)
    triangles[:30] = rng.integers(0, 9, (30, 3))
    cost = make_cost(criteria.find(name), 1.0, 1)
    lowest_first = np.array([np.roll(row, -np.argmin(row)) for row in triangles], dtype=np.int32)
    costs = compute_costs(points, triangles, cost)
    assert (weigh_candidates(points, lowest_first, cost) == costs).all()
    assert np.isfinite(weigh_candidates(points, triangles, cost)).all()
