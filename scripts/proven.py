"""Print, for each scene, how many polygons' optimum is proven, the largest gap and the times.

    PYTHONPATH=. python scripts/proven.py [--criterion NAME] [--holes] [--most 5000] [SCENE ...]

A polygon's time is that of finding the optimum and of checking the proof, together. Where there are
no holes and sums in doubles are exact, the table is the proof.
"""

import argparse
import time

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
    parser.add_argument("--most", type=int, default=5000, help="vertices of a polygon at most")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each linear program")
    given = parser.parse_args()
    print(f"{'scene':<10} polygons  proven  largest gap  median ms  largest ms")
    rows = []
    for name in given.scenes:
        frame = make_frame(load(name).polygons, View())
        chosen = [p for p in frame.polygons if p.interiors or not given.holes]
        chosen = [p for p in chosen if len(vertices(p)) <= given.most]
        if chosen:
            _measure(chosen[:1], given.criterion, given.seconds)  # compiles
            rows.append(_measure(chosen, given.criterion, given.seconds))
            _print(name, *rows[-1])
    if len(rows) > 1:
        proven, gaps, times = zip(*rows, strict=True)
        _print("all", sum(proven), max(gaps), [each for some in times for each in some])


def _print(name: str, proven: int, gap: float, times: list[float]) -> None:
    row = f"{name:<10} {len(times):>8} {proven:>7} {gap:>12.2g}"
    print(f"{row} {np.median(times):>10.1f} {max(times):>11.1f}", flush=True)


def _measure(
    polygons: list[Polygon], criterion: str, seconds: float
) -> tuple[int, float, list[float]]:
    """Return how many are proven, the largest gap and the times in ms."""
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
