import math
from fractions import Fraction

import numpy as np
import pytest
import shapely
from shapely import affinity

from tests.triangulators.cases import pose, record_calls, with_holes
from tests.triangulators.test_skeleton import annulus
from triangulators.certificate import proof
from triangulators.certificate.candidates import _list_triangles, _sample_holes, find_candidates
from triangulators.certificate.proof import LinearProgram, _find_candidate_indices, prove
from triangulators.checking.evidence import (
    compute_costs,
    compute_exact_total,
    compute_weights,
    find_units,
)
from triangulators.initial import find_best_initial

SQUARE = shapely.Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(2, 2), (2, 4), (5, 3)]])


def ring(monkeypatch, seed: int):
    """Return a polygon with a hole, a triangulation and the cost; exclusion is disabled."""

    def none(candidates, *_):
        return np.empty(0, np.int32), np.ones(len(candidates.triangles), np.bool_)

    monkeypatch.setattr(proof, "exclude_edges", none)
    outline, cost = pose(annulus(12, seed))
    return outline, find_best_initial(outline, cost), cost


def count_triples(outline, start) -> int:
    """Return the number of mutually visible triples: the smallest sufficient limit."""
    c = find_candidates(outline, start, 10**6)
    first = np.searchsorted(c.edges[:, 0], np.arange(len(c.points) + 1))
    return _list_triangles(c.points, first, c.edges, c.side, _sample_holes(outline), 10**6)[0]


def test_linear_program_is_solved_with_time_limit_or_if_small(monkeypatch):
    problem = ring(monkeypatch, 0)
    rows = count_triples(*problem[:2])
    tried = record_calls(monkeypatch, proof, "LinearProgram")

    def numbers(seconds: float, most: int) -> list[int]:
        tried.clear()
        monkeypatch.setattr(proof, "_MAX_UNTIMED_ROWS", most)
        gap = prove(*problem, seconds).gap
        assert (gap == 0.0) == bool(tried)
        return [len(program.inside) for _, program in tried]

    assert numbers(0.0, 10**6) == []
    assert numbers(np.inf, rows) == [rows]
    assert numbers(np.inf, rows - 1) == []
    assert numbers(1.0, 0) == [rows]


@pytest.mark.parametrize(
    ("seconds", "name"),
    [(60.0, "MAX_TRIPLES"), (0.0, "_MAX_UNTIMED_TRIPLES"), (np.inf, "_MAX_UNTIMED_TRIPLES")],
)
def test_too_many_triples_return_none(monkeypatch, seconds, name):
    problem = ring(monkeypatch, 0)
    rows = count_triples(*problem[:2])
    for most, is_there in ((rows, True), (rows - 1, False)):
        monkeypatch.setattr(proof, name, most)
        assert (prove(*problem, seconds) is not None) == is_there


def make_program(polygon, name):
    """Return candidates, their costs, and the indices of an initial solution."""
    outline, cost = pose(polygon, name)
    start = find_best_initial(outline, cost)
    c = find_candidates(outline, start, 10**6)
    return c, compute_costs(outline.points, c.triangles, cost), _find_candidate_indices(c, start)


@pytest.mark.parametrize("basic", [False, True])
def test_program_bound_equals_solution(basic):
    c, weights, start = make_program(with_holes(np.random.default_rng(3), 16, 2), "half-perimeter")
    program = LinearProgram(c, weights, np.ones(len(weights), np.bool_), start)
    potentials, share = program.solve(60.0, basic=basic)
    around = (program.signs * potentials[c.triangle_edges]).sum(axis=1)
    assert (around <= weights + 1e-9 * weights.max()).all()
    assert share @ weights == pytest.approx(c.side @ potentials, rel=1e-9)
    if basic:
        assert np.isclose(share, np.rint(share)).all()


@pytest.mark.parametrize("name", ["half-perimeter", "edge-length"])
def test_gap_within_rounding_is_zero(monkeypatch, name):
    """Costs that are not multiples of units lose less than one unit per triangle, of seven."""
    outline, cost = pose(SQUARE, name)
    result = prove(outline, find_best_initial(outline, cost), cost)
    units = find_units(outline, result.triangles, cost)
    weights = compute_weights(outline.points, result.triangles, cost, units)
    total = sum(weights.tolist())
    exact = compute_exact_total(outline, result.triangles, cost, units) * Fraction(units.scale)
    lost = exact - total // units.factor
    assert units.exact == (name == "half-perimeter") == (lost == 0)
    within = 0 if units.exact else math.ceil(7 - lost) - 1
    assert result.gap == 0.0
    for below, gap in ((within, 0.0), (within + 1, (within + 1) * units.factor / total)):
        bound = total - below * units.factor
        monkeypatch.setattr(proof._Search, "compute_bound", lambda *_, b=bound: b)
        assert prove(outline, result.triangles, cost).gap == gap


@pytest.mark.parametrize(("exponent", "proven"), [(-420, True), (-460, False)])
def test_coarse_units_prove_nothing(exponent, proven):
    """Areas near 2^-900 cost less than a unit each, so any bound would be tight."""
    size = 2.0**exponent
    small = affinity.scale(affinity.rotate(SQUARE, 10), size, size, origin=(0, 0))
    outline, cost = pose(small, "overdraw")
    result = prove(outline, find_best_initial(outline, cost), cost)
    assert (result.gap == 0.0) == proven


def test_local_search_updates_incumbent_of_candidates_only(monkeypatch):
    """Includes the candidate with index 0."""
    outline, cost = pose(shapely.box(0, 0, 9, 9))
    start = find_best_initial(outline, cost)
    units = find_units(outline, start, cost)
    candidates = find_candidates(outline, start, 10)
    triangles = candidates.triangles
    diagonals = ({0, 2}, {1, 3})
    common = [set(triangles[0].tolist()) & set(triangles[k].tolist()) for k in range(4)]
    first = [0, next(k for k in (1, 2, 3) if common[k] in diagonals)]
    weights = compute_weights(candidates.points, triangles, cost, units)
    alive, excluded = np.ones(4, np.bool_), np.empty(0, np.int32)
    search = proof._Search(outline, cost, units, candidates, weights, excluded, alive)
    monkeypatch.setattr(proof, "solve_skeleton", lambda *_: None)
    monkeypatch.setattr(proof, "optimise_along_random_trees", lambda *_: triangles[first])
    search.incumbent, search.min_weight = np.setdiff1d(range(4), first), np.inf
    search.solve(0.0)
    assert search.incumbent.tolist() == first
    search.min_weight = np.inf
    unknown = np.array([[0, 1, 5], [0, 2, 3]])
    monkeypatch.setattr(proof, "optimise_along_random_trees", lambda *_: unknown)
    search.solve(0.0)
    assert search.min_weight == np.inf


@pytest.mark.parametrize("size", [0.0, 1.0, 3e-9, 1e12])
def test_program_weights_are_scaled_for_solver(size):
    """The initial solution weighs 2^16 to 2^17; the penalty is twice its weight."""
    c, costs, numbers = make_program(SQUARE, "edge-length")
    weights = size * costs
    allowed = np.arange(len(weights)) % 3 > 0
    program = LinearProgram(c, weights, allowed, numbers)
    total = weights[numbers].sum()
    assert np.frexp(program.scale)[0] == 0.5
    assert 2.0**16 < total * program.scale <= 2.0**17 or size == 0.0 == program.scale - 1.0
    heavy = np.where(allowed, weights, weights + 2.0 * total)
    assert program.weights == pytest.approx(heavy * program.scale, rel=1e-12)
    assert program.free.sum() == len(c.edges) - len(c.points) + 1
