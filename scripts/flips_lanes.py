"""Count what flips after ear clipping save: helper lanes and partial quads beside ear clipping's.

    PYTHONPATH=. python scripts/flips_lanes.py --scenes city,glyphs --pixels 64,512,1024

Each polygon is drawn alone, its larger side two pixels short of the viewport, its vertices snapped
to 1/256 px, and counted by the exact reference. Prints a line of CSV for each scene, size and
triangulator: both in ratio to ear clipping's, geometric means over polygons that it leaves a helper
lane.
"""

import argparse

import numpy as np

from harness.frame import View, make_frame
from harness.rasterisers.reference import predict
from scenes import load
from triangulators import triangulate_many, vertices

USUAL = "ear-clipping"
OTHERS = (
    *("earcut-refine", "delaunay", "flips:beauty", "flips:l1", "flips:euclidean"),
    *("refined:half-perimeter", "optimal:half-perimeter"),
)
COUNTED = ("helper_lanes", "partial_quads")


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--scenes", default="city,helsinki,glyphs,cad,counties:level=state,counties"
    )
    parser.add_argument("--pixels", default="64,512,1024")
    given = parser.parse_args()
    print(f"scene,px,polygons,triangulator,{','.join(COUNTED)}")
    for scene in given.scenes.split(","):
        polygons = load(scene).polygons
        for pixels in map(int, given.pixels.split(",")):
            alone = [make_frame([each], View(pixels)).polygons for each in polygons]
            drawn = [each[0] for each in alone if len(each)]
            points = [np.rint(vertices(each) * 256.0).astype(np.int32) for each in drawn]
            counts = {}
            for name in (USUAL, *OTHERS):
                ways = zip(points, triangulate_many(drawn, name), strict=True)
                found = [predict(*way) for way in ways]
                counts[name] = np.array([[each[c].sum() for c in COUNTED] for each in found], float)
            some = counts[USUAL][:, 0] > 0
            for name in OTHERS:
                ratios = np.maximum(counts[name][some], 1) / counts[USUAL][some]
                means = ",".join(f"{mean:.6f}" for mean in np.exp(np.log(ratios).mean(axis=0)))
                print(f"{scene},{pixels},{some.sum()},{name},{means}", flush=True)


if __name__ == "__main__":
    main()
