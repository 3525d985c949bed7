"""Tables over what local minimality leaves prove the same optimum as the linear program does."""

import numpy as np
import pytest
import shapely

from tests.triangulators.cases import glyphs, with_holes
from triangulators import criteria
from triangulators.certificate import linear_program, proof, skeleton
from triangulators.certificate.candidates import candidates_of, how_many
from triangulators.certificate.certify import certificate_of
from triangulators.certificate.extend_potentials import extend
from triangulators.certificate.local_minimality import exclude
from triangulators.certificate.proof import prove
from triangulators.certificate.sight import sight_of
from triangulators.checking.evidence import Branch, Leaf
from triangulators.checking.units import units_for
from triangulators.criteria.cost import cost_of
from triangulators.polygon import boundary, boundary_area
from triangulators.starting.starts import best_start


def posed(polygon, name="half-perimeter"):
    outline = boundary(polygon)
    criterion = criteria.find(name)
    return outline, cost_of(criterion, boundary_area(outline), outline.expected_triangles)


def proven(polygon, name="half-perimeter"):
    """Return the cost of the optimum that is found, and the evidence; it must be proven."""
    outline, cost = posed(polygon, name)
    found = prove(outline, best_start(outline, cost), cost)
    found = prove(outline, found.triangles, cost)  # evidence about what was found
    certificate = certificate_of(outline, found.triangles, cost, found.evidence)
    assert certificate.proven, polygon.wkt
    return certificate.cost, found.evidence


