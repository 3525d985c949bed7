"""Claims in files: two independent checkers accept the true ones only."""

import itertools
import json
import math
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import shapely

from harness.export import check_evidence
from tests.endurance.forgeries import (
    NAMES,
    decide_truth,
    is_accepted_by_file,
    is_accepted_by_package,
)
from tests.endurance.test_claims import compare, count_accepted, random_polygon
from tests.triangulators.cases import pose, random_simple, touching_polygons
from triangulators import certify, triangulate
from triangulators.certificate.certify import make_certificate
from triangulators.checking import checker
from triangulators.checking.edges import _do_segments_meet, find_edges
from triangulators.checking.evidence import (
    CertificateError,
    compute_exact_total,
    find_units,
    make_claim,
)

SQUARE = shapely.Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(2, 2), (2, 4), (4, 3)]])
RING = shapely.from_wkt(
    "POLYGON ((1995472 4346086,1995477 4346090,1995475 4346083,1995469 4346080,861703 9084428,"
    "1995468 4346087,1995469 4346088,1995472 4346086))"
)


def about(polygon, triangles, name="half-perimeter"):
    outline, cost = pose(polygon, name)
    return outline, np.ascontiguousarray(outline.site[triangles], np.int32), cost


@pytest.mark.parametrize("power", [-440, -460, -508, -512, -537, 480, 500])
def test_extreme_coordinates_prove_nothing_false(power):
    """Coarse units would prove anything; squares of steps overflow."""
    corners = np.array([(0, 0), (9.1, 0.3), (17.7, 5.2), (13.3, 12.9), (2.2, 10.1)])
    for shape in (shapely.Polygon(corners), shapely.Polygon(np.rint(corners))):
        polygon = shapely.transform(shape, lambda points: points * 2.0**power)
        worst = triangulate(polygon, "worst:overdraw")
        for name in ("overdraw", "half-perimeter"):
            certificate = certify(polygon, worst, name)
            assert not certificate.proven
            claim = make_claim(polygon, worst, name, certificate)
            assert not is_accepted_by_file(json.dumps(claim | {"proven": True}))


def test_rejects_bound_above_cost(monkeypatch):
    best = triangulate(SQUARE, "optimal:half-perimeter")
    true = certify(SQUARE, best).evidence
    monkeypatch.setattr(checker, "_check_potentials", lambda *_: None)  # so that nothing else does
    forged = replace(true, lift=true.lift + true.factor)
    with pytest.raises(CertificateError, match="bound exceeds the weight"):
        make_certificate(*about(SQUARE, best), forged)


def test_detects_four_units_in_5e12():
    greedy = certify(RING, triangulate(RING, "greedy"), "overdraw")
    best = certify(RING, triangulate(RING, "optimal:overdraw"), "overdraw")
    assert (greedy.cost, greedy.proven) == (5372176259625.0, False)
    assert (best.cost, best.proven, best.gap) == (5372176259621.0, True, 0.0)
    assert greedy.lower_bound == best.cost
    fast = certify(RING, triangulate(RING, "greedy"), "overdraw", evidence=False)
    assert not fast.proven


def test_overflow_of_64_bits_gives_valid_bound_without_proof():
    rng = np.random.default_rng(2)
    for _ in range(8):
        polygon = random_simple(rng, 9, 2**31)
        best = triangulate(polygon, "optimal:overdraw")
        for triangles in (best, triangulate(polygon, "greedy")):
            certificate = certify(polygon, triangles, "overdraw")
            assert not certificate.proven
            claim = make_claim(polygon, triangles, "overdraw", certificate)
            assert is_accepted_by_file(json.dumps(claim))
            optimal_cost = certify(polygon, best, "overdraw").cost
            assert certificate.lower_bound <= optimal_cost
            assert certificate.lower_bound == pytest.approx(optimal_cost, rel=1e-8)


def test_touching_holes_off_grid_are_proven():
    for number, polygon in enumerate(touching_polygons(1, 24)):
        name = ("expected-quads", *NAMES)[number % 4]
        polygon = polygon.reverse() if number % 3 else polygon
        certificate = certify(polygon, triangulate(polygon, "optimal", criterion=name), name)
        assert certificate.proven, (name, polygon.wkt)
        assert certificate.gap < 1e-8


