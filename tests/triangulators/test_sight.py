"""Search and checker find the same edges, each in its own way; thinning loses no optimum."""

from dataclasses import replace

import numba
import numpy as np
import pytest
import shapely

from tests.triangulators.cases import shared, smooth, star, with_holes
from tests.triangulators.test_skeleton import annulus, posed, proven
from tests.triangulators.touching import touching_polygons
from triangulators import triangulate
from triangulators.certificate import certify, proof
from triangulators.certificate.local_minimality import seen_by_both
from triangulators.certificate.sight import Fans, fans_of, sight_of
from triangulators.checking import boxes, checker, exclusions, potentials, visible_pairs
from triangulators.checking.evidence import Refused
from triangulators.checking.visible_pairs import visible
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
    own = visible(outline.points, outline.edges, outline.site)
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
        again = np.sort(visible(small.points, small.edges, small.site), axis=1)
        assert again.tolist() == checkers.tolist()


def test_neighbours_are_listed_in_order():
    outline, cost = posed(star(60))
    sight = sight_of(outline, best_start(outline, cost))
    fans = fans_of(sight)
    for v in range(len(sight.points)):
        near = fans.near[fans.begin[v] : fans.begin[v + 1]]
        over = sight.edges[fans.by[fans.begin[v] : fans.begin[v + 1]]]
        assert (np.diff(near) > 0).all()
        assert np.array_equal(np.sort(over, axis=1), np.sort(np.c_[np.full_like(near, v), near]))
    assert len(fans.near) == 2 * len(sight.edges)


def test_what_the_next_site_sees_is_seen_by_no_other():
    """Of what 0 sees the one site comes before what 1 sees, of which the first comes again."""
    begin, near = np.array([0, 1, 3, 4]), np.array([3, 5, 7, 5], np.int32)
    fans, both = Fans(begin, near, np.arange(4, dtype=np.int32)), np.zeros((4, 2), np.int64)
    assert seen_by_both(fans, 0, 1, both) == seen_by_both(fans, 1, 0, both) == 0
    assert seen_by_both(fans, 1, 2, both) == 1
    assert both[0].tolist() == [1, 3]


@numba.njit
def lopsided(ax, ay, bx, by, cx, cy):
    """A cost that depends on which way the triangle turns."""
    return 2.0 * abs(bx - ax) + abs(cx - bx) + abs(by - ay) + 3.0 * abs(ay - cy) + 1.0


@pytest.mark.parametrize("name", ["half-perimeter", "overdraw", "expected-quads", lopsided])
def test_thinned_before_they_are_listed_candidates_prove_the_same(monkeypatch, name):
    rng = np.random.default_rng(3)
    polygons = [with_holes(rng, 40, 3), annulus(16, 1), star(150)]
    expected = [proven(polygon, name)[0] for polygon in polygons]
    monkeypatch.setattr(proof, "_LISTED", 0)
    monkeypatch.setattr(proof, "_WORTH", 0.0)
    for polygon, cost in zip(polygons, expected, strict=True):
        found, evidence = proven(polygon, name)
        assert found == cost
        assert len(evidence.excluded) == 0
        with monkeypatch.context() as patch:
            patch.setattr(proof, "extend", lambda *_: None)
            same, other = proven(polygon, name)
        assert same == cost
        assert len(other.excluded) > 0


@pytest.mark.parametrize(("name", "value"), [("_WORTH", 1.0), ("_LEFT", 10)])
def test_where_thinning_does_not_pay_there_is_no_bound_and_no_claim(monkeypatch, name, value):
    polygon = annulus(16, 1)
    triangles = triangulate(polygon, "delaunay")
    monkeypatch.setattr(proof, "_LISTED", 0)
    monkeypatch.setattr(proof, "_WORTH", 0.0)
    monkeypatch.setattr(proof, name, value)
    given = certify.certify(polygon, triangles)
    assert (given.proven, given.gap, given.lower_bound) == (False, np.inf, -np.inf)


