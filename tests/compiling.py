"""Compiles every kernel once, before the processes that run the tests start.

Otherwise each would compile them, and Numba's index of a function's compiled forms can be torn by
two that add to it at the same time.
"""

from __future__ import annotations

from harness.frame import View, make_frame
from harness.heatmaps import lane_maps
from harness.rasterisers import Options, find_device, get
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.names import parse
from scenes import load
from triangulators import names, triangulate_many, warm_up

SCENES = ("city:buildings=3", "cad:parts=2,segments=12", "stress:vertices=12")
"""Small ones whose polygons go every way through the kernels: holes, many holes, none."""

LISTING = ("exhaustive", "listed", "pareto")


def compile_everything() -> None:
    """Call each kernel as the product calls it; next to no time where all are compiled."""
    known = [*names(available_only=True), "optimal:shape", "worst:half-perimeter"]
    warm_up(known)
    known = [name for name in known if name not in LISTING]  # which take long for more than that
    for scene in SCENES:
        polygons = load(scene).polygons
        triangulate_many(polygons)
        frame = make_frame(polygons, View(64))
        for name in known:
            found = triangulate_polygons(parse(name), frame.polygons)
        triangles = frame.join(found.parts)
        for rasteriser in (get(name)(find_device(name)) for name in ("reference", "binning")):
            rasteriser.count(frame, triangles, Options())
            if rasteriser.pictured:
                rasteriser.image(frame, triangles, Options())
        lane_maps(frame, triangles)
