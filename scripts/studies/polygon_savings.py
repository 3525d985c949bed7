"""Count the quads of each polygon of a scene, triangulated in three ways.

    PYTHONPATH=. python scripts/studies/polygon_savings.py --scene city --pixels 1024

The scene fills a viewport of this side, and the exact reference counts. Print a line of CSV for
each polygon: its number in the scene, the pixels per unit of the scene, and the quads of each
triangulator. docs/try/build.py chooses the page's first polygon from it.
"""

import argparse

import numpy as np

from harness.frame import View, make_scene_frame
from harness.rasterisers.reference import count_per_triangle
from scenes import load
from triangulators import triangulate

TRIANGULATORS = ("ear-clipping", "optimal:half-perimeter", "optimal:expected-quads")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scene", default="city")
    parser.add_argument("--pixels", type=int, default=1024)
    options = parser.parse_args()
    frame = make_scene_frame(load(options.scene, attributes=False), View(options.pixels))
    columns = []
    for name in TRIANGULATORS:
        triangles = frame.join_triangles([triangulate(polygon, name) for polygon in frame.polygons])
        quads = count_per_triangle(frame.points, triangles)["quads"]
        columns.append(
            np.bincount(frame.find_owners(triangles), quads, len(frame.source)).astype(int)
        )
    print(",".join(("polygon", "scale", *TRIANGULATORS)))
    for number, *quads in zip(frame.source, *columns, strict=True):
        print(",".join(map(str, (number, f"{frame.scale:.9g}", *quads))))


if __name__ == "__main__":
    main()
