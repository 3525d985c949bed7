"""Both checkers reject false claims of optimality, and brute force confirms certificates."""

import json
from collections import Counter

import numpy as np
import pytest
import shapely

from tests.endurance.brute_force import SmallPolygon
from tests.endurance.forgeries import (
    CHECKERS,
    NAMES,
    decide_truth,
    forge,
    make_genuine_claims,
    random_polygons,
)
from triangulators import TriangulationError, certify, triangulate

FORGERIES_PER_POLYGON = 60


def count_accepted(rng: np.random.Generator, false_count: int) -> Counter[str]:
    """Make forgeries until `false_count` are false; count those that a checker accepts."""
    counts: Counter[str] = Counter()
    for number, polygon in enumerate(random_polygons(rng)):
        if counts["no claim"] + counts["false"] >= false_count:
            break
        genuine = make_genuine_claims(polygon, NAMES[number % 3])
        claims = [claim for claim in genuine if claim["potentials"] is not None]
        for claim in claims:
            line = json.dumps(claim)
            assert decide_truth(line) == "true", line
            counts["genuine"] += 1
            for checker, accepts in CHECKERS.items():
                assert accepts(line), (checker, line)
        for _ in range(FORGERIES_PER_POLYGON if claims else 0):
            line = forge(rng, claims)
            verdict = decide_truth(line)
            counts[verdict] += 1
            accepting = [checker for checker, accepts in CHECKERS.items() if accepts(line)]
            assert verdict == "true" or not accepting, (verdict, accepting, line)
            counts["true, though changed, and accepted by both"] += len(accepting) == len(CHECKERS)
    return counts


def random_polygon(rng: np.random.Generator, holes: bool) -> shapely.Polygon:
    """Return a valid polygon with integer coordinates and a size between 2^3 and 2^31."""
    while True:
        size = 2.0 ** rng.uniform(3, 31)
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(4, 7 if holes else 10))))
        radius = size * rng.uniform(0.3, 1.0, len(angles))
        ring = np.column_stack([np.cos(angles), np.sin(angles)]) * radius[:, None]
        if rng.random() < 0.5:  # vertices close to each other and far from the others
            ring[1:] = ring[1] + rng.uniform(-8, 8, (len(ring) - 1, 2))
        hole = np.rint(rng.uniform(-0.2, 0.2, (3, 2)) * size)
        polygon = shapely.Polygon(np.rint(ring), [hole] if holes else [])
        if polygon.is_valid and polygon.area > 0.0:
            return polygon


def compare(polygon: shapely.Polygon, name: str) -> Counter[str]:
    """Certify triangulations of a polygon, check the certificates by brute force, and count."""
    counts: Counter[str] = Counter()
    small = SmallPolygon(
        [list(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    )
    best = small.optimum(name)
    assert best is not None
    exact = name != "edge-length"
    for method in (f"optimal:{name}", "greedy", "delaunay", "refined"):
        triangles = triangulate(polygon, method)
        total = sum(small.cost([small.vertex_of[v] for v in t], name) for t in triangles.tolist())
        if method == f"optimal:{name}":
            assert total == best[0] if exact else abs(total - best[0]) <= total * 1e-12, polygon.wkt
        for evidence in (True, False):
            try:
                certificate = certify(polygon, triangles, name, evidence=evidence)
            except TriangulationError:
                continue  # not conforming
            tolerance = 0 if exact else total * max(certificate.gap, 1e-12)
            assert not certificate.proven or total <= best[0] + tolerance, (method, polygon.wkt)
            bound = certificate.lower_bound
            assert bound <= best[0] * (1 if exact else 1 + 1e-12), (method, polygon.wkt)
            counts["certificates"] += 1
            counts["proven"] += certificate.proven
            counts["optimal, not proven"] += total == best[0] and not certificate.proven
    return counts


@pytest.mark.parametrize("seed", range(10))
def test_false_claims_are_rejected(seed, scale_count, report_counts):
    report_counts(count_accepted(np.random.default_rng(seed), scale_count(10_000)))


@pytest.mark.parametrize("seed", range(5))
def test_brute_force_confirms_certificates(seed, scale_count, report_counts):
    rng = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    for number in range(scale_count(1000)):
        counts += compare(random_polygon(rng, holes=number % 2 == 1), NAMES[number // 2 % 3])
        counts["polygons"] += 1
    report_counts(counts)
