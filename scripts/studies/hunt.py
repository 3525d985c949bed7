"""Hunt for polygons with holes on which the search over cuts misses the optimum.

    PYTHONPATH=. python scripts/studies/hunt.py --minutes 60 --keep worst.csv

That search is what `optimal` was before it could prove, and what it begins with still. Its cost is
set against the proven one, whose evidence the checker accepts, and against what `optimal` returns.
Prints, for each kind of polygon and criterion, how many were tried and missed, and by how much at
worst; `--keep` writes the worst of each as WKT. Ends with 1 if `optimal` itself was not optimal.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import shapely

from tests.triangulators.cases import star
from tests.triangulators.test_batch_equal import polygons as with_holes
from tests.triangulators.touching import touching_polygons
from triangulators import TriangulationError, triangulate, vertices
from triangulators.checking.evidence import Refused
from triangulators.criteria import find
from triangulators.criteria.cost import cost_of, evaluate
from triangulators.methods.optimal import solve
from triangulators.optimum.local_search import search_cuts
from triangulators.polygon import boundary, boundary_area
from triangulators.starting.starts import best_start

CRITERIA = ("half-perimeter", "overdraw", "expected-quads", "edge-length", "shape")
CLOSE = 1e-9
"""Relative: sums of the same triangles in another order differ by less."""
SECONDS = 20.0  # for each linear program

Rng = np.random.Generator


@dataclass
class Score:
    """What was found of one kind of polygon and one criterion."""

    tried: int = 0
    unproven: int = 0
    missed: int = 0
    wrong: int = 0
    worst: float = 0.0
    polygon: str = ""

    def add(self, other: Score) -> None:
        """Add what another process found."""
        self.tried += other.tried
        self.unproven += other.unproven
        self.missed += other.missed
        self.wrong += other.wrong
        if other.worst > self.worst:
            self.worst, self.polygon = other.worst, other.polygon


Found = dict[tuple[str, str], Score]


def main() -> None:
    """Read the command line, hunt, print and exit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="CSV of the worst polygons")
    given = parser.parse_args()
    until = time.monotonic() + given.minutes * 60.0
    found: Found = {}
    with ProcessPoolExecutor(given.processes) as pool:
        # Processes of one machine share its monotonic clock.
        hunt = partial(_hunt, given.seed, given.processes, until)
        for each in pool.map(hunt, range(given.processes)):
            for key, score in each.items():
                found.setdefault(key, Score()).add(score)
    _print(found)
    if given.keep:
        _keep(found, given.keep)
    sys.exit(any(score.wrong for score in found.values()))


def _hunt(seed: int, processes: int, until: float, number: int) -> Found:
    found: Found = {}
    turn = seed + number
    while time.monotonic() < until:
        for kind, make in KINDS.items():
            for polygon in make(np.random.default_rng(turn)):
                for criterion in CRITERIA:
                    _try(polygon, criterion, found.setdefault((kind, criterion), Score()))
        turn += processes
    return found


def _try(polygon: shapely.Polygon, criterion: str, score: Score) -> None:
    outline = boundary(polygon)
    wanted = find(criterion)
    cost = cost_of(wanted, boundary_area(outline), outline.expected_triangles)
    try:
        start = best_start(outline, cost)
    except TriangulationError:
        return  # `agreement.py touching` counts these
    score.tried += 1
    try:
        certificate = solve(polygon, criterion, seconds=SECONDS).certificate
    except Refused as error:
        score.wrong += 1
        print(f"! {criterion}: {error}: {shapely.to_wkt(polygon, -1)}", flush=True)
        return
    if not certificate.proven:
        score.unproven += 1
        return
    searched = evaluate(outline.points, search_cuts(outline.points, start, cost), cost)
    given = wanted.total(vertices(polygon), triangulate(polygon, f"optimal:{criterion}"))
    room = CLOSE * abs(certificate.cost)
    if searched < certificate.cost - room or abs(given - certificate.cost) > room:
        score.wrong += 1
        print(f"! {criterion}: {given} proven {certificate.cost}, searched {searched}:", flush=True)
        print(shapely.to_wkt(polygon, -1), flush=True)
    if searched > certificate.cost + room:
        score.missed += 1
        excess = searched / certificate.cost - 1.0 if certificate.cost > room else np.inf
        if excess > score.worst:
            score.worst, score.polygon = excess, shapely.to_wkt(polygon, -1)


