"""Count what flips after ear clipping save: helper lanes in ratio to ear clipping's.

    PYTHONPATH=. python scripts/flips_lanes.py --scenes city,glyphs --pixels 64,512,1024

Each polygon is drawn alone, its larger side as long as the viewport, its vertices snapped to 1/256
px, and counted by the exact reference. Prints a Markdown row for each scene and size: geometric
means over polygons that ear clipping leaves a helper lane.
"""

from __future__ import annotations

import argparse

import numpy as np

from harness.frame import View, make_frame
from harness.rasterisers.reference import predict
from scenes import load
from triangulators import triangulate_many, vertices

USUAL = "ear-clipping"
OTHERS = ("earcut-refine", "delaunay", "flips:l1", "flips:euclidean", "refined:half-perimeter")


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default="city,helsinki,glyphs,cad,counties:level=state")
    parser.add_argument("--pixels", default="64,512,1024")
    given = parser.parse_args()
    print(f"| scene | px | polygons | {' | '.join(OTHERS)} |\n|---|---|---|{'---|' * len(OTHERS)}")
    for scene in given.scenes.split(","):
        polygons = load(scene).polygons
        for pixels in map(int, given.pixels.split(",")):
            alone = [make_frame([each], View(pixels)).polygons for each in polygons]
            drawn = [each[0] for each in alone if len(each)]
            points = [np.rint(vertices(each) * 256.0).astype(np.int32) for each in drawn]
            lanes = {name: [0] * len(drawn) for name in (USUAL, *OTHERS)}
            for name, counts in lanes.items():
                for index, triangles in enumerate(triangulate_many(drawn, name)):
                    counts[index] = int(predict(points[index], triangles)["helper_lanes"].sum())
            usual = np.array(lanes[USUAL], dtype=float)
            some = usual > 0
            means = [
                np.exp(np.log(np.maximum(lanes[name], 1)[some] / usual[some]).mean())
                for name in OTHERS
            ]
            figures = " | ".join(f"{mean:.3f}" for mean in means)
            print(f"| {scene} | {pixels} | {int(some.sum()):,} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
