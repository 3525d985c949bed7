"""Compare the optimum with itself through every way to ask for it, and with programs apart from it.

    PYTHONPATH=. python scripts/agreement.py ways 100000      single, batch, drop-in, exported file
    PYTHONPATH=. python scripts/agreement.py touching 5000    the same, with rings that touch
    PYTHONPATH=. python scripts/agreement.py listed 100000    every triangulation, 1 to 3 holes
    PYTHONPATH=. python scripts/agreement.py table            the exact table, up to 6,000 vertices

Prints, for each criterion, what was compared and what did not agree; ends with 1 if anything
did not. `--seed` begins elsewhere, so that an hour's hunt is a loop over seeds.
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path

import numpy as np
import shapely

from harness.cli import main as command_line
from tests.conftest import write_geojson
from tests.triangulators.cases import convex, random_simple, smooth, star, twice_area
from tests.triangulators.listing import least_of_all
from tests.triangulators.test_batch_equal import polygons as with_holes
from tests.triangulators.touching import touching_polygons
from triangulators import TriangulationError, triangulate, triangulate_many, vertices
from triangulators.criteria import find
from triangulators.dropin import triangulate_float64
from triangulators.optimum.small_ring import ring_optimum
from triangulators.polygon import rings_of
from triangulators.verify import verify

CRITERIA = ("half-perimeter", "overdraw")
SCALES = (1.0, 0.1, 1 / 3)
PORTION = 500
CLOSE = 1e-9
"""Relative: sums of the same triangles in another order differ by less."""

Found = Counter[str]


def main() -> None:
    """Read the command line, compare, print and exit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["ways", "touching", "listed", "table"])
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    if given.what == "table":
        found = _table()
    else:
        portions = [given.seed + k for k in range(-(-given.count // PORTION))]
        compare = {"ways": _ways, "touching": _touching, "listed": _listed}[given.what]
        found = Counter()
        with ProcessPoolExecutor(given.processes) as pool:
            for each in pool.map(partial(compare, min(PORTION, given.count)), portions):
                found += each
    for name, count in sorted(found.items()):
        print(f"{name:<60} {count:>9,}")
    sys.exit(any("!" in name for name in found))


def _ways(count: int, seed: int) -> Found:
    """Compare the ways on polygons with 0 to 8 holes, on the grid and off it."""
    scale = SCALES[seed % len(SCALES)]
    found = _through_all(with_holes(scale, count, seed))
    found[f"polygons, coordinates times {scale:.3g}"] += count
    return found


def _touching(count: int, seed: int) -> Found:
    found = _through_all(list(touching_polygons(seed, count)))
    found["polygons whose rings touch"] += count
    return found


def _through_all(given: list[shapely.Polygon]) -> Found:
    found: Found = Counter()
    # Files are read so, and vertices are numbered in that order.
    polygons = list(shapely.orient_polygons(np.array(given)))
    for criterion in CRITERIA:
        name, total = f"optimal:{criterion}", find(criterion).total
        many = triangulate_many(polygons, name)
        found[f"! {criterion}: batch failed"] += len(many.failed)
        exported = dict(_exported(polygons, name))
        for number, polygon in enumerate(polygons):
            points = vertices(polygon)
            try:
                single = triangulate(polygon, name)
            except TriangulationError as error:
                found[f"! {criterion}: single failed"] += 1
                print(f"{criterion}: {error}: {shapely.to_wkt(polygon, -1)}", flush=True)
                continue
            ways = {"batch": many[number], "file": exported.get(number)}
            if criterion == "half-perimeter":
                flat = triangulate_float64(*rings_of(polygon))
                ways["drop-in"] = flat.reshape(-1, 3).astype(np.int32)
            least = total(points, single)
            found[f"! {criterion}: single invalid"] += not verify(polygon, single).conforming
            for way, triangles in ways.items():
                if triangles is None or not verify(polygon, triangles).conforming:
                    found[f"! {criterion}: {way} invalid"] += 1
                elif abs(total(points, triangles) - least) > CLOSE * abs(least):
                    found[f"! {criterion}: {way} differs from single"] += 1
                else:
                    found[f"{criterion}: {way} as single"] += 1
    return +found


def _exported(polygons: list[shapely.Polygon], name: str) -> Iterator[tuple[int, np.ndarray]]:
    """Yield (number, triangles) of a file that the command line triangulated."""
    with tempfile.TemporaryDirectory() as folder:
        source = write_geojson(Path(folder) / "in.geojson", polygons)
        target = Path(folder) / "out.npz"
        arguments = ["triangulate", str(source), "-o", str(target), "--triangulator", name]
        sys.argv = ["harness", *arguments, "--quiet"]
        try:
            with redirect_stdout(io.StringIO()):
                command_line()
        except SystemExit as end:
            if end.code:
                return
        with np.load(target) as arrays:
            corners, triangles = arrays["vertex_starts"], arrays["triangle_starts"]
            for row, number in enumerate(arrays["attribute_id"].tolist()):
                own = arrays["triangles"][triangles[row] : triangles[row + 1]] - corners[row]
                yield number, own.astype(np.int32)


def _listed(count: int, seed: int) -> Found:
    """Compare small polygons with 1 to 3 holes with the least of all their triangulations."""
    rng = np.random.default_rng(10_000 + seed)
    found: Found = Counter()
    while found["polygons listed"] < count:
        polygon = _small(rng)
        if polygon is None:
            continue
        found["polygons listed"] += 1
        found[f"with {len(polygon.interiors)} holes"] += 1
        for criterion in CRITERIA:
            least = least_of_all(polygon, COSTS[criterion])
            triangles = triangulate(polygon, f"optimal:{criterion}")
            cost = find(criterion).total(vertices(polygon), triangles)
            agrees = abs(cost - least) <= CLOSE * abs(least)
            found[f"{criterion}: the least" if agrees else f"! {criterion}: not the least"] += 1
            if not agrees:
                print(polygon.wkt, criterion, cost, least, flush=True)
    return found


def _small(rng: np.random.Generator) -> shapely.Polygon | None:
    """Return a polygon of integer vertices with 1 to 3 triangular holes, if one was hit upon."""
    polygon = random_simple(rng, int(rng.integers(3, 7)), 14)
    for _ in range(int(rng.integers(1, 4)) * 4):
        ring = shapely.get_coordinates(random_simple(rng, 3, 4))[:-1] + rng.integers(0, 12, 2)
        cut = shapely.Polygon(polygon.exterior, [*polygon.interiors, ring])
        if cut.is_valid and len(cut.interiors) <= 3:
            polygon = cut
    return polygon if polygon.interiors else None


def _half_perimeter(corners: np.ndarray) -> float:
    return float(np.ptp(corners, axis=0).sum())


def _overdraw(corners: np.ndarray) -> float:
    return float(np.ptp(corners, axis=0).prod() - abs(twice_area(*corners)) / 2)


COSTS: dict[str, Callable[[np.ndarray], float]] = {
    "half-perimeter": _half_perimeter,
    "overdraw": _overdraw,
}
"""What a triangle of corners (3, 2) costs, written apart from the product."""


def _table() -> Found:
    """Compare large simple polygons with the float64 table over all pairs."""
    found: Found = Counter()
    shapes = {"star": star, "smooth": smooth, "convex": convex}
    for n in (500, 1000, 2000, 4000, 6000):
        for shape, make in shapes.items():
            points = np.round(vertices(make(n)) * 256) / 256
            polygon = shapely.Polygon(points)
            if not polygon.is_valid:
                continue
            ring = np.ascontiguousarray(vertices(shapely.orient_polygons(polygon)))
            for criterion, box in zip(CRITERIA, ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), strict=True):
                total = find(criterion).total
                table = np.empty((len(ring) - 2, 3), dtype=np.int32)
                ring_optimum(ring, np.array(box), table)
                whole = total(ring, table)
                triangles = triangulate(polygon, f"optimal:{criterion}", limit=10_000)
                cost = total(vertices(polygon), triangles)
                agrees = abs(cost - whole) <= CLOSE * abs(whole)
                found[f"{criterion}: as the table" if agrees else f"! {criterion}: differs"] += 1
                print(f"{shape} {n}: {criterion} {cost:.6f}, table {whole:.6f}", flush=True)
    return found


if __name__ == "__main__":
    main()
