"""Polygons with holes: the true optimum with one, never worse than the start with more."""

from itertools import product

import numpy as np
import pytest
import shapely

from tests.triangulators.cases import brute_cost, shared, twice_area, with_hole
from triangulators import criteria, triangulate, vertices
from triangulators.criteria import predict
from triangulators.verify import verify


def best_over_bridges(polygon, name):
    """Cut along every bridge between the rings in turn; Catalan's recursion on what results."""
    points = vertices(polygon)
    count = len(polygon.exterior.coords) - 1
    outer, inner = list(range(count)), list(range(count, len(points)))
    if not polygon.exterior.is_ccw:
        outer.reverse()
    if polygon.interiors[0].is_ccw:
        inner.reverse()
    least = np.inf
    for a, b in product(range(len(outer)), range(len(inner))):
        segment = shapely.LineString([points[outer[a]], points[inner[b]]])
        if not polygon.covers(segment):
            continue
        cycle = outer[a:] + outer[: a + 1] + inner[b:] + inner[: b + 1]
        n = len(cycle)
        table = np.full((n, n), np.inf)
        for i in range(n - 1):
            table[i, i + 1] = 0.0
        for span in range(2, n):
            for i in range(n - span):
                j = i + span
                for k in range(i + 1, j):
                    corners = [points[cycle[m]] for m in (i, k, j)]
                    below = table[i, k] + table[k, j]
                    if below < np.inf and twice_area(*corners) > 0:
                        table[i, j] = min(table[i, j], below + brute_cost(name, *corners))
        least = min(least, table[0, n - 1])
    return least


@pytest.mark.parametrize("name", ["half-perimeter", "overdraw"])
def test_one_hole_gives_the_true_optimum(name):
    rng = np.random.default_rng(5)
    for _ in range(6):
        polygon = with_hole(rng, int(rng.integers(4, 9)), int(rng.integers(3, 6)))
        triangles = triangulate(polygon, "optimal", criterion=name)
        assert verify(polygon, triangles).conforming
        total = criteria.find(name).total(vertices(polygon), triangles)
        assert total == pytest.approx(best_over_bridges(polygon, name), rel=1e-9), polygon.wkt


def test_the_local_search_comes_close_to_the_true_optimum():
    from triangulators.criteria import CRITERIA
    from triangulators.criteria.cost import cost_of, evaluate
    from triangulators.optimum.local_search import search_cuts
    from triangulators.polygon import boundary
    from triangulators.starting.starts import best_start

    rng = np.random.default_rng(6)
    cost = cost_of(CRITERIA["half-perimeter"], 1.0, 1)
    ratios = []
    for _ in range(40):
        polygon = with_hole(rng, int(rng.integers(6, 26)), int(rng.integers(3, 14)))
        outline = boundary(polygon)
        start = best_start(outline, cost)
        found = search_cuts(outline.points, start, cost)
        assert verify(polygon, found).conforming
        exact = evaluate(outline.points, triangulate(polygon, "optimal:half-perimeter"), cost)
        total = evaluate(outline.points, found, cost)
        assert exact <= total * (1 + 1e-12)
        assert total <= evaluate(outline.points, start, cost) * (1 + 1e-12)
        ratios.append(total / exact)
    assert np.mean(ratios) < 1.002
    assert np.mean(np.array(ratios) < 1 + 1e-9) > 0.8


def test_the_local_search_goes_on_after_a_gain(monkeypatch):
    """It ends when six choices of cuts in a row gained nothing, and not before."""
    from triangulators.criteria import CRITERIA
    from triangulators.criteria.cost import cost_of
    from triangulators.optimum import local_search
    from triangulators.polygon import boundary
    from triangulators.starting.starts import best_start

    totals = []

    class Watched(local_search.Patchwork):
        def total(self):
            totals.append(super().total())
            return totals[-1]

    monkeypatch.setattr(local_search, "Patchwork", Watched)
    rng = np.random.default_rng(6)
    cost = cost_of(CRITERIA["half-perimeter"], 1.0, 1)
    gains = 0
    for _ in range(8):
        totals.clear()
        outline = boundary(with_hole(rng, 20, 9))
        if len(np.unique(outline.edges)) < 29 or len(outline.edges) > 29:
            continue  # rings that touch may leave nothing to cut
        local_search.search_cuts(outline.points, best_start(outline, cost), cost)
        improved = np.flatnonzero(np.diff(totals) < -1e-9) + 1
        gains += len(improved)
        last = improved[-1] if len(improved) else 0
        assert len(totals) - 1 - last == 6
    assert gains > 5


def test_never_worse_than_ear_clipping_or_delaunay_on_helsinki():
    holed = [polygon for _, polygon in shared("helsinki.json") if polygon.interiors]
    valid = [polygon for polygon in holed if polygon.is_valid]
    assert len(valid) > 80
    for polygon in valid:
        points = vertices(polygon)
        best = triangulate(polygon, "optimal:half-perimeter")
        assert verify(polygon, best).conforming
        for peer in ("ear-clipping", "delaunay"):
            cost = predict(points, triangulate(polygon, peer, repair=True))["half_perimeter"]
            assert predict(points, best)["half_perimeter"] <= cost * (1 + 1e-12)


def test_rings_that_touch():
    square = [(0, 0), (8, 0), (8, 8), (0, 8)]
    holes = [
        [[(0, 2), (4, 6), (6, 4), (6, 2)]],  # a vertex of the hole on a side
        [[(0, 0), (4, 6), (6, 4), (6, 2)]],  # at a corner
        [[(2, 2), (4, 4), (2, 6)], [(4, 4), (6, 2), (6, 6)]],  # two holes that touch
    ]
    for rings in holes:
        polygon = shapely.Polygon(square, rings)
        assert polygon.is_valid
        for name in ("optimal", "worst:half-perimeter", "greedy", "optimal:shape"):
            assert verify(polygon, triangulate(polygon, name)).conforming, name
