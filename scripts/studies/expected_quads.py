"""Measure what few expected quads cost: CPU time relative to ear clipping, one call per polygon.

    PYTHONPATH=. python scripts/studies/expected_quads.py > results/reference/expected-quads.csv

Print a line of CSV for each scene and triangulator at 1024 px: the minimum CPU time of a pass over
all polygons, its ratio to ear clipping's, the expected quads, and their excess over the optimum's.
The passes of all triangulators alternate in one process on one core.
"""

import argparse
import time
from collections.abc import Sequence

from shapely import Polygon

from harness.frame import View, make_frame
from scenes import load
from triangulators import triangulate, vertices
from triangulators.criteria import find

SCENES = "city,glyphs,helsinki,paper,cad,stress"
BASE, REFINED, OPTIMUM = "ear-clipping", "refined:expected-quads", "optimal:expected-quads"
TRIANGULATORS = (BASE, "refined:half-perimeter", REFINED, "optimal:half-perimeter", OPTIMUM)
SLOW_S = 30.0  # a pass that takes longer is not repeated


def load_polygons(scene: str) -> list[Polygon]:
    """Return the polygons of a scene at 1024 px, snapped to the grid."""
    return list(make_frame(load(scene).polygons, View(1024)).polygons)


def measure(
    polygons: Sequence[Polygon], names: Sequence[str], rounds: int
) -> dict[str, tuple[float, float]]:
    """Return the minimum CPU time in s of a pass over all polygons, and the expected quads.

    The first pass of each triangulator may compile; its time counts only if it is not repeated.
    """
    times: dict[str, list[float]] = {name: [] for name in names}
    quads = {}
    criterion = find("expected-quads")
    for _ in range(rounds + 1):
        for name, values in times.items():
            if values and values[-1] > SLOW_S:
                continue
            start = time.process_time()
            results = [triangulate(polygon, name) for polygon in polygons]
            values.append(time.process_time() - start)
            if name not in quads:
                pairs = zip(polygons, results, strict=True)
                quads[name] = sum(criterion.total(vertices(p), rows) for p, rows in pairs)
    return {name: (min(values[1:] or values), quads[name]) for name, values in times.items()}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default=SCENES)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    print("scene,triangulator,cpu_ms,ratio,quads,excess")
    for scene in options.scenes.split(","):
        polygons = load_polygons(scene)
        results = measure(polygons, TRIANGULATORS, options.rounds)
        for name, (cpu_s, quads) in results.items():
            ratio = cpu_s / results[BASE][0]
            excess = quads / results[OPTIMUM][1] - 1.0
            print(f"{scene},{name},{1e3 * cpu_s:.2f},{ratio:.2f},{quads:.1f},{excess:.4f}")


if __name__ == "__main__":
    main()
