"""Certificates against exhaustive lists of triangulations, and rejected evidence."""

from dataclasses import replace
from fractions import Fraction
from itertools import combinations
from types import SimpleNamespace

import numba
import numpy as np
import pytest
import shapely

from harness.export import check_evidence
from tests.endurance.brute_force import SmallPolygon
from tests.triangulators.cases import glyphs, pose, random_simple, read_shared, star, with_holes
from tests.triangulators.test_skeleton import annulus
from triangulators import (
    TriangulationError,
    certify,
    criteria,
    triangulate,
    triangulate_with_gap,
    vertices,
)
from triangulators.certificate.certify import _round_down, make_certificate
from triangulators.certificate.proof import prove
from triangulators.checking.checker import _check_potentials
from triangulators.checking.edges import find_edges
from triangulators.checking.evidence import (
    TOO_LARGE,
    CertificateError,
    Units,
    _count_binary_places,
    compute_costs,
    compute_noise,
    compute_weight,
    compute_weight_factor,
    compute_weights,
    find_exact_scale,
    find_units,
    has_exact_sums,
)
from triangulators.criteria.cost import make_cost, replace_fields
from triangulators.criteria.criterion import FEATURES
from triangulators.initial import find_best_initial
from triangulators.polygon import boundary
from triangulators.verify import verify

SQUARE = shapely.Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(2, 2), (2, 4), (5, 3)]])
INTEGER_CRITERIA = ("half-perimeter", "overdraw")
REAL_CRITERIA = ("edge-length", "expected-quads", "shape")


@numba.njit
def scrambled(ax, ay, bx, by, cx, cy):
    """A pseudo-random cost, so that the linear program's solution may be fractional."""
    x, y = ax * bx * cx + 17.0 * (ax + bx + cx), ay * by * cy + 31.0 * (ay + by + cy)
    return (abs(43758.5453 * np.sin(12.9898 * x + 78.233 * y)) % 1.0) ** 3


# One of three, of 1,880 random rings, for which the linear program has a fractional optimum.
FRACTIONAL_RING = shapely.from_wkt(
    "POLYGON ((-13 -99, -66 -75, -68 -74, -93 -38, -100 2, -32 95, 3 100, 73 68, 93 36, 100 1,"
    " 100 -9, 70 -71, 31 -95, -13 -99), (-4 -30, -22 -21, 27 -13, 24 -19, 21 -22, 2 -30, -4 -30))"
)


@numba.njit
def in_debt(ax, ay, bx, by, cx, cy):
    """The negative half-perimeter, whose optimum has the longest diagonals."""
    return -(max(ax, bx, cx) - min(ax, bx, cx)) - (max(ay, by, cy) - min(ay, by, cy))


def solve(polygon, name="half-perimeter"):
    best = triangulate(polygon, "optimal", criterion=name)
    return best, certify(polygon, best, name)


