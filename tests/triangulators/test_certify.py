"""Certificates: what they claim against every triangulation listed, and what is refused."""

from dataclasses import replace
from fractions import Fraction
from itertools import combinations, permutations
from types import SimpleNamespace

import numba
import numpy as np
import pytest
import shapely

from harness.export import check_evidence
from tests.endurance.brute_force import Small
from tests.triangulators.cases import (
    glyphs,
    random_simple,
    shared,
    star,
    with_holes,
)
from triangulators import TriangulationError, certify, criteria, triangulate, vertices
from triangulators.certificate.certify import _down, certificate_of
from triangulators.certificate.proof import prove
from triangulators.checking.checker import _check_potentials
from triangulators.checking.edges import edges_of
from triangulators.checking.evidence import CertificateError
from triangulators.checking.units import (
    TOO_LARGE,
    Units,
    _binary_places,
    costs_of,
    doubles_add_up,
    factor_for,
    lowest_first,
    noise,
    units_for,
    weight,
    weights_of,
    whole_scale,
)
from triangulators.criteria.cost import (
    BBOX_AREA,
    HALF_PERIMETER,
    TRIANGLES,
    cost_of,
    with_fields,
)
from triangulators.initial import best_initial
from triangulators.polygon import boundary, boundary_area
from triangulators.verify import verify

SQUARE = shapely.Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(2, 2), (2, 4), (5, 3)]])
WHOLE = ("half-perimeter", "overdraw")
ROUNDED = ("edge-length", "expected-quads", "shape")


@numba.njit
def scrambled(ax, ay, bx, by, cx, cy):
    """A cost without rhyme or reason, so that the program's solution need not be whole."""
    x, y = ax * bx * cx + 17.0 * (ax + bx + cx), ay * by * cy + 31.0 * (ay + by + cy)
    return (abs(43758.5453 * np.sin(12.9898 * x + 78.233 * y)) % 1.0) ** 3


HALVES = (  # found by chance: three of 1,880 rings for which half triangles would do better
    "POLYGON ((1 -100, -43 -90, -50 -87, -57 -82, -99 10, -99 14, -59 81, -45 89, -8 100, -7 100,"
    " 43 90, 100 -9, 79 -62, 58 -82, 48 -88, 1 -100), (-5 -30, -24 -18, -29 7, -18 24, 13 27,"
    " 28 -11, 26 -14, 14 -27, 5 -30, -5 -30))",
    "POLYGON ((-13 -99, -66 -75, -68 -74, -93 -38, -100 2, -32 95, 3 100, 73 68, 93 36, 100 1,"
    " 100 -9, 70 -71, 31 -95, -13 -99), (-4 -30, -22 -21, 27 -13, 24 -19, 21 -22, 2 -30, -4 -30))",
    "POLYGON ((-13 -99, -39 -92, -61 -79, -85 -52, -100 6, -65 76, -26 97, 39 92, 66 75, 83 55,"
    " 95 -33, 47 -88, 39 -92, 28 -96, -13 -99), (1 -30, -10 -28, -25 16, -23 20, -7 29, 24 -18,"
    " 1 -30))",
)


@numba.njit
def in_debt(ax, ay, bx, by, cx, cy):
    """The half-perimeter, counted negative: its optimum has the longest diagonals."""
    return -(max(ax, bx, cx) - min(ax, bx, cx)) - (max(ay, by, cy) - min(ay, by, cy))


def solve(polygon, name="half-perimeter"):
    """Return the optimum and its certificate."""
    best = triangulate(polygon, "optimal", criterion=name)
    return best, certify(polygon, best, name)