def annulus(n: int, seed: int) -> shapely.Polygon:
    """Return a ring with many locally minimal diagonals: next to none can be excluded."""
    rng = np.random.default_rng(seed)
    rings = []
    for radius in (100, 70):
        turn = 2 * np.pi * (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / n
        rings.append(np.rint(radius * np.column_stack([np.cos(turn), np.sin(turn)]) * 256) / 256)
    return shapely.Polygon(rings[0], [rings[1]])


def holed() -> list[shapely.Polygon]:
    rng = np.random.default_rng(4)
    found = [with_holes(rng, 8, int(rng.integers(1, 5))) for _ in range(25)]
    return found + [polygon for _, polygon in glyphs("B8%&") if polygon.interiors]


@pytest.mark.parametrize("name", ["half-perimeter", "overdraw", "expected-quads"])
def test_the_table_finds_what_the_program_finds(monkeypatch, name):
    by_table = [proven(polygon, name) for polygon in holed()]
    assert sum(isinstance(evidence.root, Leaf) for _, evidence in by_table) > 20
    apart = skeleton.Parts(9, np.empty(0), np.empty(0))
    monkeypatch.setattr(proof, "parts_of", lambda *_: apart)
    for polygon, (cost, _) in zip(holed(), by_table, strict=True):
        assert proven(polygon, name)[0] == pytest.approx(cost, rel=1e-12), polygon.wkt


@pytest.mark.parametrize("sign", [1, -1])
def test_no_triangulation_is_chosen_where_there_is_none(monkeypatch, sign):
    """Whatever weights are: a triangle of weight below 0 does not fill what nothing fills."""
    asked = []
    real = proof.by_table

    def noted(*arguments):
        asked.append(arguments)
        return real(*arguments)

    monkeypatch.setattr(proof, "by_table", noted)
    for polygon in holed()[:8]:
        proven(polygon, "half-perimeter")
    assert len(asked) >= 8
    for candidates, weights, alive, cut in asked:
        bare = np.flatnonzero(candidates.side)[-1]  # a side of the boundary without a triangle
        rest = alive & ~(candidates.sides == bare).any(axis=1)
        table = real(candidates, sign * weights, rest, cut)
        assert table is None or len(table.chosen) == 0
    for step in ("_fill_rest", "_fill"):
        assert all(real(*each) is not None for each in asked)
        monkeypatch.setattr(skeleton, step, lambda *_: False)
        assert not any(real(*each) for each in asked)
        monkeypatch.undo()


@pytest.mark.parametrize("name", ["half-perimeter", "overdraw", "expected-quads", "shape"])
def test_potentials_stand_in_for_exclusions(monkeypatch, name):
    excluded = 0
    for polygon in [*holed(), annulus(9, 1)]:
        cost, evidence = proven(polygon, name)
        assert len(evidence.excluded) == 0
        with monkeypatch.context() as patch:
            patch.setattr(proof, "extend", lambda *_: None)
            same, other = proven(polygon, name)
        assert same == cost
        excluded += len(other.excluded)
        sides = np.isin(np.arange(len(other.edges)), other.excluded, invert=True)
        assert (evidence.root.potentials[sides] == other.root.potentials[sides]).all()
    assert excluded > 500


def test_a_lift_is_not_made_worse():
    outline, cost = posed(annulus(14, 3), "overdraw")
    start = best_start(outline, cost)
    sight = sight_of(outline, start)
    units = units_for(outline, start, cost)
    posed_ = proof._posed(sight, start, cost, units, how_many(sight, proof._LISTED))
    c, weights = posed_.candidates, posed_.weights
    order, alive = exclude(c, weights, cost, posed_.units, posed_.out)
    ahead = np.where(c.triangles < np.roll(c.triangles, -1, axis=1), 1, -1)
    rng = np.random.default_rng(0)
    for size in (0, 1, 10**6, 10**12):
        given = rng.integers(-size, size + 1, len(c.edges))
        slack = weights - (ahead * given[c.sides]).sum(axis=1)
        lift = min(int(slack[alive].min()), 0)
        found = extend(c, weights, order, given, posed_.out)
        slack = weights - (ahead * found[c.sides]).sum(axis=1)
        assert int(slack.min()) >= lift
        assert (np.delete(found, order) == np.delete(given, order)).all()


def test_connected_skeletons_need_no_program(monkeypatch):
    monkeypatch.setattr(linear_program, "highspy", None)
    needed = 0
    for polygon in holed():
        try:
            proven(polygon)
        except AttributeError:
            needed += 1
    assert needed <= 2


@pytest.mark.parametrize("seed", range(4))
def test_parts_that_stay_apart_are_tried_each_way(monkeypatch, seed):
    polygon = annulus(12, seed)
    outline, cost = posed(polygon)
    sight = sight_of(outline, best_start(outline, cost))
    everything = candidates_of(sight, how_many(sight, proof._LISTED), np.arange(len(sight.edges)))
    count = len(everything.triangles)
    # With nothing excluded the skeleton is the boundary alone, and all ways are many.
    parts = skeleton.parts_of(everything, np.ones(count, np.bool_))
    assert parts.number == 2
    across = skeleton.ways_across(everything, np.ones(count, np.bool_), parts.of)
    edge = everything.edges[across.edge]
    assert everything.side[across.edge] != 0
    assert len(set(across.ways.tolist())) == len(across.ways)
    ways = everything.edges[across.ways]
    assert (np.isin(ways, edge).sum(axis=1) == 1).all()
    assert (parts.of[ways[:, 0]] != parts.of[ways[:, 1]]).all()
    monkeypatch.setattr(
        proof, "exclude", lambda *_: (np.empty(0, np.int32), np.ones(count, np.bool_))
    )
    monkeypatch.setattr(proof._Search, "_is_proof", lambda *_: False)  # by the program, at once
    cost_each_way, evidence = proven(polygon)
    assert isinstance(evidence.root, Branch)
    monkeypatch.undo()
    assert proven(polygon)[0] == cost_each_way


def test_crossed_edges_are_those_of_the_other_diagonal():
    points = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0), (8.0, 6.0)])
    edges = np.array([(0, 1), (1, 2), (2, 3), (0, 3), (0, 2), (1, 3), (3, 4)], np.int32)
    assert skeleton.crossed(points, edges, 0, 2).tolist() == [0, 0, 0, 0, 0, 1, 0]
    assert skeleton.crossed(points, edges, 1, 2).tolist() == [0, 0, 0, 0, 0, 0, 0]


def test_a_triangulations_sides_are_told_from_other_edges():
    edges = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])
    sides = proof._has_edges(edges, np.array([(0, 1, 2), (2, 1, 3)]), 4)
    assert sides.tolist() == [True, True, False, True, True, True]