@pytest.mark.parametrize("name", [*INTEGER_CRITERIA, *REAL_CRITERIA, in_debt])
def test_proven_optimum_is_minimum_over_all_triangulations(name):
    rng = np.random.default_rng(len(name) if isinstance(name, str) else 5)
    criterion = criteria.find(name)

    def cost(corners):
        return criterion.total(np.array(corners), np.array([[0, 1, 2]], np.int32))

    for _ in range(40):
        polygon = with_holes(rng, int(rng.integers(4, 7)), int(rng.integers(1, 4)))
        rings = [list(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
        minimum = float(SmallPolygon(rings).optimum(cost)[0])
        best, certificate = solve(polygon, name)
        assert verify(polygon, best).conforming
        assert certificate.proven, polygon.wkt
        assert certificate.cost == pytest.approx(minimum, rel=1e-12), polygon.wkt
        assert certificate.lower_bound <= minimum + 1e-12 * abs(minimum)
        if name in INTEGER_CRITERIA:
            assert certificate.gap == 0.0
        assert certificate.gap < 1e-8


def test_fractional_program_gives_bound_without_proof():
    _, certificate = solve(FRACTIONAL_RING, scrambled)
    assert not certificate.proven
    assert 0.0 < certificate.gap < 0.2
    for name in ("delaunay", "greedy"):
        triangles = triangulate(FRACTIONAL_RING, name)
        total = criteria.find(scrambled).total(vertices(FRACTIONAL_RING), triangles)
        assert certificate.lower_bound <= total


def test_dynamic_and_linear_programs_agree_without_holes():
    rng = np.random.default_rng(8)
    for number in range(40):
        polygon = random_simple(rng, int(rng.integers(5, 40)), 60)
        name = (*INTEGER_CRITERIA, *REAL_CRITERIA)[number % 5]
        outline, cost = pose(polygon, name)
        proof = prove(outline, find_best_initial(outline, cost), cost)
        best = triangulate(polygon, "optimal", criterion=name)
        totals = [criteria.find(name).total(outline.points, t) for t in (proof.triangles, best)]
        assert totals[0] == pytest.approx(totals[1], rel=1e-12)
        assert certify(polygon, best, name).proven
        assert certify(polygon, proof.triangles, name).proven


def test_real_polygons_with_holes_are_proven():
    polygons = [p for _, p in glyphs("ABDg8&%") if p.interiors]
    polygons += [p for _, p in read_shared("helsinki.json") if p.is_valid and p.interiors][:24]
    polygons += [annulus(12, 3), shapely.affinity.scale(annulus(9, 1), -1.0, 1.0)]
    assert len(polygons) > 26
    for polygon in polygons:
        for name in ("half-perimeter", "overdraw", "expected-quads"):
            best, gap = triangulate_with_gap(polygon, "optimal", criterion=name)
            assert gap == 0.0, (name, polygon.wkt)
            assert certify(polygon, best, name).proven, (name, polygon.wkt)
        other = certify(polygon, triangulate(polygon, "ear-clipping", repair=True))
        assert other.lower_bound <= other.cost
        assert other.gap == (other.cost - other.lower_bound) / other.cost


def test_worse_triangulations_are_not_proven():
    polygon = star(60, spread=0.4)
    best, worst = (triangulate(polygon, f"{way}:half-perimeter") for way in ("optimal", "worst"))
    total = criteria.find("half-perimeter").total
    certificate = certify(polygon, worst)
    assert not certificate.proven
    assert certificate.lower_bound == total(vertices(polygon), best)
    holed = shapely.Polygon(star(40).exterior, [[(500, 500), (530, 520), (510, 540)]])
    worst = certify(holed, triangulate(holed, "worst:half-perimeter"))
    assert not worst.proven
    assert worst.lower_bound == solve(holed)[1].cost < worst.cost


def test_triangulations_that_cannot_be_certified():
    best = triangulate(SQUARE, "optimal:half-perimeter")
    with pytest.raises(TriangulationError, match="not a conforming triangulation"):
        certify(SQUARE, best[1:])
    dropped = shapely.Polygon([(0, 0), (4, 0), (8, 0), (8, 8), (0, 8)])
    with pytest.raises(TriangulationError, match="T-junction"):
        certify(dropped, np.array([[0, 2, 3], [0, 3, 4]]))


@pytest.mark.parametrize(
    ("field", "change", "message"),
    [
        ("scale", lambda _: 1e-300, "scale, factor and bits are"),
        ("factor", lambda _: 4, "scale, factor and bits are"),
        ("lift", lambda _: 2**60, "too large"),
        ("lift", lambda _: -(2**60), "too large"),
        ("lift", lambda _: 2**70, "too large"),
        ("lift", lambda _: np.int64(2**60), "too large"),
        ("lift", lambda lift: lift + (1 << 40), "potentials exceed"),
        ("edges", lambda edges: np.where(edges == 0, edges.max() + 1, edges), "out of range"),
        ("edges", lambda edges: np.vstack([edges[1], edges[1:]]), "an edge is repeated"),
    ],
)
def test_rejects_changed_evidence(field, change, message):
    polygon = shapely.Polygon(star(30).exterior, [[(480, 500), (530, 520), (510, 560)]])
    best, certificate = solve(polygon)
    outline, cost = pose(polygon)
    evidence = certificate.evidence
    assert make_certificate(outline, best, cost, evidence) == certificate
    changed = replace(evidence, **{field: change(getattr(evidence, field))})
    with pytest.raises(CertificateError, match=message):
        make_certificate(outline, best, cost, changed)


@pytest.mark.parametrize("bits", range(11))
def test_edge_noise_takes_all_values_and_equals_independent_checker(bits):
    """Symmetric in the ends, and zero without bits."""
    plain, values = SimpleNamespace(bits=bits), set()
    for a, b in combinations((*range(80), 10**6), 2):
        values.add(int(compute_noise(a, b, bits)))
        assert compute_noise(a, b, bits) == compute_noise(b, a, bits)
        assert compute_noise(a, b, bits) == check_evidence.Claim.compute_noise(plain, a, b)
    assert values <= set(range(2**bits))
    assert len(values) >= 0.9 * 2**bits


@numba.njit
def of_first_corner(ax, ay, bx, by, cx, cy):
    """A cost that depends on the first vertex."""
    return ax + 0.25 * bx - 0.5 * cy + 100.0


@pytest.mark.parametrize("name", ["half-perimeter", "edge-length", of_first_corner])
@pytest.mark.parametrize("bits", [0, 1, 10])
@pytest.mark.parametrize("scale", [4.0, 2.0**50])
def test_weights_equal_definition_for_any_first_vertex(name, bits, scale):
    rng = np.random.default_rng(bits)
    points = rng.integers(-50, 50, (20, 2)).astype(float)
    triangles = np.array([rng.permutation(20)[:3] for _ in range(60)], np.int32)
    cost = make_cost(criteria.find(name), 1.0, 18)
    units = Units(scale, compute_weight_factor(18, bits), bits, True, False)
    weights = compute_weights(points, triangles, cost, units)
    for turned in range(3):
        own = compute_weights(points, np.roll(triangles, turned, 1), cost, units)
        assert np.array_equal(own, weights)
    if name is not of_first_corner:
        return
    most = 2**59 // units.factor
    first = np.array([np.roll(row, -np.argmin(row)) for row in triangles])
    for row, expected_weight in zip(first, weights.tolist(), strict=True):
        one = of_first_corner(*points[row].ravel())
        own = sum(int(compute_noise(row[k], row[k - 1], bits)) for k in range(3))
        assert expected_weight == units.factor * int(min(np.floor(one * scale), most)) + own


def weighing(**weights: float):
    """Return a cost with these weights of features."""
    cost = make_cost(criteria.find("half-perimeter"), 1.0, 1)
    return replace_fields(cost, weights=np.array([weights.get(name, 0.0) for name in FEATURES]))


def boxes(around: float = 0.0, box: float = 0.0):
    return weighing(half_perimeter=around, bbox_area=box)


def test_weight_range_is_symmetric():
    points = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    units = Units(1.0, compute_weight_factor(1, 10), 10, True, False)
    limit = 2**59 // units.factor
    zero_weight = compute_weight(points, 0, 1, 2, weighing(triangles=0.0), units)
    assert 0 < zero_weight < units.factor
    for value in (-limit, limit):
        clamped = compute_weight(points, 0, 1, 2, weighing(triangles=value), units)
        assert clamped == value * units.factor + zero_weight
    assert compute_weight(points, 0, 1, 2, weighing(triangles=-limit - 1.0), units) >= TOO_LARGE
    assert compute_weight(points, 0, 1, 2, weighing(triangles=np.nan), units) >= TOO_LARGE


def test_weight_nan_proves_nothing():
    edges = find_edges(boundary(SQUARE))
    units = Units(1.0, compute_weight_factor(7, 10), 10, True, False)
    none = np.zeros(len(edges.ends), np.int64)
    with pytest.raises(CertificateError, match="cost is NaN"):
        _check_potentials(edges, none, 0, weighing(triangles=np.nan), units)
    _check_potentials(edges, none, 0, weighing(triangles=1.0), units)


def outlined(points, count=1, holes=0):
    return SimpleNamespace(points=points, expected_triangles=count, holes=holes, edges=range(4))


TRIANGLE = np.array([[0, 1, 2]], np.int32)


@pytest.mark.parametrize("count", [1, 30, 4000, 10**5, 2 * 10**5, 10**6, 10**7])
def test_units_of_real_costs_are_fine_and_leave_noise_bits(count):
    """Of 2^-36 to 2^-32 of the total; noise has as many bits as fit, ten at most."""
    for total in (0.75, 1.5, 1.1e-7, 3.3e9):
        points = np.array([(0.0, 0.0), (total / 2, 0.0), (0.0, 0.0)])
        cost = make_cost(criteria.find("edge-length"), 1.0, 1)
        triangle_cost = float(compute_costs(points, TRIANGLE, cost)[0])
        units = find_units(outlined(points, count), TRIANGLE, cost)
        assert 2.0**32 <= triangle_cost * units.scale < 2.0**36
        assert np.log2(units.scale) % 4 == 0
        assert (units.exact, units.real) == (False, True)
        assert units.factor == compute_weight_factor(count, units.bits)
        assert units.factor << 38 < 2**61
        more = units.bits + 1 if units.bits else 2
        assert units.bits == 10 or compute_weight_factor(count, more) << 38 >= 2**61
    assert units.bits != 1


@pytest.mark.parametrize(("total", "scale"), [(0.0, 1.0), (1e-300, 2.0**900), (1e300, 2.0**-900)])
def test_units_of_extreme_costs_are_finite(total, scale):
    points = np.array([(0.0, 0.0), (total, 0.0), (0.0, 0.0)])
    # No squares, which would leave the range of doubles; not whole, so that costs are real.
    assert find_units(outlined(points), TRIANGLE, boxes(1.5)).scale == scale


def test_exact_weights_of_four_triangulations_fit_with_noise():
    rng = np.random.default_rng(3)
    cost = make_cost(criteria.find("half-perimeter"), 1.0, 1)
    for size in 2.0 ** rng.uniform(0, 50, 60):
        points = np.rint(np.array([(0.0, 0.0), (size, 0.0), (0.0, size)]))
        count = int(rng.integers(1, 10**4))
        units = find_units(outlined(points, count, holes=1), TRIANGLE, cost)
        assert (units.exact, units.real) == (True, False)
        total = int(compute_costs(points, TRIANGLE, cost)[0] * units.scale)
        assert 4 * total * units.factor < 2**61
        more = units.bits + 1 if units.bits else 2
        assert units.bits == 10 or 4 * total * compute_weight_factor(count, more) >= 2**61


@pytest.mark.parametrize("bits", range(11))
def test_unit_exceeds_noise_of_all_triangles(bits):
    for count in (1, 2, 5, 1000):
        factor = compute_weight_factor(count, bits)
        assert factor.bit_count() == 1
        assert 3 * count * (2**bits - 1) < factor <= max(1, 6 * count * 2**bits)


@pytest.mark.parametrize(
    ("values", "places"),
    [([0.5], 1), ([3.0, 4.0], 0), ([4.0, -8.0], -2), ([3 / 1024, 7.0], 10), ([0.0], -16)],
)
def test_binary_places_follow_finest_coordinate(values, places):
    assert _count_binary_places(np.array(values)) == places


def test_four_times_total_stays_below_limit():
    """Of 2^k and one unit less, the larger leaves a bit less for noise."""
    factor = compute_weight_factor(1, 10)
    side = 2.0**58 / factor
    for total, bits in ((2 * side, 9), (2 * side - 1, 10)):
        points = np.array([(0.0, 0.0), (side, 0.0), (0.0, total - side)])
        units = find_units(outlined(points, holes=1), TRIANGLE, boxes(1.0))
        assert (units.scale, units.exact, units.bits) == (1.0, True, bits)
        assert (4 * int(total) * factor < 2**61) == (bits == 10)


@pytest.mark.parametrize(
    ("side", "cost", "scale", "most"),
    [
        (7.0, boxes(1.0), 1.0, 14.0),
        (7.25, boxes(1.0), 4.0, 2 * 29.0),
        (7.0, boxes(0.0, 1.0), 2.0, 2 * 49.0),
        (7.25, boxes(0.0, 3.0), 32.0, 3 * 2 * 29.0**2),
        (7.0, boxes(1024.0), 1.0, 1024 * 14.0),
        (7.0, boxes(1025.0), 0.0, np.inf),
        (7.0, boxes(1.5), 0.0, np.inf),
        (7.0, boxes(1.0, 0.5), 0.0, np.inf),
        (2.0**25 - 1, boxes(0.0, 1.0), 2.0, 2 * (2.0**25 - 1) ** 2),
        (2.0**25 + 1, boxes(0.0, 1.0), 0.0, 2 * (2.0**25 + 1) ** 2),
        (2.0**51 - 1, boxes(1.0), 1.0, 2.0**52 - 2),
        (2.0**51 + 1, boxes(1.0), 0.0, 2.0**52 + 2),
        (7.0, weighing(triangles=1, area=-1, half_perimeter=2, bbox_area=3), 2.0, 7 * 2 * 49.0),
    ],
)
def test_integer_costs_have_units_if_doubles_are_exact(side, cost, scale, most):
    points = np.array([(16.0, 0.0), (16.0 + side, 0.0), (16.0, side)])
    scale_of_units, is_integer, units = find_exact_scale(points, cost)
    assert (scale_of_units, units) == (scale, most)
    assert is_integer == (side % 1 == 0 and most < np.inf)


def test_has_exact_sums_up_to_2_52():
    points = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    assert has_exact_sums(outlined(points, 2**51 - 1), boxes(1.0))
    assert not has_exact_sums(outlined(points, 2**51), boxes(1.0))
    assert not has_exact_sums(outlined(points), boxes(1.5))
    assert not has_exact_sums(outlined((2.0**25 + 1) * points), boxes(0.0, 1.0))


def test_dynamic_program_proves_up_to_its_limit(monkeypatch):
    monkeypatch.setattr("triangulators.certificate.certify.MAX_RING_VERTICES", 4)
    monkeypatch.setattr("triangulators.certificate.certify.prove", lambda *_: None)
    four = shapely.box(0, 0, 9, 4)
    five = shapely.Polygon([(0, 0), (9, 0), (9, 4), (4, 6), (0, 4)])
    assert certify(four, triangulate(four, "optimal:half-perimeter")).proven
    assert not certify(five, triangulate(five, "optimal:half-perimeter")).proven


def test_certificate_without_bound_has_cost(monkeypatch):
    monkeypatch.setattr("triangulators.certificate.certify.prove", lambda *_: None)
    best = triangulate(SQUARE, "optimal:half-perimeter")
    certificate = certify(SQUARE, best)
    assert not certificate.proven
    assert (certificate.lower_bound, certificate.gap) == (-np.inf, np.inf)
    assert certificate.cost == np.ptp(vertices(SQUARE)[best], axis=1).sum()


@pytest.mark.parametrize("value", [Fraction(1, 3), Fraction(2, 3), Fraction(-1, 3), Fraction(5)])
def test_round_down_changes_at_most_one_step(value):
    low = _round_down(value)
    assert Fraction(low) <= value < Fraction(np.nextafter(low, np.inf))
