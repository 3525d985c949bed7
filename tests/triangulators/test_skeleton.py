"""Tables over what local minimality leaves prove the same optimum as the linear program does."""

import numpy as np
import pytest
import shapely

from tests.triangulators.cases import glyphs, with_holes
from tests.triangulators.touching import touching_polygons
from triangulators import criteria
from triangulators.certificate import linear_program, proof
from triangulators.certificate.candidates import candidates_of, how_many
from triangulators.certificate.certify import certificate_of
from triangulators.certificate.extend_potentials import extend
from triangulators.certificate.local_minimality import exclude
from triangulators.certificate.proof import prove
from triangulators.certificate.sight import sight_of
from triangulators.certificate.skeleton import _ring_of
from triangulators.checking.units import units_for, weights_of
from triangulators.criteria.cost import cost_of, with_fields
from triangulators.polygon import boundary, boundary_area
from triangulators.starting.starts import best_start


def posed(polygon, name="half-perimeter"):
    outline = boundary(polygon)
    criterion = criteria.find(name)
    return outline, cost_of(criterion, boundary_area(outline), outline.expected_triangles)


def proven(polygon, name="half-perimeter"):
    """Return the cost of the optimum that is found, and the proof; it must be proven."""
    outline, cost = posed(polygon, name)
    found = prove(outline, best_start(outline, cost), cost)
    found = prove(outline, found.triangles, cost)  # evidence about what was found
    certificate = certificate_of(outline, found.triangles, cost, found.evidence())
    assert certificate.proven, polygon.wkt
    return certificate.cost, found


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
    monkeypatch.setattr(proof, "cuts_of", lambda *_: None)
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
    for candidates, left, cut, cost, units in asked:
        assert real(candidates, left, cut, cost, units) is not None
        bare = candidates.sides[
            (candidates.sides == np.flatnonzero(candidates.side)[-1]).any(axis=1)
        ]
        rest = left.copy()  # without the diagonals that make triangles at a side of the boundary
        rest[bare[candidates.side[bare] == 0]] = False
        signed = with_fields(cost, weights=sign * cost["weights"])
        assert real(candidates, rest, cut & rest, signed, units) is None


def test_the_tables_potentials_hold_for_all_triangles_of_edges_that_remain(monkeypatch):
    """Those that no triangulation has included; and a ring is met as often as it is cut."""
    asked, real = [], proof.by_table

    def noted(*arguments):
        asked.append((*arguments, real(*arguments)))
        return asked[-1][-1]

    monkeypatch.setattr(proof, "by_table", noted)
    for polygon in [*holed(), *touching_polygons(5, 40)]:
        proven(polygon)
    cuts = 0
    for c, left, cut, cost, units, table in asked:
        alive = left[c.sides].all(axis=1)
        ahead = np.where(c.triangles < np.roll(c.triangles, -1, axis=1), 1, -1)
        around = (ahead * table.potentials[c.sides]).sum(axis=1)
        weights = weights_of(c.points, c.triangles, cost, units)
        assert (around[alive] <= weights[alive]).all()
        total = weights_of(c.points, table.triangles, cost, units).sum()
        assert (table.potentials * c.side).sum() == total
        assert len(_ring_of(c, cut)) == 2 * cut.sum() + np.count_nonzero(c.side)
        cuts += cut.sum()
    assert cuts > 80


@pytest.mark.parametrize("name", ["half-perimeter", "overdraw", "expected-quads", "shape"])
def test_potentials_stand_in_for_exclusions(name):
    """Those of edges that are left stay as they are, and with the others all triangles hold."""
    excluded = 0
    for polygon in [*holed(), annulus(9, 1)]:
        _, found = proven(polygon, name)
        evidence = found.evidence()
        left = np.isin(np.arange(len(evidence.edges)), found.excluded, invert=True)
        assert (evidence.potentials[left] == found.potentials[left]).all()
        assert evidence.lift == found.lift
        excluded += len(found.excluded)
    assert excluded > 500


def test_where_potentials_cannot_be_extended_the_evidence_bounds_next_to_nothing(monkeypatch):
    polygon = holed()[0]
    outline, _ = posed(polygon)
    cost, found = proven(polygon)
    monkeypatch.setattr(proof, "extend", lambda *_: None)
    weak = certificate_of(outline, found.triangles, posed(polygon)[1], found.evidence())
    assert (weak.cost, weak.lower_bound, weak.proven) == (cost, 0.0, False)


def test_a_lift_is_not_made_worse():
    outline, cost = posed(annulus(14, 3), "overdraw")
    start = best_start(outline, cost)
    sight = sight_of(outline, start)
    units = units_for(outline, start, cost)
    c = candidates_of(sight, how_many(sight, proof.MOST))
    weights = weights_of(c.points, c.triangles, cost, units)
    order, alive = exclude(c, weights, cost, units)
    ahead = np.where(c.triangles < np.roll(c.triangles, -1, axis=1), 1, -1)
    rng = np.random.default_rng(0)
    for size in (0, 1, 10**6, 10**12):
        given = rng.integers(-size, size + 1, len(c.edges))
        slack = weights - (ahead * given[c.sides]).sum(axis=1)
        lift = min(int(slack[alive].min()), 0)
        found = extend(c, weights, order, given)
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