def test_rejects_thousand_false_claims():
    counts = count_accepted(np.random.default_rng(7), 1000)
    assert min(counts["no claim"], counts["false"], counts["genuine"]) > 50


def test_nothing_cheaper_by_brute_force_is_proven():
    rng = np.random.default_rng(11)
    counts = Counter()
    for number in range(6):
        counts += compare(random_polygon(rng, holes=number % 2 == 1), NAMES[number // 2 % 3])
    assert counts["proven"] > 4
    assert counts["proven"] < counts["certificates"]


# The other diagonal, 1-3, costs 140.
OF_A_KITE = {
    "format": "raster-harness evidence 1",
    "criterion": "half-perimeter",
    "rings": [[[0, 0], [50, -10], [100, 0], [50, 10]]],
    "triangles": [[0, 1, 2], [0, 2, 3]],
    "cost": 220.0,
    "lower_bound": 140.0,
    "gap": 80 / 220,
    "proven": False,
    "scale": 1.0,
    "factor": 8192,
    "bits": 10,
    "edges": [[0, 1], [0, 2], [1, 3]],
    "potentials": [140 * 8192, 50 * 8192, -70 * 8192],
    "lift": 0,
}


@pytest.mark.parametrize(
    "change",
    [
        {"gap": 80 / 220 - 1e-12},
        {"gap": -0.01},
        {"gap": "0.5"},
        {"gap": float("nan")},
        {"cost": "220"},
        {"lower_bound": 141.0},
        {"proven": 1},
        {"proven": True, "gap": 0.5},
        {"format": "raster-harness evidence 0"},
        {"rings": [[[0, 0], [50, -10], [100, 0], [50, 10, 50, 2]]]},
        {"rings": [[[0, 0], [50, -10], [100, 0], ["50", 10]]]},
        {"rings": [[[0, 0], [50, -10], [100, 0], [50, 10]], [[50, 2]]]},
        {"rings": [[[0, 0], [50, -10], [100, 0], [50, 2**53 + 1]]]},
        {"factor": True},
        {"bits": 10.0},
        {"more": 0},
    ],
)
def test_both_checkers_reject_single_changes(change):
    line = json.dumps(OF_A_KITE)
    assert decide_truth(line) == "true"
    assert is_accepted_by_file(line)
    assert is_accepted_by_package(line)
    changed = json.dumps(OF_A_KITE | change)
    assert not is_accepted_by_file(changed)
    assert not is_accepted_by_package(changed)


def test_both_checkers_reject_self_touching_ring():
    """Two triangles with a common vertex, both surrounded by the ring."""
    bow = [[0, 0], [4, 0], [4, 4], [0, 0], [-4, 0], [-4, -4]]
    zeros = {"edges": [[0, 1]], "potentials": [0], "lift": 0}
    claim = OF_A_KITE | {"rings": [bow], "triangles": [[0, 1, 2], [3, 4, 5]], **zeros}
    line = json.dumps(claim | {"cost": 16.0, "lower_bound": 0.0, "gap": 1.0, "factor": 8192})
    with pytest.raises(check_evidence.EvidenceError, match="a ring intersects or touches itself"):
        check_evidence.check_line(line)
    assert not is_accepted_by_package(line)


def test_rejects_repeated_field():
    line = json.dumps(OF_A_KITE)
    twice = line.replace('"cost": 220.0', '"cost": 220.0, "cost": 220.0')
    assert json.loads(twice) == OF_A_KITE
    assert not is_accepted_by_file(twice)
    assert not is_accepted_by_package(twice)


def test_unsupported_criteria_are_rejected_with_reason():
    triangles = triangulate(SQUARE, "optimal:shape")
    claim = make_claim(SQUARE, triangles, "shape", certify(SQUARE, triangles, "shape"))
    with pytest.raises(check_evidence.EvidenceError, match="shape: unsupported criterion"):
        check_evidence.check_line(json.dumps(claim))


def test_closed_ring_keeps_its_vertices():
    ring = [(0, 0), (9, 0), (9, 9), (0, 9), (0, 0), (0, 0)]
    polygon = shapely.Polygon(ring, [[(2, 2), (2, 4), (4, 3)]])
    triangles = triangulate(polygon, "optimal:half-perimeter")
    claim = make_claim(polygon, triangles, "half-perimeter", certify(polygon, triangles))
    assert len(claim["rings"][0]) == 5
    assert is_accepted_by_package(json.dumps(claim))
    assert is_accepted_by_file(json.dumps(claim))


def test_check_evidence_needs_only_python(tmp_path):
    script = shutil.copy(check_evidence.__file__, tmp_path)
    proofs = tmp_path / "proofs.jsonl"
    line = json.dumps(OF_A_KITE)
    for text, code in ((line, 0), (f"{line}\n{line[:-1]}", 1)):
        proofs.write_text(text)
        done = subprocess.run([sys.executable, "-I", "-S", script, proofs], capture_output=True)
        assert done.returncode == code
        assert done.stdout.startswith(b"1: at most 0.364 of the cost above")
        assert (b"2: refused" in done.stdout) == bool(code)


def test_real_costs_are_proven_within_one_unit_per_triangle(monkeypatch):
    """Each triangle's cost is rounded down by less than a unit, and so is the bound."""
    best = triangulate(SQUARE, "optimal:edge-length")
    outline, corners, cost = about(SQUARE, best, "edge-length")
    evidence = certify(SQUARE, best, "edge-length").evidence
    units = find_units(outline, corners, cost)
    assert units.real
    assert not units.exact
    total = compute_exact_total(outline, corners, cost, units)
    for below, proven in ((len(corners), False), (len(corners) - 1, True)):
        bound = math.floor(total * Fraction(units.scale)) - below
        # What the total exceeds a whole number of units by is below a unit, too.
        monkeypatch.setattr(checker, "compute_lower_bound", lambda *_, b=bound: b * units.factor)
        assert make_certificate(outline, corners, cost, evidence).proven is proven


@pytest.mark.parametrize("size", [2**6, 2**20])
def test_dynamic_program_potentials_are_tight(size):
    """Changing a potential by one unit violates the inequality of some triangle."""
    rng = np.random.default_rng(5)
    for _ in range(4):
        polygon = random_simple(rng, 9, size)
        triangles = triangulate(polygon, "worst:overdraw")
        outline, sites, cost = about(polygon, triangles, "overdraw")
        true = certify(polygon, triangles, "overdraw").evidence
        checker.compute_lower_bound(outline, sites, cost, true)
        for edge in range(len(true.edges)):
            refused = []
            for change in (1, -1):
                more = replace(true, potentials=true.potentials.copy())
                more.potentials[edge] += change
                try:
                    checker.compute_lower_bound(outline, sites, cost, more)
                except CertificateError as why:
                    refused.append(str(why))
            assert refused, edge
            assert all("potentials exceed" in why for why in refused), refused


def test_rejects_side_that_is_not_an_edge():
    best = triangulate(SQUARE, "optimal:half-perimeter")
    outline, sites, cost = about(SQUARE, best)
    true = certify(SQUARE, best).evidence
    checker.compute_lower_bound(outline, sites, cost, true)
    seen = set(map(tuple, find_edges(outline).ends.tolist()))
    sites[0] = next(t for t in itertools.combinations(range(7), 3) if t[:2] not in seen)
    with pytest.raises(CertificateError, match="not an edge of the polygon"):
        checker.compute_lower_bound(outline, sites, cost, true)


def test_segments_meet_as_in_shapely():
    """All pairs of segments without a common end on a grid of 4 x 3 points."""
    points = np.array(list(itertools.product(range(4), range(3)))) / 64
    rows = np.array(list(itertools.permutations(range(12), 4)))
    first, second = (shapely.linestrings(points[rows[:, k : k + 2]]) for k in (0, 2))
    meets = [_do_segments_meet(points, *row) for row in rows.tolist()]
    assert meets == shapely.intersects(first, second).tolist()
