"""Compiles every kernel once, before the processes that run the tests start.

Otherwise each would compile them. Where nothing is compiled yet, two processes do half each.
"""

import subprocess
import sys

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, View, make_frame
from harness.heatmaps import lane_maps
from harness.measuring.lower_limits import fewest
from harness.measuring.pool import COMPILED_LATE
from harness.rasterisers import Options, find_device, get
from harness.rasterisers.reference import outlines
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons, warm_up
from scenes import load
from tests.paths import ROOT
from triangulators import certify, names, triangulate, triangulate_many
from triangulators.compute.compiled_files import is_kept

SCENES = ("city:buildings=3", "cad:parts=2,segments=12", "stress:vertices=12")
"""Small ones whose polygons go every way through the kernels: holes, many holes, none."""

LISTING = ("exhaustive", "listed", "pareto")

BESIDE = ("max-area", "greedy", "random", "pareto", "refined")
"""What the second process compiles: about half of all, and little that the others need, too."""


def compile_everything() -> None:
    """Call each kernel as the product calls it; next to no time where all are compiled."""
    known = [*names(available_only=True), "optimal:shape", "worst:half-perimeter"]
    if not is_kept(COMPILED_LATE):
        # A third reads the tests, so that three workers need not rewrite what they assert.
        reading = [sys.executable, "-m", "pytest", "--collect-only", "-q"]
        with (
            subprocess.Popen([sys.executable, "-m", "tests.compiling"], cwd=ROOT),
            subprocess.Popen(reading, cwd=ROOT, stdout=subprocess.DEVNULL),
        ):
            warm_up(*(parse(name) for name in known if name not in BESIDE))
            _scenes(known)
    warm_up(*map(parse, known))
    _scenes(known)


def _scenes(known: list[str], order: int = 1) -> None:
    """Go through the scenes from the first, 1, or from the last, -1.

    Two processes that come from both ends meet: what one compiles, the other loads.
    """
    known = [name for name in known if name not in LISTING]  # which take long for more than that
    for scene in SCENES[::order]:
        polygons = load(scene).polygons
        triangulate_many(polygons)
        frame = make_frame(polygons, View(64))
        triangulate_many(frame.polygons, device="llvmpipe")
        for name in known[::order]:
            found = triangulate_polygons(parse(name), frame.polygons)
        _rasterise(frame, frame.join(found.parts))
        outlines(frame, found.parts)
        fewest(frame, None)


def _rasterise(frame: Frame, triangles: NDArray[np.int32]) -> None:
    for rasteriser in (get(name)(find_device(name)) for name in ("reference", "binning")):
        rasteriser.count(frame, triangles, Options())
        if rasteriser.name == "reference":
            with rasteriser.prepare(frame, triangles, Options()) as drawing:
                drawing.sample(1)
    lane_maps(frame, triangles)


def _half() -> None:
    """Do the second process's half."""
    warm_up(*map(parse, BESIDE))
    polygons = load(SCENES[0]).polygons
    triangulate_many(polygons, "refined")
    frame = make_frame(polygons, View(64))
    found = triangulate_polygons(parse("ear-clipping"), frame.polygons)
    _rasterise(frame, frame.join(found.parts))
    for polygon in [each for scene in SCENES for each in load(scene).polygons[:3]]:
        certify(polygon, triangulate(polygon, "ear-clipping", repair=True), "overdraw")
    _scenes(names(available_only=True), -1)


if __name__ == "__main__":
    _half()