def test_a_start_of_excluded_edges_is_improved(monkeypatch):
    polygon = star(80)
    outline, cost = posed(polygon)
    worst = outline.site[triangulate(polygon, "worst:half-perimeter")]
    monkeypatch.setattr(proof, "_LISTED", 0)
    found = proof.prove(outline, worst, cost)
    optimum = certify.certificate_of(outline, found.triangles, cost, found.evidence)
    given = certify.certificate_of(outline, worst, cost, found.evidence)
    assert optimum.proven
    assert not given.proven
    assert given.lower_bound == optimum.lower_bound == proven(polygon)[0] < given.cost


def test_shared_out_among_threads_the_checker_says_the_same(monkeypatch):
    polygon = star(300)
    outline, cost = posed(polygon)
    monkeypatch.setattr(proof, "extend", lambda *_: None)  # so that there are exclusions
    start = best_start(outline, cost)
    found = proof.prove(outline, start, cost)
    alone = visible(outline.points, outline.edges, outline.site)
    bound = checker.lower_bound(outline, start, cost, found.evidence)
    monkeypatch.setattr(visible_pairs, "_FEW", 0)
    monkeypatch.setattr(exclusions, "_FEW", 0)
    monkeypatch.setattr(potentials, "_FEW", 0)
    shared_out = visible(outline.points, outline.edges, outline.site)
    assert set(map(tuple, shared_out.tolist())) == set(map(tuple, alone.tolist()))
    assert checker.lower_bound(outline, start, cost, found.evidence) == bound
    early = replace(found.evidence, excluded=found.evidence.excluded[::-1].copy())
    with pytest.raises(Refused, match="is excluded, but"):
        checker.lower_bound(outline, start, cost, early)


def test_sites_are_in_the_order_of_a_curve_in_z():
    """By the bits of x and y in turns, those of y first."""
    rng = np.random.default_rng(6)
    whole = np.vstack([[0, 0], [65535, 65535], rng.integers(0, 65535, (2000, 2))])
    # Off the lines between cells; the first two are the corners of all.
    points = whole + np.where(np.arange(len(whole)) < 2, 0.0, 0.5)[:, None]
    keys = [
        sum((v >> bit & 1) << (2 * bit + axis) for bit in range(16) for axis, v in enumerate(xy))
        for xy in whole.tolist()
    ]
    order = boxes.near_each_other(points, np.arange(len(points), dtype=np.int32))
    assert (np.diff(np.array(keys)[order]) >= 0).all()
    some = np.arange(0, len(points), 7, dtype=np.int32)
    assert sorted(boxes.near_each_other(points, some).tolist()) == some.tolist()


@pytest.mark.parametrize("count", [1, 8, 9, 16, 17, 100])
def test_a_box_of_the_tree_holds_its_sites_and_no_more(count):
    points = np.random.default_rng(count).uniform(-9, 9, (count, 2))
    order = np.arange(count, dtype=np.int32)[::-1].copy()
    tree = boxes.boxes_of(points, order)
    leaves = len(tree) // 2
    assert leaves == 1 or leaves * 4 < count <= leaves * 8
    for node in range(1, len(tree)):
        begin, end = boxes.places_of(node, leaves, count)
        own = points[order[begin:end]]
        if len(own):
            assert np.array_equal(tree[node], [own.min(axis=0), own.max(axis=0)])
        else:
            assert (tree[node][0] > tree[node][1]).all()
    assert boxes.places_of(1, leaves, count) == (0, count)


@pytest.mark.parametrize(
    ("place", "squared"),
    [
        *(((2.0, 3.0), 0.0), ((0.0, 3.0), 1.0), ((6.0, 3.0), 4.0), ((2.0, 0.0), 4.0)),
        *(((2.0, 9.0), 9.0), ((0.0, 0.0), 5.0), ((6.0, 9.0), 13.0)),
    ],
)
def test_the_distance_from_a_box_is_that_of_its_nearest_point(place, squared):
    points, box = np.array([(99.0, 99.0), place]), np.array([(1.0, 2.0), (4.0, 6.0)])
    assert boxes.distance(points, 1, box) == squared


def test_what_hides_goes_to_the_front():
    hiding = np.array([(1, 2), (3, 4), (5, 6), (7, 8)], np.int32)
    boxes.to_front(hiding, 2)
    assert hiding.tolist() == [[5, 6], [1, 2], [3, 4], [7, 8]]
    boxes.to_front(hiding, 0)
    assert hiding.tolist() == [[5, 6], [1, 2], [3, 4], [7, 8]]
