"""Set `certify` against a program in whole numbers, on coordinates of up to 2^31.

    PYTHONPATH=. python scripts/whole_numbers.py [--polygons 20000] [--seed 0]

The program tries every triangulation of a small polygon, every second one with a hole, with the
empty triangles and costs of scripts/check_evidence.py, in Python's numbers. Where it finds less
than a triangulation costs, `certify` must not say that the triangulation is proven.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import shapely

from scripts.false_claims import PLAIN
from triangulators import TriangulationError, certify, triangulate
from triangulators.checking.claims import as_claim

NAMES = ("overdraw", "half-perimeter")
Edge = tuple[int, int]


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


def least(claim: Any) -> Fraction:
    """Return the least that a triangulation of a claim's polygon costs, of all there are."""
    apexes: dict[Edge, list[tuple[int, Fraction]]] = defaultdict(list)
    for t in claim.empty_triangles():
        for (a, b), c in zip(PLAIN.sides_of(t), (t[2], t[0], t[1]), strict=True):
            apexes[a, b].append((c, claim.cost(*t)))

    @cache
    def rest(region: frozenset[Edge]) -> Fraction | None:
        """Return what is left to pay for a region, by its edges; None if nothing fits."""
        if not region:
            return Fraction(0)
        a, b = min(region)
        found = None
        for c, price in apexes[a, b]:
            after = set(region) - {(a, b)}
            fits = True
            for p, q in ((b, c), (c, a)):
                if (p, q) in after:
                    after.discard((p, q))
                else:
                    fits &= not any(claim.cross(p, q, *edge) for edge in region)
                    after.add((q, p))
            more = rest(frozenset(after)) if fits else None
            if more is not None and (found is None or price + more < found):
                found = price + more
        return found

    result = rest(frozenset(claim.boundary))
    assert result is not None
    return result


def judged(polygon: shapely.Polygon, name: str) -> Counter[str]:
    """Certify triangulations of a polygon; count what is proven, and what is proven wrongly."""
    counts: Counter[str] = Counter()
    optimum = None
    for method in (f"optimal:{name}", "greedy", "delaunay", "refined"):
        triangles = triangulate(polygon, method)
        for evidence in (True, False):
            try:
                found = certify(polygon, triangles, name, evidence=evidence)
            except TriangulationError:
                continue  # not conforming
            if evidence:
                claim = PLAIN.Claim(as_claim(polygon, triangles, name, found))
                optimum = least(claim) if optimum is None else optimum
                total = claim.total
            counts["certificates"] += 1
            counts["proven"] += found.proven
            counts["proven, though something costs less"] += found.proven and total > optimum
            counts["optimal, not proven"] += total == optimum and not found.proven
            counts["bounds above the optimum"] += Fraction(found.lower_bound) > optimum
    return counts


def main() -> None:
    """Read the command line and print what was counted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--polygons", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    counts: Counter[str] = Counter()
    for number in range(given.polygons):
        holes = number % 2 == 1
        polygon = polygon_of(rng, holes)
        found = judged(polygon, NAMES[number // 2 % 2])
        counts.update(found)
        if found["proven, though something costs less"] or found["bounds above the optimum"]:
            print(f"wrong: {polygon.wkt}")
    print(f"{given.polygons:>9,} polygons")
    for what in (
        "certificates",
        "proven",
        "optimal, not proven",
        "proven, though something costs less",
        "bounds above the optimum",
    ):
        print(f"{counts[what]:>9,} {what}")


if __name__ == "__main__":
    main()
