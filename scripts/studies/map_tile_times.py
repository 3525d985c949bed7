"""Time what docs/studies/map-tiles.md compares: to draw tiles, to triangulate them, and where.

    PYTHONPATH=. python scripts/studies/map_tile_times.py --out results/map-tiles [--second FOLDER]

Each data set and zoom is a run on llvmpipe, then Node.js and Python triangulate its polygons. Rows
of `times.csv` are ms a tile, by where: draw (with the ratio to ear clipping's and its interval),
server, browser and python. `machine.csv` says in which state the machine was. Needs a quiet
machine; a zoom that is there is not timed again.
"""

from __future__ import annotations

import csv
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mapbox_earcut

from harness.frame import Frame, frame_of, view_of
from scenes import Scene, load
from scripts.studies.map_tiles import NAMES, append, arguments, done, subjects
from tests.ports import languages
from tests.ports.languages import HERE, Cases
from triangulators.polygon import rings_of

ROUNDS = 9
DEVICE = "llvmpipe"
TIMES = ("data", "zoom", "where", "name", "tiles", "ms", "ratio", "low", "high")
MACHINE = ("data", "zoom", "processor", "slower", "load", "warnings")


def main() -> None:
    """Read the command line and time what is missing."""
    given = arguments(__doc__)
    for data, zoom, text, _ in subjects(given.second):
        if done(given.out / "machine.csv", data, zoom):
            continue
        about = {"data": data, "zoom": zoom}
        with tempfile.TemporaryDirectory() as folder:
            scene = load(text)
            frame = frame_of(scene, view_of(scene))
            rows = [*drawn(Path(folder, "run"), text, scene), *made(Path(folder), frame, scene)]
            append(given.out / "times.csv", TIMES, [{**about, **row} for row in rows])
            facts = json.loads(Path(folder, "run", "run.json").read_text())
        append(given.out / "machine.csv", MACHINE, [{**about, **state(facts)}])
        sys.stdout.write(f"{data}, zoom {zoom}: timed\n")


def drawn(out: Path, text: str, scene: Scene) -> Iterator[dict[str, Any]]:
    """Measure a scene on llvmpipe; yield times to draw a tile, and to triangulate one."""
    command = [sys.executable, "-m", "harness", "run", "--scene", text, "--out", str(out)]
    command += ["--triangulators", ",".join(NAMES), "--rasterisers", "opengl", "--device", DEVICE]
    subprocess.run([*command, "--no-cache", "--quiet"], check=True, stdout=subprocess.DEVNULL)
    tiles = _tiles(scene)
    with (out / "summary.csv").open() as file:
        for row in csv.DictReader(file):
            about = {"name": row["triangulator"], "tiles": tiles}
            ends = {"ratio": "time_ratio", "low": "time_ratio_low", "high": "time_ratio_high"}
            ratio = {name: f"{float(row[column]):.4f}" for name, column in ends.items()}
            yield {"where": "draw", **about, "ms": _ms(float(row["draw_ms"]), tiles), **ratio}
            made_in = _ms(float(row["triangulate_ms"]), tiles)
            yield {"where": "server", **about, "ms": made_in}


def made(folder: Path, frame: Frame, scene: Scene) -> Iterator[dict[str, Any]]:
    """Yield what a tile takes to be triangulated by npm's earcut, refine and flips, and here."""
    node, earcut = languages.node(), languages.earcut()
    if node is None or earcut is None:
        raise SystemExit("there is no Node.js, or no npm earcut: make setup-test")
    rings = [rings_of(polygon) for polygon in frame.polygons]
    Cases.of(rings).write(folder, [ends for _, ends in rings])
    script = [node, str(HERE / "times.mjs"), str(folder), str(earcut), str(ROUNDS)]
    told = subprocess.run(script, capture_output=True, text=True, check=True).stdout
    tiles = _tiles(scene)
    for name, ms in json.loads(told).items():
        yield {"where": "browser", "name": name, "tiles": tiles, "ms": _ms(ms, tiles)}
    least = min(_seconds(rings) for _ in range(ROUNDS))
    yield {
        "where": "python",
        "name": "mapbox_earcut",
        "tiles": tiles,
        "ms": _ms(least * 1e3, tiles),
    }


def _seconds(rings: list[Any]) -> float:
    begun = time.perf_counter()
    for points, ends in rings:
        mapbox_earcut.triangulate_float64(points, ends)
    return time.perf_counter() - begun


def _tiles(scene: Scene) -> int:
    assert scene.tiling is not None
    return len(scene.tiling.names)


def _ms(all_tiles: float, tiles: int) -> str:
    return f"{all_tiles / tiles:.4f}"


def state(facts: dict[str, Any]) -> dict[str, Any]:
    """The processor, how much slower its reference draw was than the best known, and the load."""
    (first, *_) = facts.get("state") or [{}]
    return {
        "processor": facts["cpu"]["label"],
        "slower": f"{first.get('slower', float('nan')):.3f}",
        "load": f"{facts['environment']['load'][0]:.2f}",
        "warnings": len(facts["warnings"]),
    }


if __name__ == "__main__":
    main()
