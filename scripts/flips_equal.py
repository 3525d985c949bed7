"""Flip the same triangles in Python, JavaScript and C++, and with npm's earcut: count differences.

    PYTHONPATH=. python scripts/flips_equal.py --polygons 100000

All scenes in their own units, in pixels at 1024 px and in whole numbers of a tile's 4,096; the
polygons of ../shared/data; and random ones with holes, whole and real, collinear and touching.
Prints a row for each test; ends with 1 if any triangle differs or any triangulation is invalid.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from harness.frame import View, make_frame
from scenes import load
from tests.paths import ROOT
from tests.ports import languages
from tests.ports.languages import Cases, in_python, read
from tests.ports.polygons import Rings, is_as_before, random_polygons
from tests.triangulators.cases import shared_rings
from triangulators.criteria.catalogue import FLIP_TESTS
from triangulators.polygon import rings_of

SCENES = (
    *("city", "helsinki", "counties", "counties:level=state", "glyphs", "cad", "paper"),
    *("stress", "meshes"),
)
TILE = 4096.0


def of_scenes() -> Iterator[Rings]:
    """Yield the polygons of all scenes: as they are, snapped to pixels, and in a tile."""
    for name in SCENES:
        polygons = load(name).polygons
        for polygon in polygons:
            yield rings_of(polygon)
        for polygon in make_frame(polygons, View(1024)).polygons:
            points, ends = rings_of(polygon)
            yield points, ends
            low = points.min(axis=0)
            yield np.rint((points - low) * (TILE / max(np.ptp(points, axis=0).max(), 1.0))), ends


def of_others() -> Iterator[Rings]:
    """Yield the polygons of other people in ../shared/data, valid or not."""
    for name in ("earcut_fixtures.json", "poly2tri_testbed.json"):
        if (ROOT.parent / "shared" / "data" / name).exists():
            for _, rings in shared_rings(name):
                points = np.concatenate([ring.reshape(-1, 2) for ring in rings])
                yield points, np.cumsum([len(ring) for ring in rings])


def compare(label: str, polygons: list[Rings], program: Path, folder: Path) -> int:
    """Print a row for each test; return how many of them failed."""
    cases = Cases.of(polygons)
    cases.write(folder)
    languages.in_cpp(folder, program)
    languages.in_javascript(folder)
    failed = 0
    for by in (*FLIP_TESTS, "earcut-refine"):
        corners, flips = in_python(cases, by)
        theirs = [read(folder, language, by)[0] for language in ("javascript", "cpp")[: _ports(by)]]
        differing = sum(int((corners != other).sum()) for other in theirs)
        valid = is_as_before(cases, corners)
        failed += differing > 0 or not valid
        print(
            f"{label:8} {by:14} {len(polygons):9,} polygons {len(corners) // 3:12,} triangles "
            f"{int(flips.sum()):11,} flips {differing:6,} indices differ, "
            f"{'area, boundary and vertices as before' if valid else 'INVALID'}",
            flush=True,
        )
    return failed


def _ports(by: str) -> int:
    return 2 if by in FLIP_TESTS else 1  # C++ has no copy of earcut's own test


def main() -> int:
    """Compare everything; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--polygons", type=int, default=100_000, help="random polygons")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--compiler", default="", help="e.g. ziglang; by default the first here")
    given = parser.parse_args()
    compilers = [each for each in languages.compilers() if given.compiler in " ".join(each)]
    if not compilers or languages.node() is None or languages.earcut() is None:
        raise SystemExit("needs Node.js, a C++ compiler and, for npm's earcut, network")
    with tempfile.TemporaryDirectory() as folder:
        program = languages.compile_flips(Path(folder), compilers[0], "-O2")
        sets = {
            "scenes": list(of_scenes()),
            "shared": list(of_others()),
            "random": list(random_polygons(given.seed, given.polygons)),
        }
        failed = sum(
            compare(label, found, program, Path(folder)) for label, found in sets.items() if found
        )
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
