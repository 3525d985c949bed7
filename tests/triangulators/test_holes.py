"""Optima of polygons with holes, also touching ones, and former failures."""

import csv
from pathlib import Path

import numpy as np
import pytest
import shapely

from tests.triangulators.cases import record_calls, touching_polygons, with_hole
from triangulators import certify, triangulate, vertices
from triangulators.criteria import CRITERIA, find
from triangulators.criteria.cost import compute_total_cost, make_cost
from triangulators.initial import find_best_initial
from triangulators.optimum import best_way
from triangulators.optimum.best_way import optimise_along_random_trees
from triangulators.polygon import boundary
from triangulators.verify import verify


def test_local_search_is_close_to_optimum():
    rng = np.random.default_rng(6)
    cost = make_cost(CRITERIA["half-perimeter"], 1.0, 1)
    ratios = []
    for _ in range(40):
        polygon = with_hole(rng, int(rng.integers(6, 26)), int(rng.integers(3, 14)))
        outline = boundary(polygon)
        start = find_best_initial(outline, cost)
        improved = optimise_along_random_trees(outline.points, start, cost)
        assert verify(polygon, improved).conforming
        best = triangulate(polygon, "optimal:half-perimeter")
        exact = compute_total_cost(outline.points, best, cost)
        total = compute_total_cost(outline.points, improved, cost)
        assert exact <= total * (1 + 1e-12)
        assert total <= compute_total_cost(outline.points, start, cost) * (1 + 1e-12)
        ratios.append(total / exact)
    assert np.mean(ratios) < 1.002
    assert np.mean(np.array(ratios) < 1 + 1e-9) > 0.8


def test_local_search_continues_after_gain(monkeypatch):
    """It ends after six consecutive choices of cuts without gain."""
    calls = record_calls(monkeypatch, best_way.Patchwork, "compute_cost")
    rng = np.random.default_rng(6)
    cost = make_cost(CRITERIA["half-perimeter"], 1.0, 1)
    gains = 0
    for _ in range(8):
        calls.clear()
        outline = boundary(with_hole(rng, 20, 9))
        if len(np.unique(outline.edges)) < 29 or len(outline.edges) > 29:
            continue  # rings that touch may leave nothing to cut
        optimise_along_random_trees(outline.points, find_best_initial(outline, cost), cost)
        totals = [total for _, total in calls]
        improved = np.flatnonzero(np.diff(totals) < -1e-9) + 1
        gains += len(improved)
        last = improved[-1] if len(improved) else 0
        assert len(totals) - 1 - last == 6
    assert gains > 5


SQUARE = [(0, 0), (8, 0), (8, 8), (0, 8)]
TWICE = shapely.Polygon([(0, 0), (9, 0), (9, 9)], [[(3, 0), (4, 1), (5, 1)]])
NAMES = ("optimal:half-perimeter", "greedy", "worst:half-perimeter", "optimal:overdraw")


@pytest.mark.parametrize(
    "polygon",
    [
        shapely.Polygon(SQUARE, [[(0, 2), (4, 6), (6, 4), (6, 2)]]),  # a vertex on a side
        shapely.Polygon(SQUARE, [[(0, 0), (4, 6), (6, 4), (6, 2)]]),  # at a corner
        shapely.Polygon(SQUARE, [[(2, 2), (4, 4), (2, 6)], [(4, 4), (6, 2), (6, 6)]]),
        shapely.Polygon(SQUARE, [[(4, 0), (2, 2), (3, 3)], [(4, 0), (5, 3), (6, 2)]]),
        shapely.affinity.translate(shapely.affinity.scale(TWICE, 1 / 3, 1 / 3), 0.1, 0.7),
    ],
)
def test_rings_that_touch(polygon):
    for name in (*NAMES, "optimal:shape"):
        assert verify(polygon, triangulate(polygon, name)).conforming, name


@pytest.mark.parametrize("number", range(len(NAMES)))
def test_300_hostile_polygons_are_triangulated(number):
    for polygon in touching_polygons(seed=number, count=75):
        assert verify(polygon, triangulate(polygon, NAMES[number])).conforming, polygon.wkt


with Path(__file__).with_name("hunted.csv").open(encoding="utf-8") as file:
    HUNTED = [(row["criterion"], shapely.from_wkt(row["wkt"])) for row in csv.DictReader(file)]


@pytest.mark.parametrize(("criterion", "polygon"), HUNTED)
def test_hunted_polygons_are_optimal_and_proven(criterion, polygon):
    total = find(criterion).total
    best = triangulate(polygon, f"optimal:{criterion}")
    certificate = certify(polygon, best, criterion)
    assert certificate.proven
    assert total(vertices(polygon), best) == pytest.approx(certificate.cost, rel=1e-12)
    for name in ("greedy", "refined"):
        triangles = triangulate(polygon, name)
        assert verify(polygon, triangles).conforming
        assert total(vertices(polygon), triangles) >= certificate.lower_bound
