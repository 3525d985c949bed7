"""The search for a proof: what is tried, within which limits, and what its gap says."""

import math
from fractions import Fraction

import numpy as np
import pytest
import shapely
from shapely import affinity

from tests.triangulators.cases import with_holes
from tests.triangulators.test_skeleton import annulus, posed
from triangulators import criteria
from triangulators.certificate import proof
from triangulators.certificate.candidates import _list, _ring_samples, candidates_of
from triangulators.certificate.linear_program import Program
from triangulators.certificate.proof import _numbers, prove
from triangulators.checking.units import costs_of, exact_total, units_for, weights_of
from triangulators.criteria.cost import cost_of
from triangulators.initial import best_initial
from triangulators.polygon import boundary

SQUARE = shapely.Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(2, 2), (2, 4), (5, 3)]])


def noted(monkeypatch, place, name: str) -> list:
    """Return a list that gets (what is given, what comes back) of each call of a function."""
    real, calls = getattr(place, name), []

    def call(*given):
        calls.append((given, real(*given)))
        return calls[-1][1]

    monkeypatch.setattr(place, name, call)
    return calls


def ring(monkeypatch, seed: int):
    """Return a polygon with a hole, a triangulation and the cost; nothing will be excluded."""

    def none(candidates, *_):
        return np.empty(0, np.int32), np.ones(len(candidates.triangles), np.bool_)

    monkeypatch.setattr(proof, "exclude", none)
    outline, cost = posed(annulus(12, seed))
    return outline, best_initial(outline, cost), cost


def rooms(outline, start) -> int:
    """Return how many triples see each other: the least limit under which they are listed."""
    c = candidates_of(outline, start, 10**6)
    first = np.searchsorted(c.edges[:, 0], np.arange(len(c.points) + 1))
    return _list(c.points, first, c.edges, c.side, _ring_samples(outline), 10**6)[0]


def test_a_program_is_tried_where_it_has_time_or_is_small(monkeypatch):
    given = ring(monkeypatch, 0)
    rows = rooms(*given[:2])
    tried = noted(monkeypatch, proof, "Program")

    def numbers(seconds: float, most: int) -> list[int]:
        tried.clear()
        monkeypatch.setattr(proof, "_QUICK_ROWS", most)
        gap = prove(*given, seconds).gap
        assert (gap == 0.0) == bool(tried)
        return [len(found.inside) for _, found in tried]

    assert numbers(0.0, 10**6) == []
    assert numbers(np.inf, rows) == [rows]
    assert numbers(np.inf, rows - 1) == []
    assert numbers(1.0, 0) == [rows]


@pytest.mark.parametrize(("seconds", "name"), [(60.0, "MOST"), (0.0, "_QUICK"), (np.inf, "_QUICK")])
def test_too_many_candidates_are_not_looked_at(monkeypatch, seconds, name):
    given = ring(monkeypatch, 0)
    rows = rooms(*given[:2])
    for most, is_there in ((rows, True), (rows - 1, False)):
        monkeypatch.setattr(proof, name, most)
        assert (prove(*given, seconds) is not None) == is_there


@pytest.mark.parametrize("at_a_corner", [False, True])
def test_a_programs_bound_is_that_of_its_solution(at_a_corner):
    polygon = with_holes(np.random.default_rng(3), 16, 2)
    outline = boundary(polygon)
    cost = cost_of(criteria.find("half-perimeter"), 1.0, outline.expected_triangles)
    start = best_initial(outline, cost)
    c = candidates_of(outline, start, 10**6)
    weights = costs_of(outline.points, c.triangles, cost)
    program = Program(c, weights, np.ones(len(weights), np.bool_), _numbers(c, start))
    potentials, share = program.solve(60.0, at_a_corner=at_a_corner)
    around = (program.signs * potentials[c.sides]).sum(axis=1)
    assert (around <= weights + 1e-9 * weights.max()).all()
    assert share @ weights == pytest.approx(c.side @ potentials, rel=1e-9)
    if at_a_corner:
        assert np.isclose(share, np.rint(share)).all()


