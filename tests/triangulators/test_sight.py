"""Search and checker find the same edges, each in its own way."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from tests.triangulators.cases import shared, smooth, star, with_holes
from tests.triangulators.test_skeleton import annulus, posed
from tests.triangulators.touching import touching_polygons
from triangulators.certificate import proof
from triangulators.certificate.sight import sight_of
from triangulators.checking import checker, edges
from triangulators.checking.edges import _diagonals_of
from triangulators.checking.evidence import Refused
from triangulators.polygon import boundary
from triangulators.starting.starts import best_start


def comb(teeth: int) -> shapely.Polygon:
    """Teeth that hide each other: long edges that stand in the way of most pairs."""
    x = np.repeat(np.arange(teeth) * 4.0, 2)
    shape = np.column_stack([x, np.tile([60.0, 2.0], teeth)])
    return shapely.Polygon([(-3.0, 0.0), (4.0 * teeth, 0.0), *shape[::-1].tolist()])


def sieve(seed: int) -> shapely.Polygon:
    """A smooth outline with a hundred triangles for holes."""
    rng = np.random.default_rng(seed)
    shell = shapely.Polygon(shapely.get_coordinates(smooth(200)))
    low_x, low_y, high_x, high_y = shell.bounds
    size = min(high_x - low_x, high_y - low_y) / 16
    holes = []
    for x in np.arange(low_x, high_x, size):
        for y in np.arange(low_y, high_y, size):
            corners = np.rint((rng.uniform(0.1, 0.9, (3, 2)) * size + [x, y]) * 256) / 256
            hole = shapely.Polygon(corners)
            if hole.area > 0.01 * size**2 and shell.contains_properly(hole):
                holes.append(corners)
    return shapely.Polygon(shell.exterior, holes)


def sites_in_many_boxes():
    yield from (star(700, spread=0.5), smooth(900), comb(150), sieve(0), sieve(1))
    yield from (polygon for _, polygon in shared("helsinki.json")[::60])


def edges_of_both(polygon):
    outline, cost = posed(polygon)
    sight = sight_of(outline, best_start(outline, cost))
    own = _diagonals_of(outline.points, outline.edges, outline.site)
    return sight.edges[sight.side == 0], np.sort(own, axis=1)


def test_search_and_checker_see_the_same():
    many = 0
    for polygon in sites_in_many_boxes():
        ours, checkers = edges_of_both(polygon)
        assert len(np.unique(checkers, axis=0)) == len(checkers)
        assert set(map(tuple, ours.tolist())) == set(map(tuple, checkers.tolist())), polygon.wkt
        many += len(ours)
    assert many > 20_000


def test_they_do_where_rings_touch_and_holes_hide_much():
    rng = np.random.default_rng(4)
    holed = [with_holes(rng, 30, 4), comb(20), annulus(12, 2)]
    for polygon in [*touching_polygons(5, 150), *touching_polygons(6, 60), *holed]:
        ours, checkers = edges_of_both(polygon)
        assert set(map(tuple, ours.tolist())) == set(map(tuple, checkers.tolist())), polygon.wkt
        small = boundary(shapely.transform(polygon, lambda points: points * 2.0**-14))
        again = np.sort(_diagonals_of(small.points, small.edges, small.site), axis=1)
        assert again.tolist() == checkers.tolist()


def test_shared_out_among_threads_the_checker_says_the_same(monkeypatch):
    polygon = star(300)
    outline, cost = posed(polygon)
    start = best_start(outline, cost)
    evidence = proof.prove(outline, start, cost).evidence()
    alone = _diagonals_of(outline.points, outline.edges, outline.site)
    bound = checker.lower_bound(outline, start, cost, evidence)
    monkeypatch.setattr(edges, "_FEW", 0)
    monkeypatch.setattr(checker, "_FEW", 0)
    shared_out = _diagonals_of(outline.points, outline.edges, outline.site)
    assert set(map(tuple, shared_out.tolist())) == set(map(tuple, alone.tolist()))
    assert checker.lower_bound(outline, start, cost, evidence) == bound
    more = replace(evidence, lift=evidence.lift + 1)
    with pytest.raises(Refused, match="potentials exceed"):
        checker.lower_bound(outline, start, cost, more)


def test_what_hides_goes_to_the_front():
    hiding = np.array([(1, 2), (3, 4), (5, 6), (7, 8)], np.int32)
    edges._to_front(hiding, 2)
    assert hiding.tolist() == [[5, 6], [1, 2], [3, 4], [7, 8]]
    edges._to_front(hiding, 0)
    assert hiding.tolist() == [[5, 6], [1, 2], [3, 4], [7, 8]]
