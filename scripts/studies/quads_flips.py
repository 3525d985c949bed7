"""Count what flips by expected quads save over ear clipping and over flips by L1.

    PYTHONPATH=. python scripts/studies/quads_flips.py > results/reference/quads-flips.csv

All polygons of a scene are drawn together, in each triangulator's order (a walk except for ear
clipping). Print a line of CSV for each scene, size and triangulator: the sums of the exact
reference's counters, the vertex batches, and each relative to flips by L1.
"flips:expected-quads_at_1024_px" flips at the scale of 1024 px, and is drawn at the size of the
row.
"""

import argparse
from collections.abc import Sequence

import numpy as np

from harness.frame import Frame, View, make_frame
from harness.rasterisers.reference import count_per_triangle
from harness.rasterisers.vertex_batches import count_batches
from scenes import load
from triangulators import flip, triangulate_many, vertices

SCENES = "city,helsinki,glyphs,counties:level=state"
PIXELS = (1024, 512, 64)
BASE, QUADS = "flips:l1", "flips:expected-quads"
FIXED = f"{QUADS}_at_{PIXELS[0]}_px"
COUNTERS = ("helper_lanes", "covering_triangles", "batches")


def count(frame: Frame, triangulations: Sequence[np.ndarray]) -> dict[str, int]:
    """Return the sums of COUNTERS of a drawn frame."""
    triangles = frame.join_triangles(triangulations)
    sums = {
        name: int(values.sum())
        for name, values in count_per_triangle(frame.points, triangles).items()
    }
    return {name: sums[name] for name in COUNTERS[:-1]} | {"batches": count_batches(triangles)[0]}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default=SCENES)
    options = parser.parse_args()
    print(f"scene,px,triangulator,{','.join(COUNTERS)},{','.join(f'{c}_ratio' for c in COUNTERS)}")
    for scene in options.scenes.split(","):
        polygons = load(scene).polygons
        for pixels in PIXELS:
            frame = make_frame(polygons, View(pixels))
            names = ("ear-clipping", BASE, QUADS)
            results = {name: list(triangulate_many(frame.polygons, name)) for name in names}
            results[FIXED] = [
                flip(vertices(polygon), triangles, "expected-quads", scale=PIXELS[0] / pixels)
                for polygon, triangles in zip(frame.polygons, results["ear-clipping"], strict=True)
            ]
            counts = {name: count(frame, triangles) for name, triangles in results.items()}
            for name, row in counts.items():
                ratios = [f"{row[c] / counts[BASE][c]:.4f}" for c in COUNTERS]
                print(scene, pixels, name, *row.values(), *ratios, sep=",", flush=True)


if __name__ == "__main__":
    main()
