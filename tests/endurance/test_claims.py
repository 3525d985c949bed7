"""False claims of optimality are accepted by neither checker; brute force finds nothing less."""

import json
from collections import Counter

import numpy as np
import pytest
import shapely

from tests.endurance.brute_force import Small
from tests.endurance.forgeries import JUDGES, NAMES, forgery, genuine_claims, polygons, truth
from triangulators import TriangulationError, certify, triangulate

EACH = 60  # forgeries of a polygon


def judged(rng: np.random.Generator, wanted: int) -> Counter[str]:
    """Make forgeries until as many are false as wanted; count what each checker accepts."""
    counts: Counter[str] = Counter()
    for number, polygon in enumerate(polygons(rng)):
        if counts["no claim"] + counts["false"] >= wanted:
            break
        claims = [
            c for c in genuine_claims(polygon, NAMES[number % 3]) if c["potentials"] is not None
        ]
        for claim in claims:
            line = json.dumps(claim)
            assert truth(line) == "true", line
            counts["genuine"] += 1
            for judge, accepts in JUDGES.items():
                assert accepts(line), (judge, line)
        for _ in range(EACH if claims else 0):
            line = forgery(rng, claims)
            what = truth(line)
            counts[what] += 1
            accepting = [judge for judge, accepts in JUDGES.items() if accepts(line)]
            assert what == "true" or not accepting, (what, accepting, line)
            counts["true, though changed, and accepted by both"] += len(accepting) == len(JUDGES)
    return counts


def polygon_of(rng: np.random.Generator, holes: bool) -> shapely.Polygon:
    """Return a valid polygon of whole coordinates between 2^3 and 2^31."""
    while True:
        size = 2.0 ** rng.uniform(3, 31)
        turns = np.sort(rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(4, 7 if holes else 10))))
        radius = size * rng.uniform(0.3, 1.0, len(turns))
        ring = np.column_stack([np.cos(turns), np.sin(turns)]) * radius[:, None]
        if rng.random() < 0.5:  # corners near each other, far from the rest: close calls
            ring[1:] = ring[1] + rng.uniform(-8, 8, (len(ring) - 1, 2))
        hole = np.rint(rng.uniform(-0.2, 0.2, (3, 2)) * size)
        polygon = shapely.Polygon(np.rint(ring), [hole] if holes else [])
        if polygon.is_valid and polygon.area > 0.0:
            return polygon


def compared(polygon: shapely.Polygon, name: str) -> Counter[str]:
    """Certify triangulations of a polygon; count what is proven, and check it by brute force."""
    counts: Counter[str] = Counter()
    small = Small([list(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)])
    best = small.optimum(name)
    assert best is not None
    exact = name != "edge-length"
    for method in (f"optimal:{name}", "greedy", "delaunay", "refined"):
        triangles = triangulate(polygon, method)
        total = sum(small.cost([small.vertex[v] for v in t], name) for t in triangles.tolist())
        if method == f"optimal:{name}":
            assert total == best[0] if exact else abs(total - best[0]) <= total * 1e-12, polygon.wkt
        for evidence in (True, False):
            try:
                found = certify(polygon, triangles, name, evidence=evidence)
            except TriangulationError:
                continue  # not conforming
            more = 0 if exact else total * max(found.gap, 1e-12)
            assert not found.proven or total <= best[0] + more, (method, polygon.wkt)
            assert found.lower_bound <= best[0] * (1 if exact else 1 + 1e-12), (method, polygon.wkt)
            counts["certificates"] += 1
            counts["proven"] += found.proven
            counts["optimal, not proven"] += total == best[0] and not found.proven
    return counts


@pytest.mark.parametrize("seed", range(10))
def test_no_false_claim_is_accepted(seed, times, tell):
    tell(judged(np.random.default_rng(seed), times(10_000)))


@pytest.mark.parametrize("seed", range(5))
def test_brute_force_finds_nothing_less(seed, times, tell):
    rng = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    for number in range(times(1000)):
        counts += compared(polygon_of(rng, holes=number % 2 == 1), NAMES[number // 2 % 3])
        counts["polygons"] += 1
    tell(counts)