@pytest.mark.parametrize("name", [*WHOLE, *ROUNDED, in_debt])
def test_the_proven_optimum_is_the_least_of_all_triangulations(name):
    rng = np.random.default_rng(len(name) if isinstance(name, str) else 5)
    criterion = criteria.find(name)

    def cost(corners):
        return criterion.total(np.array(corners), np.array([[0, 1, 2]], np.int32))

    for _ in range(40):
        polygon = with_holes(rng, int(rng.integers(4, 7)), int(rng.integers(1, 4)))
        rings = [list(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
        least = float(Small(rings).optimum(cost)[0])
        best, found = solve(polygon, name)
        assert verify(polygon, best).conforming
        assert found.proven, polygon.wkt
        assert found.cost == pytest.approx(least, rel=1e-12), polygon.wkt
        assert found.lower_bound <= least + 1e-12 * abs(least)
        if name in WHOLE:
            assert found.gap == 0.0
        assert found.gap < 1e-8


@pytest.mark.parametrize("wkt", HALVES)
def test_where_the_program_is_not_whole_the_bound_is_told(wkt):
    polygon = shapely.from_wkt(wkt)
    _, found = solve(polygon, scrambled)
    assert not found.proven
    assert 0.0 < found.gap < 0.2
    for name in ("delaunay", "greedy"):
        total = criteria.find(scrambled).total(vertices(polygon), triangulate(polygon, name))
        assert found.lower_bound <= total


def test_the_table_and_the_program_agree_without_holes():
    rng = np.random.default_rng(8)
    for number in range(40):
        polygon = random_simple(rng, int(rng.integers(5, 40)), 60)
        name = (*WHOLE, *ROUNDED)[number % 5]
        outline = boundary(polygon)
        cost = cost_of(criteria.find(name), boundary_area(outline), outline.expected_triangles)
        proof = prove(outline, best_initial(outline, cost), cost)
        best = triangulate(polygon, "optimal", criterion=name)
        total = criteria.find(name).total
        assert total(outline.points, proof.triangles) == pytest.approx(
            total(outline.points, best), rel=1e-12
        )
        assert certify(polygon, best, name).proven
        assert certify(polygon, proof.triangles, name).proven


def test_real_polygons_with_holes_are_proven():
    polygons = [p for _, p in glyphs("ABDg8%") if p.interiors]
    polygons += [p for _, p in shared("helsinki.json") if p.is_valid and p.interiors][:12]
    assert len(polygons) > 12
    for polygon in polygons:
        for name in ("half-perimeter", "overdraw"):
            best = triangulate(polygon, "optimal", criterion=name)
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


class TestChecker:
    def claim(self, name="half-perimeter"):
        polygon = shapely.Polygon(star(30).exterior, [[(480, 500), (530, 520), (510, 560)]])
        best, found = solve(polygon, name)
        outline = boundary(polygon)
        cost = cost_of(criteria.find(name), boundary_area(outline), outline.expected_triangles)
        about = (outline, best, cost)
        assert certificate_of(*about, found.evidence) == found
        return about, found.evidence

    def refused(self, about, evidence, match):
        with pytest.raises(CertificateError, match=match):
            certificate_of(*about, evidence)

    def test_a_corrupted_dual(self):
        about, evidence = self.claim()
        refusals = 0
        for edge in range(len(evidence.edges)):
            for change in (1 << 40, -(1 << 40)):
                potentials = evidence.potentials.copy()
                potentials[edge] += change
                changed = replace(evidence, potentials=potentials)
                try:
                    refusals += not certificate_of(*about, changed).proven
                except CertificateError:
                    refusals += 1
        assert refusals >= 2 * len(evidence.edges) - 6
        lifted = replace(evidence, lift=evidence.lift + (1 << 40))
        self.refused(about, lifted, "potentials exceed")

    def test_an_edge_that_is_given_twice(self):
        about, evidence = self.claim()
        edges = np.vstack([evidence.edges, evidence.edges[:1]])
        twice = replace(evidence, edges=edges, potentials=np.r_[evidence.potentials, 0])
        self.refused(about, twice, "an edge is given twice")

    def test_units_that_are_not_those_of_the_claim(self):
        about, evidence = self.claim()
        self.refused(about, replace(evidence, factor=4), "the units")


@pytest.mark.parametrize("bits", range(11))
def test_noise_of_edges_is_below_its_bits_and_takes_all_values(bits):
    """The same whichever end comes first, and none without bits."""
    found = {int(noise(a, b, bits)) for a in range(80) for b in range(a, 80)}
    assert found <= set(range(2**bits))
    assert len(found) >= 0.9 * 2**bits
    assert noise(3, 70, bits) == noise(70, 3, bits)


@pytest.mark.parametrize("bits", [1, 7, 10])
def test_noise_of_edges_is_what_evidence_says_it_is(bits):
    """The plain checker's way, in Python's numbers."""
    plain = SimpleNamespace(bits=bits)
    for a, b in combinations((*range(40), 10**6), 2):
        assert noise(a, b, bits) == check_evidence.Claim.noise(plain, a, b)


@numba.njit
def of_first_corner(ax, ay, bx, by, cx, cy):
    """A cost that depends on which corner comes first."""
    return ax + 0.25 * bx - 0.5 * cy + 100.0


@pytest.mark.parametrize("name", ["half-perimeter", "edge-length", of_first_corner])
@pytest.mark.parametrize("bits", [0, 1, 10])
@pytest.mark.parametrize("scale", [4.0, 2.0**50])
def test_weights_are_what_evidence_says_they_are_whichever_corner_comes_first(name, bits, scale):
    rng = np.random.default_rng(bits)
    points = rng.integers(-50, 50, (20, 2)).astype(float)
    triangles = np.array([rng.permutation(20)[:3] for _ in range(60)], np.int32)
    cost = cost_of(criteria.find(name), 1.0, 18)
    units = Units(scale, factor_for(18, bits), bits, True, False)
    weights = weights_of(points, triangles, cost, units)
    for turned in range(3):
        own = weights_of(points, np.roll(triangles, turned, 1), cost, units)
        assert np.array_equal(own, weights)
    if name is not of_first_corner:
        return
    most = 2**59 // units.factor
    first = np.array([np.roll(row, -np.argmin(row)) for row in triangles])
    for row, known in zip(first, weights.tolist(), strict=True):
        one = of_first_corner(*points[row].ravel())
        own = sum(int(noise(row[k], row[k - 1], bits)) for k in range(3))
        assert known == units.factor * int(min(np.floor(one * scale), most)) + own


def weighing(each: float):
    """Return a cost that is the same for every triangle."""
    cost = cost_of(criteria.find("half-perimeter"), 1.0, 1)
    weights = np.zeros_like(cost["weights"])
    weights[TRIANGLES] = each
    return with_fields(cost, weights=weights)


def test_a_weight_may_be_as_far_below_0_as_above_it():
    points = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    units = Units(1.0, factor_for(1, 10), 10, True, False)
    most = 2**59 // units.factor
    own = weight(points, 0, 1, 2, weighing(0.0), units)
    assert 0 < own < units.factor
    for each in (-most, most):
        found = weight(points, 0, 1, 2, weighing(each), units)
        assert found == each * units.factor + own
    assert weight(points, 0, 1, 2, weighing(-most - 1.0), units) >= TOO_LARGE
    assert weight(points, 0, 1, 2, weighing(np.nan), units) >= TOO_LARGE


def test_a_weight_that_is_no_number_proves_nothing():
    edges = edges_of(boundary(SQUARE))
    units = Units(1.0, factor_for(7, 10), 10, True, False)
    none = np.zeros(len(edges.ends), np.int64)
    with pytest.raises(CertificateError, match="a weight is too large"):
        _check_potentials(edges, none, 0, weighing(np.nan), units)
    _check_potentials(edges, none, 0, weighing(1.0), units)


def outlined(points, count=1, holes=0, corners=4):
    return SimpleNamespace(
        points=points, expected_triangles=count, holes=holes, edges=range(corners)
    )


TRIANGLE = np.array([[0, 1, 2]], np.int32)


@pytest.mark.parametrize("count", [1, 30, 4000, 10**5, 2 * 10**5, 10**6, 10**7])
def test_units_of_real_costs_are_fine_and_leave_room_for_noise(count):
    """Of 2^-36 to 2^-32 of the total; noise has as many bits as fit, ten at most."""
    for total in (0.75, 1.5, 1.1e-7, 3.3e9):
        points = np.array([(0.0, 0.0), (total / 2, 0.0), (0.0, 0.0)])
        cost = cost_of(criteria.find("edge-length"), 1.0, 1)
        own = float(costs_of(points, TRIANGLE, cost)[0])
        units = units_for(outlined(points, count), TRIANGLE, cost)
        assert 2.0**32 <= own * units.scale < 2.0**36
        assert np.log2(units.scale) % 4 == 0
        assert (units.exact, units.real) == (False, True)
        assert units.factor == factor_for(count, units.bits)
        assert units.factor << 38 < 2**61
        more = units.bits + 1 if units.bits else 2
        assert units.bits == 10 or factor_for(count, more) << 38 >= 2**61
    assert units.bits != 1


@pytest.mark.parametrize(("total", "scale"), [(0.0, 1.0), (1e-300, 2.0**900), (1e300, 2.0**-900)])
def test_units_of_very_small_and_large_costs_are_numbers(total, scale):
    points = np.array([(0.0, 0.0), (total, 0.0), (0.0, 0.0)])
    # No squares, which would leave the range of doubles; not whole, so that costs are real.
    assert units_for(outlined(points), TRIANGLE, boxes(1.5)).scale == scale


def test_exact_weights_leave_room_for_four_triangulations_and_noise():
    rng = np.random.default_rng(3)
    cost = cost_of(criteria.find("half-perimeter"), 1.0, 1)
    for size in 2.0 ** rng.uniform(0, 50, 60):
        points = np.rint(np.array([(0.0, 0.0), (size, 0.0), (0.0, size)]))
        count = int(rng.integers(1, 10**4))
        units = units_for(outlined(points, count, holes=1), TRIANGLE, cost)
        assert (units.exact, units.real) == (True, False)
        total = int(costs_of(points, TRIANGLE, cost)[0] * units.scale)
        assert 4 * total * units.factor < 2**61
        more = units.bits + 1 if units.bits else 2
        assert units.bits == 10 or 4 * total * factor_for(count, more) >= 2**61


@pytest.mark.parametrize("bits", range(11))
def test_a_unit_is_more_than_the_noise_of_all_triangles(bits):
    for count in (1, 2, 5, 1000):
        factor = factor_for(count, bits)
        assert factor.bit_count() == 1
        assert 3 * count * (2**bits - 1) < factor <= max(1, 6 * count * 2**bits)


@pytest.mark.parametrize(
    ("values", "places"),
    [([0.5], 1), ([3.0, 4.0], 0), ([4.0, -8.0], -2), ([3 / 1024, 7.0], 10), ([0.0], -16)],
)
def test_binary_places_are_those_of_the_finest_coordinate(values, places):
    assert _binary_places(np.array(values)) == places


def boxes(around: float = 0.0, box: float = 0.0):
    cost = weighing(0.0)
    weights = cost["weights"].copy()
    weights[HALF_PERIMETER], weights[BBOX_AREA] = around, box
    return with_fields(cost, weights=weights)


def test_four_times_a_total_stays_below_the_room_for_weights():
    """Of 2^k and one unit less, the larger leaves a bit less for noise."""
    factor = factor_for(1, 10)
    side = 2.0**58 / factor
    for total, bits in ((2 * side, 9), (2 * side - 1, 10)):
        points = np.array([(0.0, 0.0), (side, 0.0), (0.0, total - side)])
        units = units_for(outlined(points, holes=1), TRIANGLE, boxes(1.0))
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
    ],
)
def test_whole_costs_have_units_where_doubles_are_exact(side, cost, scale, most):
    points = np.array([(16.0, 0.0), (16.0 + side, 0.0), (16.0, side)])
    found, whole, units = whole_scale(points, cost)
    assert (found, units) == (scale, most)
    assert whole == (side % 1 == 0 and most < np.inf)


