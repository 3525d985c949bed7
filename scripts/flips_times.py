"""Time flips and the ear clipping before them, in Python, JavaScript and C++.

    PYTHONPATH=. python scripts/flips_times.py --earcut-hpp FOLDER

FOLDER holds mapbox/earcut.hpp, from the source package of mapbox_earcut; without FOLDER, C++ is not
timed. Print a line of CSV for each scene, language and candidate: the minimum over several rounds,
in ms for all polygons of a scene at 1024 px. In a round the candidates of a language follow each
other. JavaScript flips the triangles of npm's earcut, C++ those of earcut.hpp. Flips end in a walk,
except "native" ones. Needs a quiet machine, except for ratios of C++, which measures CPU time.
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
from tests.ports.languages import FOLDER, Cases
from tests.ports.polygons import earcut_rings
from triangulators import triangulate_many
from triangulators.dropin import triangulate_float64
from triangulators.polygon_arrays import PolygonArray

SCENES = ("city", "glyphs", "counties:level=state", "counties")


def time_python(scene: str, polygons: list[Any], rings: list[Any], rounds: int) -> None:
    """Print the rows of Python; rings: (points, ring ends) for each polygon."""
    arrays = PolygonArray.from_shapely(polygons)
    candidates: dict[str, Callable[[], Any]] = {
        "earcut": lambda: [mapbox_earcut.triangulate_float64(*polygon) for polygon in rings],
        "with flips": lambda: [triangulate_float64(*polygon) for polygon in rings],
        "with flips native": lambda: [
            triangulate_float64(*polygon, order="native") for polygon in rings
        ],
        "batch with flips": lambda: triangulate_many(arrays, "flips:l1"),
        "batch with quads": lambda: triangulate_many(arrays, "flips:expected-quads"),
        "batch with flips native": lambda: triangulate_many(arrays, "flips:l1", order="native"),
    }
    minima = dict.fromkeys(candidates, float("inf"))
    for _ in range(rounds):
        for name, candidate in candidates.items():
            start = time.perf_counter()
            candidate()
            minima[name] = min(minima[name], (time.perf_counter() - start) * 1e3)
    print_rows(scene, "Python", minima)


def print_rows(scene: str, language: str, times: dict[str, float]) -> None:
    """Print a row for each candidate."""
    for name, ms in times.items():
        print(f"{scene},{language},{name},{ms:.3f}", flush=True)


def time_program(scene: str, language: str, command: list[str]) -> None:
    """Print the rows of a program that prints its times in ms as one JSON object."""
    process = subprocess.run(command, capture_output=True, text=True, check=True)
    print_rows(scene, language, json.loads(process.stdout))


def main() -> None:
    """Time every scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--earcut-hpp", type=Path, help="folder that holds mapbox/earcut.hpp")
    parser.add_argument("--scenes", default=",".join(SCENES))
    parser.add_argument("--languages", default="Python,JavaScript,C++")
    parser.add_argument("--rounds", type=int, default=9)
    options = parser.parse_args()
    node, compilers = languages.find_node(), languages.find_compilers()
    earcut = languages.find_earcut()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = folder / "times"
        if options.earcut_hpp and compilers and "C++" in options.languages:
            flags = ["-std=c++17", "-O2", f"-I{options.earcut_hpp}"]
            source = str(FOLDER / "times.cpp")
            subprocess.run([*compilers[0], *flags, source, "-o", str(program)], check=True)
        print("scene,language,candidate,ms")
        for scene in options.scenes.split(","):
            polygons = make_frame(load(scene).polygons, View(1024)).polygons
            rings = [earcut_rings(polygon) for polygon in polygons]
            if "Python" in options.languages:
                time_python(scene, polygons, rings, options.rounds)
            Cases.of(rings).write(folder, [ends for _, ends in rings])
            if node and earcut and "JavaScript" in options.languages:
                script = [node, str(FOLDER / "times.mjs"), name, str(earcut), str(options.rounds)]
                time_program(scene, "JavaScript", script)
            if program.exists():
                time_program(scene, "C++", [str(program), name, str(options.rounds)])


if __name__ == "__main__":
    main()
