"""Compiles every kernel once, before the processes that run the tests start.

Otherwise each would compile them, and Numba's index of a function's compiled forms can be torn by
two that add to it at the same time. Where nothing is compiled yet, two processes do half each: the
second into a cache of its own, of which what the first lacks is then taken over.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.frame import Frame, View, make_frame
from harness.pictures.heatmaps import lane_maps
from harness.rasterisers import Options, find_device, get
from harness.triangulating.frames import triangulate_polygons
from harness.triangulating.names import parse
from scenes import load
from tests.paths import ROOT
from triangulators import names, triangulate_many, warm_up

SCENES = ("city:buildings=3", "cad:parts=2,segments=12", "stress:vertices=12")
"""Small ones whose polygons go every way through the kernels: holes, many holes, none."""

LISTING = ("exhaustive", "listed", "pareto")

BESIDE = ("max-area", "greedy", "random", "pareto", "refined")
"""What the second process compiles: about half of all, and little that the others need, too."""


def compile_everything() -> None:
    """Call each kernel as the product calls it; next to no time where all are compiled."""
    known = [*names(available_only=True), "optimal:shape", "worst:half-perimeter"]
    if any((ROOT / "triangulators").rglob("order.*.nbi")) or "NUMBA_CACHE_DIR" in os.environ:
        warm_up(known)
    else:
        with tempfile.TemporaryDirectory() as folder:
            environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
            command = [sys.executable, "-m", "tests.compiling"]
            with subprocess.Popen(command, cwd=ROOT, env=environment) as second:
                warm_up([name for name in known if name not in BESIDE])
                second.wait()
            _take_over(Path(folder))
        warm_up(known)
    known = [name for name in known if name not in LISTING]  # which take long for more than that
    for scene in SCENES:
        polygons = load(scene).polygons
        triangulate_many(polygons)
        frame = make_frame(polygons, View(64))
        triangulate_many(frame.polygons, device="llvmpipe")
        for name in known:
            found = triangulate_polygons(parse(name), frame.polygons)
        _rasterise(frame, frame.join(found.parts))


def _rasterise(frame: Frame, triangles: NDArray[np.int32]) -> None:
    for rasteriser in (get(name)(find_device(name)) for name in ("reference", "binning")):
        rasteriser.count(frame, triangles, Options())
        if rasteriser.pictured:
            rasteriser.image(frame, triangles, Options())
    lane_maps(frame, triangles)


def _take_over(folder: Path) -> None:
    """Copy what another process compiled of functions that have no compiled form here."""
    sources = {path.parent for part in ("triangulators", "harness") for path in _modules(part)}
    for source in sources:
        # Numba's name for a folder of sources in a cache that is elsewhere.
        digest = hashlib.sha1(str(source).encode(), usedforsecurity=False).hexdigest()
        for index in (folder / f"{source.name}_{digest}").glob("*.nbi"):
            here = source / "__pycache__" / index.name
            if not here.exists():
                here.parent.mkdir(exist_ok=True)
                for data in index.parent.glob(f"{index.stem}.*.nbc"):
                    shutil.copy2(data, here.parent)
                shutil.copy2(index, here)


def _modules(package: str) -> list[Path]:
    return list((ROOT / package).rglob("*.py"))


def _half() -> None:
    """Do the second process's half."""
    warm_up(BESIDE)
    triangulate_many(load(SCENES[0]).polygons, "refined")
    polygons = load(SCENES[0]).polygons
    frame = make_frame(polygons, View(64))
    found = triangulate_polygons(parse("ear-clipping"), frame.polygons)
    _rasterise(frame, frame.join(found.parts))


if __name__ == "__main__":
    _half()
