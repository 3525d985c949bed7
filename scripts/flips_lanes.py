"""Count helper lanes and partial quads of flips, relative to ear clipping.

    PYTHONPATH=. python scripts/flips_lanes.py --scenes city,glyphs --pixels 64,512,1024

Each polygon is alone in a viewport, with the longer side two pixels shorter than the viewport and
vertices snapped to 1/256 px, and is counted by the exact reference. Print a line of CSV for each
scene, size and triangulator: the geometric means of both ratios over the polygons where ear
clipping has helper lanes.
"""

import argparse

import numpy as np

from harness.frame import View, make_frame
from harness.rasterisers.reference import count_per_triangle
from scenes import load
from triangulators import triangulate_many, vertices

BASELINE = "ear-clipping"
CANDIDATES = (
    *("earcut-refine", "delaunay", "flips:beauty", "flips:l1", "flips:euclidean"),
    *("refined:half-perimeter", "optimal:half-perimeter"),
)
COUNTERS = ("helper_lanes", "partial_quads")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--scenes", default="city,helsinki,glyphs,cad,counties:level=state,counties"
    )
    parser.add_argument("--pixels", default="64,512,1024")
    options = parser.parse_args()
    print(f"scene,px,polygons,triangulator,{','.join(COUNTERS)}")
    for scene in options.scenes.split(","):
        polygons = load(scene).polygons
        for pixels in map(int, options.pixels.split(",")):
            frames = [make_frame([polygon], View(pixels)).polygons for polygon in polygons]
            shapes = [frame[0] for frame in frames if len(frame)]
            points = [np.rint(vertices(shape) * 256.0).astype(np.int32) for shape in shapes]
            counts = {}
            for name in (BASELINE, *CANDIDATES):
                pairs = zip(points, triangulate_many(shapes, name), strict=True)
                predictions = [count_per_triangle(*pair) for pair in pairs]
                sums = [[counted[c].sum() for c in COUNTERS] for counted in predictions]
                counts[name] = np.array(sums, float)
            has_helpers = counts[BASELINE][:, 0] > 0
            for name in CANDIDATES:
                ratios = np.maximum(counts[name][has_helpers], 1) / counts[BASELINE][has_helpers]
                means = ",".join(f"{mean:.6f}" for mean in np.exp(np.log(ratios).mean(axis=0)))
                print(f"{scene},{pixels},{has_helpers.sum()},{name},{means}", flush=True)


if __name__ == "__main__":
    main()
