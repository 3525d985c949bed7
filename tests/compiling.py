"""Compile every kernel once before the test processes start.

Otherwise each process would compile them. If the cache is empty, two processes compile half each.
"""

import subprocess
import sys

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, View, make_frame
from harness.heatmaps import make_lane_maps
from harness.measuring.pool import COMPILED_LATE
from harness.measuring.tasks import compute_min_quads
from harness.rasterisers import Options, find_device, get
from harness.rasterisers.reference import count_outline_quads
from harness.triangulating.recipes import parse
from harness.triangulating.triangulate import triangulate_polygons, warm_up
from scenes import load
from tests.paths import ROOT
from triangulators import certify, names, triangulate, triangulate_many
from triangulators.compute.compiled_files import is_cached

SCENES = ("city:buildings=3", "cad:parts=2,segments=12", "stress:vertices=12")
"""Small scenes that cover all kernels: polygons with holes, with many holes, without holes."""

SLOW = ("exhaustive", "listed", "pareto")

SECOND_HALF = ("max-area", "greedy", "random", "pareto", "refined")
"""Triangulators compiled by the second process: about half, with little overlap."""


def compile_everything() -> None:
    """Call each kernel as the product does; fast if all are compiled."""
    names_to_compile = [*names(available_only=True), "optimal:shape", "worst:half-perimeter"]
    if not is_cached(COMPILED_LATE):
        # A third process imports the tests, so that pytest rewrites their assertions only once.
        collect = [sys.executable, "-m", "pytest", "--collect-only", "-q"]
        with (
            subprocess.Popen([sys.executable, "-m", "tests.compiling"], cwd=ROOT),
            subprocess.Popen(collect, cwd=ROOT, stdout=subprocess.DEVNULL),
        ):
            warm_up(*(parse(name) for name in names_to_compile if name not in SECOND_HALF))
            _compile_scenes(names_to_compile)
    warm_up(*map(parse, names_to_compile))
    _compile_scenes(names_to_compile)


def _compile_scenes(candidates: list[str], order: int = 1) -> None:
    """Compile the kernels for the scenes, from the first (order 1) or the last (order -1).

    Two processes that start from both ends load each other's results once they meet.
    """
    candidates = [name for name in candidates if name not in SLOW]  # slow for these scenes
    for scene in SCENES[::order]:
        polygons = load(scene).polygons
        triangulate_many(polygons)
        frame = make_frame(polygons, View(64))
        triangulate_many(frame.polygons, device="llvmpipe")
        for name in candidates[::order]:
            triangulation = triangulate_polygons(parse(name), frame.polygons)
        _rasterise(frame, frame.join_triangles(triangulation.parts))
        count_outline_quads(frame, triangulation.parts)
        compute_min_quads(frame, None)


def _rasterise(frame: Frame, triangles: NDArray[np.int32]) -> None:
    for rasteriser in (get(name)(find_device(name)) for name in ("reference", "binning")):
        rasteriser.draw_and_count(frame, triangles, Options())
        if rasteriser.name == "reference":
            with rasteriser.prepare(frame, triangles, Options()) as drawing:
                drawing.sample(1)
    make_lane_maps(frame, triangles)


def _compile_second_half() -> None:
    warm_up(*map(parse, SECOND_HALF))
    polygons = load(SCENES[0]).polygons
    triangulate_many(polygons, "refined")
    frame = make_frame(polygons, View(64))
    triangulation = triangulate_polygons(parse("ear-clipping"), frame.polygons)
    _rasterise(frame, frame.join_triangles(triangulation.parts))
    for polygon in [shape for scene in SCENES for shape in load(scene).polygons[:3]]:
        certify(polygon, triangulate(polygon, "ear-clipping", repair=True), "overdraw")
    _compile_scenes(names(available_only=True), -1)


if __name__ == "__main__":
    _compile_second_half()