def _small(scale: float, rng: Rng) -> Iterator[shapely.Polygon]:
    for polygon in with_holes(scale, 27, int(rng.integers(2**31))):
        if polygon.interiors:
            yield polygon


def _touching(rng: Rng) -> Iterator[shapely.Polygon]:
    yield from touching_polygons(int(rng.integers(2**31)), 20)


def _rings(rng: Rng) -> Iterator[shapely.Polygon]:
    """Noisy stars with 2 to 12 noisy rings for holes."""
    for _ in range(5):
        outer = star(int(rng.integers(12, 80)), int(rng.integers(2**31)), 0.3)
        yield _cut(outer, rng, int(rng.integers(2, 13)), 60.0)


def _islands(rng: Rng) -> Iterator[shapely.Polygon]:
    """Squares with 5 to 40 triangles cut out."""
    for _ in range(3):
        yield _cut(shapely.box(0, 0, 1024, 1024), rng, int(rng.integers(5, 41)), 24.0)


def _lattice(rng: Rng) -> Iterator[shapely.Polygon]:
    """Rectangles with small squares at places of a lattice, so that many triangulations tie."""
    for _ in range(3):
        width, height = int(rng.integers(2, 6)), int(rng.integers(2, 6))
        places = [(x, y) for x in range(width) for y in range(height) if rng.random() < 0.7]
        if places:
            holes = [shapely.box(3 * x + 1, 3 * y + 1, 3 * x + 2, 3 * y + 2) for x, y in places]
            outer = shapely.box(0, 0, 3 * width, 3 * height)
            yield shapely.Polygon(outer.exterior, [hole.exterior for hole in holes])


def _cut(polygon: shapely.Polygon, rng: Rng, count: int, size: float) -> shapely.Polygon:
    """Cut up to `count` rings of 3 to 8 vertices out of a polygon, on the 1/256 grid."""
    low_x, low_y, high_x, high_y = polygon.bounds
    for _ in range(20 * count):
        center = rng.uniform((low_x, low_y), (high_x, high_y))
        ring = star(int(rng.integers(3, 9)), int(rng.integers(2**31)), 0.5)
        ring = shapely.get_coordinates(ring) - 512
        ring = np.round((ring * rng.uniform(0.2, 1.0) * size / 400 + center) * 256) / 256
        cut = shapely.Polygon(polygon.exterior, [*polygon.interiors, ring])
        if cut.is_valid and len(cut.interiors) <= count:
            polygon = cut
    return polygon


KINDS: dict[str, Callable[[Rng], Iterator[shapely.Polygon]]] = {
    "small, on a grid": partial(_small, 1.0),
    "small, off it": partial(_small, 1 / 3),
    "rings that touch": _touching,
    "stars, noisy holes": _rings,
    "squares, islands": _islands,
    "lattices": _lattice,
}


def _print(found: Found) -> None:
    print(f"{'polygons':<20} {'criterion':<16} {'tried':>8} {'missed':>8} {'worst':>8} unproven")
    for (kind, criterion), score in found.items():
        row = f"{kind:<20} {criterion:<16} {score.tried:>8,} {score.missed:>8,}"
        print(f"{row} {score.worst:>8.2%} {score.unproven:>8,}")
    tried = sum(score.tried for score in found.values())
    wrong = sum(score.wrong for score in found.values())
    print(f"{tried:,} optima; `optimal` was not optimal on {wrong}")


def _keep(found: Found, target: Path) -> None:
    with target.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["polygons", "criterion", "excess", "wkt"])
        for (kind, criterion), score in found.items():
            if score.polygon:
                rows.writerow([kind, criterion, f"{score.worst:.6f}", score.polygon])


if __name__ == "__main__":
    main()
