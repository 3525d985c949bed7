"""Compiles every kernel once, before the processes that run the tests start.

Otherwise each would compile them, and Numba's index of a function's compiled forms can be torn by
two that add to it at the same time.
"""

from __future__ import annotations

import numpy as np

from harness.frame import View, make_frame
from harness.heatmaps import lane_maps
from harness.rasterisers import Options, find_device, get
from scenes import load
from triangulators import names, triangulate, warm_up

SQUARES = "city:buildings=2"


def compile_everything() -> None:
    """Call each kernel as the product calls it; next to no time where all are compiled."""
    warm_up([*names(available_only=True), "optimal:shape", "worst:half-perimeter"])
    frame = make_frame(load(SQUARES).polygons, View(64))
    triangles = frame.join([triangulate(polygon, "delaunay") for polygon in frame.polygons])
    for name in ("reference", "binning"):
        rasteriser = get(name)(find_device(name))
        rasteriser.count(frame, triangles, Options())
        if rasteriser.pictured:
            rasteriser.image(frame, triangles, Options())
    lane_maps(frame, np.asarray(triangles))
