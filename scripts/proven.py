"""Print for each scene the number of proven optima, the largest gap and the times.

    PYTHONPATH=. python scripts/proven.py [--criterion NAME] [--holes] [--max-vertices 5000]
        [SCENE ...]

The time of a polygon is the sum of computing the optimum and checking the proof. Without holes and
with exact sums in doubles, the dynamic program is the proof.
"""

import argparse
import time
from itertools import chain

import numpy as np
from shapely import Polygon

from harness.frame import View, make_frame
from scenes import load
from triangulators import certify, triangulate, vertices

SCENES = ("city", "helsinki", "cad", "glyphs", "counties", "meshes", "stress")


def main() -> None:
    """Read the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenes", nargs="*", default=SCENES)
    parser.add_argument("--criterion", default="half-perimeter")
    parser.add_argument("--holes", action="store_true", help="only polygons with holes")
    parser.add_argument("--max-vertices", type=int, default=5000, help="skip larger polygons")
    parser.add_argument("--seconds", type=float, default=60.0, help="limit for a linear program")
    options = parser.parse_args()
    print(f"{'scene':<10} polygons  proven  largest gap  median ms  largest ms")
    rows = []
    for scene in options.scenes:
        frame = make_frame(load(scene).polygons, View())
        polygons = [p for p in frame.polygons if p.interiors or not options.holes]
        polygons = [p for p in polygons if len(vertices(p)) <= options.max_vertices]
        if polygons:
            _measure(polygons[:1], options.criterion, options.seconds)  # compile the kernels
            rows.append(_measure(polygons, options.criterion, options.seconds))
            _print_row(scene, *rows[-1])
    if len(rows) > 1:
        proven, gaps, times = zip(*rows, strict=True)
        _print_row("all", sum(proven), max(gaps), list(chain.from_iterable(times)))


def _print_row(name: str, proven: int, gap: float, times: list[float]) -> None:
    row = f"{name:<10} {len(times):>8} {proven:>7} {gap:>12.2g}"
    print(f"{row} {np.median(times):>10.1f} {max(times):>11.1f}", flush=True)


def _measure(
    polygons: list[Polygon], criterion: str, seconds: float
) -> tuple[int, float, list[float]]:
    """Return the number of proven optima, the largest gap and the times in ms."""
    proven, gap, times = 0, 0.0, []
    for polygon in polygons:
        start = time.perf_counter()
        triangles = triangulate(polygon, "optimal", criterion=criterion)
        certificate = certify(polygon, triangles, criterion, seconds=seconds, evidence=False)
        times.append((time.perf_counter() - start) * 1e3)
        proven += certificate.proven
        gap = max(gap, 0.0 if certificate.proven else certificate.gap)
    return proven, gap, times


if __name__ == "__main__":
    main()
