"""Compare the optimum that a device computes with the CPU's, triangle for triangle.

    PYTHONPATH=. python scripts/gpu_equal.py 1000000 --device llvmpipe

Footprints of generated cities on the grid of 1/256 m, until the device has done so many; all scenes
in pixels. Prints a row for each: polygons, how many of them the device did (the others have holes,
over 64 vertices or no grid), and how many differ; ends with 1 if any does, or it did none. The
worst is compared too, but for the footprints.
"""

import argparse
import sys
from itertools import product

import numpy as np
import shapely

from harness.frame import View, make_frame
from scenes import load
from triangulators import Ragged, triangulate_many
from triangulators.gpu import engine
from triangulators.ragged import ragged

NAMES = ("optimal:half-perimeter", "worst:half-perimeter")
SCENES = ("city", "helsinki", "cad", "glyphs", "counties", "meshes", "stress", "paper")
VIEWS = (View(256), View(1024, 30.0), View(4096))
A_CITY = 100_000
MIDDLE_M = 6000.0
"""Moves a city of that size to where no coordinate is negative."""


class Comparison:
    """Compares batches; counts what the device did of each, and what differs."""

    def __init__(self, device: str) -> None:
        self.device = device
        self.on_device = self.differing = 0
        attempt = engine.attempt

        def counted(name: str, task: engine.Task) -> None:
            attempt(name, task)
            self.on_device += int(task.batch.done.sum())

        engine.attempt = counted

    def compare(self, what: str, polygons: list[shapely.Polygon] | Ragged, name: str) -> None:
        """Compare one batch and print its row."""
        before = self.on_device
        found = triangulate_many(polygons, name, device=self.device)
        expected = triangulate_many(polygons, name, device="cpu")
        differing = int(found.failed != expected.failed)
        if not np.array_equal(found.starts, expected.starts):
            differing += len(found)
        elif not np.array_equal(found.triangles, expected.triangles):
            rows = (found.triangles != expected.triangles).any(axis=1)
            differing += int((np.add.reduceat(rows, found.starts[:-1]) > 0).sum())
        self.differing += differing
        row = f"{len(found):>10,} {self.on_device - before:>10,} {differing:>10,}"
        print(f"{what:<44} {row}", flush=True)


def main() -> None:
    """Compare, print and exit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("footprints", type=int, nargs="?", default=100_000)
    parser.add_argument("--device", default="llvmpipe")
    parser.add_argument("--footprints-only", action="store_true")
    given = parser.parse_args()
    print(", ".join(engine.describe(given.device)))
    print(f"{'':<44} {'polygons':>10} {'on device':>10} {'differing':>10}")
    comparison = Comparison(given.device)
    for scene, view in product(() if given.footprints_only else SCENES, VIEWS):
        frame = make_frame(load(scene).polygons, view)
        for name in NAMES:
            what = f"{scene}, {view.resolution} px, {view.rotation:g} degrees"
            comparison.compare(f"{what}, {name.partition(':')[0]}", frame.polygons, name)
    seed, before = 0, comparison.on_device
    while comparison.on_device - before < given.footprints:
        left = given.footprints - (comparison.on_device - before)
        count = min(A_CITY, left + left // 8 + 100)
        city = ragged(load(f"city:buildings={count},seed={seed}").polygons)
        points = np.round((city.coordinates + MIDDLE_M) * 256) / 256
        arrays = Ragged(points, city.ring_ends, city.polygon_ends)
        comparison.compare(f"footprints, seed {seed}", arrays, NAMES[0])
        seed += 1
    print(f"footprints on the device: {comparison.on_device - before:,}")
    print(f"all: {comparison.on_device:,} on the device, {comparison.differing:,} differ")
    sys.exit(comparison.differing > 0 or comparison.on_device == 0)


if __name__ == "__main__":
    main()
