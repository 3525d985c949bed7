"""Time flips beside the ear clipping that they follow, in Python, JavaScript and C++.

    PYTHONPATH=. python scripts/flips_times.py --earcut-hpp FOLDER

FOLDER holds mapbox/earcut.hpp, which mapbox_earcut's source package brings; without it, C++ is not
timed. Prints a line of CSV for each scene, language and candidate: the least of several rounds, in
which a language's candidates follow each other, in ms for all polygons of a scene at 1024 px. What
JavaScript flips are npm earcut's triangles, what C++ flips earcut.hpp's. Needs a quiet machine, but
for ratios of C++: its times are the processor's.
"""

import argparse
import json
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mapbox_earcut

from harness.frame import View, make_frame
from scenes import load
from tests.ports import languages
from tests.ports.languages import HERE, Cases
from tests.ports.polygons import earcut_rings
from triangulators import triangulate_many
from triangulators.dropin import triangulate_float64
from triangulators.polygon_arrays import PolygonArray

SCENES = ("city", "glyphs", "counties:level=state", "counties")


def in_python(scene: str, polygons: list[Any], rings: list[Any], rounds: int) -> None:
    """Print the rows of Python; rings: (points, ring ends) of each polygon."""
    arrays = PolygonArray.from_shapely(polygons)
    candidates: dict[str, Callable[[], Any]] = {
        "earcut": lambda: [mapbox_earcut.triangulate_float64(*each) for each in rings],
        "with flips": lambda: [triangulate_float64(*each) for each in rings],
        "batch with flips": lambda: triangulate_many(arrays, "flips:l1"),
    }
    best = dict.fromkeys(candidates, float("inf"))
    for _ in range(rounds):
        for name, candidate in candidates.items():
            start = time.perf_counter()
            candidate()
            best[name] = min(best[name], (time.perf_counter() - start) * 1e3)
    show(scene, "Python", best)


def show(scene: str, language: str, times: dict[str, float]) -> None:
    """Print a row for each candidate."""
    for name, ms in times.items():
        print(f"{scene},{language},{name},{ms:.3f}", flush=True)


def in_another(scene: str, language: str, command: list[str]) -> None:
    """Print the rows of a program that prints its times in ms as one JSON object."""
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    show(scene, language, json.loads(done.stdout))


def main() -> None:
    """Time every scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--earcut-hpp", type=Path, help="folder that holds mapbox/earcut.hpp")
    parser.add_argument("--scenes", default=",".join(SCENES))
    parser.add_argument("--languages", default="Python,JavaScript,C++")
    parser.add_argument("--rounds", type=int, default=9)
    given = parser.parse_args()
    node, compilers, earcut = languages.node(), languages.compilers(), languages.earcut()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = folder / "times"
        if given.earcut_hpp and compilers and "C++" in given.languages:
            flags = ["-std=c++17", "-O2", f"-I{given.earcut_hpp}"]
            source = str(HERE / "times.cpp")
            subprocess.run([*compilers[0], *flags, source, "-o", str(program)], check=True)
        print("scene,language,candidate,ms")
        for scene in given.scenes.split(","):
            polygons = make_frame(load(scene).polygons, View(1024)).polygons
            rings = [earcut_rings(polygon) for polygon in polygons]
            if "Python" in given.languages:
                in_python(scene, polygons, rings, given.rounds)
            Cases.of(rings).write(folder, [ends for _, ends in rings])
            if node and earcut and "JavaScript" in given.languages:
                script = [node, str(HERE / "times.mjs"), name, str(earcut), str(given.rounds)]
                in_another(scene, "JavaScript", script)
            if program.exists():
                in_another(scene, "C++", [str(program), name, str(given.rounds)])


if __name__ == "__main__":
    main()
