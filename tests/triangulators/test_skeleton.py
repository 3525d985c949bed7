"""The dynamic program over the LMT skeleton proves the optimum of the linear program."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely import affinity

from tests.triangulators.cases import (
    glyphs,
    pose,
    read_shared,
    record_calls,
    smooth,
    star,
    touching_polygons,
    with_holes,
)
from triangulators.certificate import proof
from triangulators.certificate.candidates import find_candidates
from triangulators.certificate.certify import make_certificate
from triangulators.certificate.local_minimality import exclude_edges, extend_potentials
from triangulators.certificate.proof import prove
from triangulators.certificate.skeleton import solve_skeleton
from triangulators.checking import checker
from triangulators.checking.edges import find_diagonals
from triangulators.checking.evidence import CertificateError, compute_weights, find_units
from triangulators.criteria.cost import replace_fields
from triangulators.geometry.half_edges import find_twins
from triangulators.geometry.visibility import find_visible_sites
from triangulators.initial import find_any_triangulation, find_best_initial
from triangulators.polygon import boundary


def solve(polygon, name="half-perimeter"):
    outline, cost = pose(polygon, name)
    solution = prove(outline, find_best_initial(outline, cost), cost)
    solution = prove(outline, solution.triangles, cost)  # evidence for the triangulation found
    certificate = make_certificate(outline, solution.triangles, cost, solution.make_evidence())
    assert certificate.proven, polygon.wkt
    return certificate.cost, solution


def annulus(n: int, seed: int) -> shapely.Polygon:
    """Return a ring with many locally minimal diagonals: almost none can be excluded."""
    rng = np.random.default_rng(seed)
    rings = []
    for radius in (100, 70):
        turn = 2 * np.pi * (np.arange(n) + rng.uniform(-0.3, 0.3, n)) / n
        rings.append(np.rint(radius * np.column_stack([np.cos(turn), np.sin(turn)]) * 256) / 256)
    return shapely.Polygon(rings[0], [rings[1]])


def holed() -> list[shapely.Polygon]:
    rng = np.random.default_rng(4)
    polygons = [with_holes(rng, 8, int(rng.integers(1, 5))) for _ in range(25)]
    return polygons + [polygon for _, polygon in glyphs("B8%&") if polygon.interiors]


@pytest.mark.parametrize("name", ["half-perimeter", "overdraw", "expected-quads", "shape"])
def test_dynamic_and_linear_programs_have_equal_optimum(monkeypatch, name):
    by_table = [solve(polygon, name) for polygon in holed()]
    monkeypatch.setattr(proof, "solve_skeleton", lambda *_: None)
    for polygon, (cost, _) in zip(holed(), by_table, strict=True):
        assert solve(polygon, name)[0] == pytest.approx(cost, rel=1e-12), polygon.wkt


@pytest.mark.parametrize("sign", [1, -1])
def test_no_triangulation_gives_none(monkeypatch, sign):
    """Also with negative weights."""
    calls = record_calls(monkeypatch, proof, "solve_skeleton")
    for polygon in holed()[:8]:
        solve(polygon, "half-perimeter")
    assert len(calls) >= 8
    for (candidates, alive, cost, units), result in calls:
        assert result is not None
        last = np.flatnonzero(candidates.side)[-1]
        bare = candidates.triangle_edges[(candidates.triangle_edges == last).any(axis=1)]
        # Without triangles of the diagonals that make one at a side of the boundary.
        gone = np.isin(candidates.triangle_edges, bare[candidates.side[bare] == 0]).any(axis=1)
        signed = replace_fields(cost, weights=sign * cost["weights"])
        assert solve_skeleton(candidates, alive & ~gone, signed, units) is None


def test_overflowing_potentials_give_trivial_bound(monkeypatch):
    polygon = holed()[0]
    outline, cost = pose(polygon)
    total, solution = solve(polygon)
    monkeypatch.setattr(proof, "extend_potentials", lambda *_: None)
    weak = make_certificate(outline, solution.triangles, cost, solution.make_evidence())
    assert (weak.cost, weak.lower_bound, weak.proven) == (total, 0.0, False)


def exclude(polygon, name="half-perimeter"):
    """Return the candidates, their weights, the excluded edges and whether triangles remain."""
    outline, cost = pose(polygon, name)
    start = find_best_initial(outline, cost)
    units = find_units(outline, start, cost)
    c = find_candidates(outline, start, proof.MAX_TRIPLES)
    weights = compute_weights(c.points, c.triangles, cost, units)
    return c, weights, *exclude_edges(c, weights, cost, units)


def test_exclusion_is_scale_invariant():
    """At a scale of 2^-20 orientations are far below 1."""
    polygon = holed()[0]
    small = affinity.scale(polygon, 2.0**-20, 2.0**-20, origin=(0, 0))
    exclusions = [exclude(shape)[2] for shape in (polygon, small)]
    assert len(exclusions[0])
    assert np.array_equal(*exclusions)


def test_extension_preserves_lift():
    c, weights, order, alive = exclude(annulus(14, 3), "overdraw")
    ahead = np.where(c.triangles < np.roll(c.triangles, -1, axis=1), 1, -1)
    rng = np.random.default_rng(0)
    for size in (0, 1, 10**6, 10**12):
        potentials = rng.integers(-size, size + 1, len(c.edges))
        slack = weights - (ahead * potentials[c.triangle_edges]).sum(axis=1)
        lift = min(int(slack[alive].min()), 0)
        extended = extend_potentials(c, weights, order, potentials)
        slack = weights - (ahead * extended[c.triangle_edges]).sum(axis=1)
        assert int(slack.min()) >= lift
        assert (np.delete(extended, order) == np.delete(potentials, order)).all()


def comb(teeth: int) -> shapely.Polygon:
    """Teeth that hide each other: long edges block most pairs."""
    x = np.repeat(np.arange(teeth) * 4.0, 2)
    shape = np.column_stack([x, np.tile([60.0, 2.0], teeth)])
    return shapely.Polygon([(-3.0, 0.0), (4.0 * teeth, 0.0), *shape[::-1].tolist()])


def sieve(seed: int) -> shapely.Polygon:
    """A smooth outline with a hundred triangular holes."""
    rng, shell = np.random.default_rng(seed), smooth(200)
    low_x, low_y, high_x, high_y = shell.bounds
    size = min(high_x - low_x, high_y - low_y) / 16
    x, y = np.meshgrid(np.arange(low_x, high_x, size), np.arange(low_y, high_y, size))
    corners = rng.uniform(0.1, 0.9, (x.size, 3, 2)) * size + np.stack((x, y), -1).reshape(-1, 1, 2)
    holes = shapely.polygons(np.rint(corners * 256) / 256)
    holes = holes[(shapely.area(holes) > 0.01 * size**2) & shapely.contains_properly(shell, holes)]
    return shell.difference(shapely.union_all(holes))


def test_search_and_checker_find_equal_edges():
    """Also of rings that touch, and at a small scale."""
    polygons = [star(700, spread=0.5), smooth(900), comb(20), comb(150), sieve(0), sieve(1)]
    polygons += [polygon for _, polygon in read_shared("helsinki.json")[::60]]
    polygons += [*touching_polygons(5, 150), *touching_polygons(6, 60)]
    polygons += [with_holes(np.random.default_rng(4), 30, 4), annulus(12, 2)]
    many = 0
    for polygon in polygons:
        outline = boundary(polygon)
        start = find_any_triangulation(outline)
        visible = find_visible_sites(outline.points, start, find_twins(start)).tolist()
        sides = np.sort(outline.edges, axis=1).tolist()
        diagonals = np.sort(find_diagonals(outline), axis=1).tolist()
        found = set(map(tuple, diagonals))
        assert len(found) == len(diagonals)
        assert found == {*map(tuple, visible)} - {*map(tuple, sides)}, polygon.wkt
        small = boundary(shapely.transform(polygon, lambda points: points * 2.0**-14))
        assert np.sort(find_diagonals(small), axis=1).tolist() == diagonals
        many += len(diagonals)
    assert many > 20_000


def test_checker_threads_agree(monkeypatch):
    polygon = star(300)
    outline, cost = pose(polygon)
    start = find_best_initial(outline, cost)
    evidence = proof.prove(outline, start, cost).make_evidence()
    bound = checker.compute_lower_bound(outline, start, cost, evidence)
    monkeypatch.setattr(checker, "_MAX_SINGLE_THREAD_EDGES", 0)
    assert checker.compute_lower_bound(outline, start, cost, evidence) == bound
    more = replace(evidence, lift=evidence.lift + 1)
    with pytest.raises(CertificateError, match="potentials exceed"):
        checker.compute_lower_bound(outline, start, cost, more)
