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
SLOW_S = 3.0  # a pass that takes longer, at compilation or later, is not repeated


def load_polygons(scene: str) -> list[Polygon]:
    """Return the polygons of a scene at 1024 px, snapped to the grid."""
    return list(make_frame(load(scene).polygons, View(1024)).polygons)


def measure(polygons: Sequence[Polygon], names: Sequence[str], rounds: int) -> dict[str, float]:
    """Return the minimum CPU time in s of a pass over all polygons, of each triangulator."""
    times: dict[str, list[float]] = {name: [] for name in names}
    for number in range(rounds + 2):
        for name in names:
            if number > 1 and times[name][-1] > SLOW_S:
                continue
            start = time.process_time()
            for polygon in polygons:
                triangulate(polygon, name)
            times[name].append(time.process_time() - start)
    return {name: min(values[1:]) for name, values in times.items()}  # the first pass compiles


def sum_quads(polygons: Sequence[Polygon], name: str) -> float:
    """Return the expected quads of all polygons."""
    criterion = find("expected-quads")
    return sum(criterion.total(vertices(each), triangulate(each, name)) for each in polygons)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default=SCENES)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    print("scene,triangulator,cpu_ms,ratio,quads,excess")
    for scene in options.scenes.split(","):
        polygons = load_polygons(scene)
        cpu_s = measure(polygons, TRIANGULATORS, options.rounds)
        quads = {name: sum_quads(polygons, name) for name in TRIANGULATORS}
        for name, seconds in cpu_s.items():
            excess = quads[name] / quads[OPTIMUM] - 1.0
            ratio = seconds / cpu_s[BASE]
            print(f"{scene},{name},{1e3 * seconds:.2f},{ratio:.2f},{quads[name]:.1f},{excess:.4f}")


if __name__ == "__main__":
    main()