@pytest.mark.parametrize("name", ["half-perimeter", "edge-length"])
def test_the_gap_of_a_proof_is_0_where_rounding_explains_it(monkeypatch, name):
    """Where costs are no numbers of units, seven triangles of the optimum lose less than seven."""
    outline = boundary(SQUARE)
    cost = cost_of(criteria.find(name), 1.0, outline.expected_triangles)
    start = best_initial(outline, cost)
    found = prove(outline, start, cost)
    units = units_for(outline, found.triangles, cost)
    weights = weights_of(outline.points, found.triangles, cost, units)
    total = sum(weights.tolist())
    exact = exact_total(outline, found.triangles, cost, units) * Fraction(units.scale)
    lost = exact - total // units.factor
    assert units.exact == (name == "half-perimeter") == (lost == 0)
    within = 0 if units.exact else math.ceil(7 - lost) - 1
    assert found.gap == 0.0
    for below, gap in ((within, 0.0), (within + 1, (within + 1) * units.factor / total)):
        bound = total - below * units.factor
        monkeypatch.setattr(proof._Search, "bound", lambda *_, b=bound: b)
        assert prove(outline, found.triangles, cost).gap == gap


@pytest.mark.parametrize(("exponent", "proven"), [(-420, True), (-460, False)])
def test_units_that_are_too_coarse_prove_nothing(exponent, proven):
    """Areas near 2^-900 cost less than a unit each, so that any bound would meet them."""
    size = 2.0**exponent
    small = affinity.scale(affinity.rotate(SQUARE, 10), size, size, origin=(0, 0))
    outline = boundary(small)
    cost = cost_of(criteria.find("overdraw"), small.area, outline.expected_triangles)
    found = prove(outline, best_initial(outline, cost), cost)
    assert (found.gap == 0.0) == proven


def test_what_the_local_search_finds_is_kept_where_all_of_it_are_candidates(monkeypatch):
    """The candidate of number 0, too."""
    outline = boundary(shapely.box(0, 0, 9, 9))
    cost = cost_of(criteria.find("half-perimeter"), 1.0, 2)
    start = best_initial(outline, cost)
    units = units_for(outline, start, cost)
    candidates = candidates_of(outline, start, 10)
    triangles = candidates.triangles
    diagonals = ({0, 2}, {1, 3})
    common = [set(triangles[0].tolist()) & set(triangles[k].tolist()) for k in range(4)]
    first = [0, next(k for k in (1, 2, 3) if common[k] in diagonals)]
    weights = weights_of(candidates.points, triangles, cost, units)
    search = proof._Search(candidates, weights, units)
    monkeypatch.setattr(proof, "by_table", lambda *_: None)
    monkeypatch.setattr(proof, "search_cuts", lambda *_: triangles[first])
    search.best, search.least = np.setdiff1d(range(4), first), np.inf
    search.solve(np.ones(4, np.bool_), cost, 0.0)
    assert search.best.tolist() == first
    search.least = np.inf
    monkeypatch.setattr(proof, "search_cuts", lambda *_: np.array([[0, 1, 5], [0, 2, 3]]))
    search.solve(np.ones(4, np.bool_), cost, 0.0)
    assert search.least == np.inf


@pytest.mark.parametrize("size", [0.0, 1.0, 3e-9, 1e12])
def test_a_programs_weights_are_of_a_size_that_suits_the_solver(size):
    """The start's add up to 2^16 to 2^17; what is not allowed weighs twice the start more."""
    outline = boundary(SQUARE)
    cost = cost_of(criteria.find("edge-length"), 1.0, outline.expected_triangles)
    start = best_initial(outline, cost)
    c = candidates_of(outline, start, 10**6)
    weights, numbers = size * costs_of(outline.points, c.triangles, cost), _numbers(c, start)
    allowed = np.arange(len(weights)) % 3 > 0
    program = Program(c, weights, allowed, numbers)
    total = weights[numbers].sum()
    assert np.frexp(program.scale)[0] == 0.5
    assert 2.0**16 < total * program.scale <= 2.0**17 or size == 0.0 == program.scale - 1.0
    heavy = np.where(allowed, weights, weights + 2.0 * total)
    assert program.weights == pytest.approx(heavy * program.scale, rel=1e-12)
    assert program.free.sum() == len(c.edges) - len(c.points) + 1


def test_triangles_have_their_numbers_among_the_candidates(monkeypatch):
    """Every one, whichever corner is first; what is beyond the last has none."""
    outline, start, _ = ring(monkeypatch, 0)
    c = candidates_of(outline, start, 10**6)
    numbers = np.arange(len(c.triangles))
    for turned in range(3):
        assert np.array_equal(_numbers(c, np.roll(c.triangles, turned, axis=1)), numbers)
    n = len(c.points)
    assert _numbers(c, np.array([[n - 3, n - 2, n], [0, 0, 1]])).tolist() == [-1, -1]