def test_whole_costs_may_weigh_all_that_is_whole():
    weights = np.zeros_like(boxes()["weights"])
    weights[:4] = 1, -1, 2, 3
    points = np.array([(0.0, 0.0), (7.0, 0.0), (0.0, 7.0)])
    assert whole_scale(points, with_fields(boxes(), weights=weights)) == (2.0, True, 7 * 2 * 49.0)


def test_doubles_add_up_while_a_sum_of_all_is_exact():
    points = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)])
    assert doubles_add_up(outlined(points, 2**51 - 1), boxes(1.0))
    assert not doubles_add_up(outlined(points, 2**51), boxes(1.0))
    assert not doubles_add_up(outlined(points), boxes(1.5))
    assert not doubles_add_up(outlined((2.0**25 + 1) * points), boxes(0.0, 1.0))


def test_the_table_proves_as_many_corners_as_its_limit(monkeypatch):
    monkeypatch.setattr("triangulators.certificate.certify.TABLE", 4)
    monkeypatch.setattr("triangulators.certificate.certify.prove", lambda *_: None)
    four = shapely.box(0, 0, 9, 4)
    five = shapely.Polygon([(0, 0), (9, 0), (9, 4), (4, 6), (0, 4)])
    assert certify(four, triangulate(four, "optimal:half-perimeter")).proven
    assert not certify(five, triangulate(five, "optimal:half-perimeter")).proven


def test_a_triangle_is_turned_to_its_lowest_corner():
    for corners in permutations((2, 5, 9)):
        found = lowest_first(*corners)
        assert found[0] == 2
        assert found in [corners[k:] + corners[:k] for k in range(3)]


def test_what_cannot_be_proven_in_time_has_its_cost_and_no_bound(monkeypatch):
    monkeypatch.setattr("triangulators.certificate.certify.prove", lambda *_: None)
    best = triangulate(SQUARE, "optimal:half-perimeter")
    found = certify(SQUARE, best)
    assert not found.proven
    assert (found.lower_bound, found.gap) == (-np.inf, np.inf)
    assert found.cost == np.ptp(vertices(SQUARE)[best], axis=1).sum()


@pytest.mark.parametrize("value", [Fraction(1, 3), Fraction(2, 3), Fraction(-1, 3), Fraction(5)])
def test_a_bound_is_rounded_down_by_no_more_than_a_step(value):
    low = _down(value)
    assert Fraction(low) <= value < Fraction(np.nextafter(low, np.inf))
