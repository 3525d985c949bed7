"""Count llvmpipe's instructions and mispredicted branches a draw, as Callgrind simulates them.

    .venv/bin/python scripts/studies/branches.py glyphs 256 optimal:half-perimeter optimal:shape

prints a CSV, one row a triangulator. The counts are exact for Callgrind's simple predictor; a real
one does better, by the same pattern. Needs Debian's `valgrind`; a draw takes fifty times longer.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

DRAWS = 40
INSIDE = "BRANCHES_INSIDE"
FIELDS = ("Ir", "Bc", "Bcm", "Bi", "Bim")


def draw(scene: str, resolution: int, name: str) -> None:
    """Draw `DRAWS` times, with Callgrind looking on at nothing else."""
    from harness import rasterisers
    from harness.frame import View, make_frame
    from harness.measuring.loading import load_scene
    from harness.progress import Reporter
    from harness.rasterisers.base import Options
    from harness.study.calibration_draws import read_coefficients
    from harness.triangulating.frames import triangulate_polygons
    from harness.triangulating.recipes import parse

    frame = make_frame(load_scene(scene, 0, Reporter(quiet=True)).polygons, View(resolution))
    calibration = read_coefficients(Path("results/calibration/llvmpipe.json"))
    recipe = parse(name, calibration=calibration)
    parts = triangulate_polygons(recipe, frame.polygons).parts
    device = rasterisers.find_device("opengl", "llvmpipe")
    os.environ.update(device.environment)
    with rasterisers.get("opengl")(device).prepare(frame, frame.join(parts), Options()) as drawing:
        drawing.sample(2)
        subprocess.run(["callgrind_control", "-i", "on", str(os.getpid())], check=True, stdout=2)
        drawing.sample(DRAWS)
        subprocess.run(["callgrind_control", "-i", "off", str(os.getpid())], check=True, stdout=2)


def main() -> None:
    """Run this file again under Callgrind for each triangulator, and print what it counted."""
    scene, resolution, *names = sys.argv[1:]
    if INSIDE in os.environ:
        draw(scene, int(resolution), names[0])
        return
    print("scene,resolution,triangulator,instructions,branches,mispredicted")
    for name in names:
        done = subprocess.run(
            ["valgrind", "--tool=callgrind", "--instr-atstart=no", "--branch-sim=yes"]
            + ["--callgrind-out-file=/dev/null", sys.executable, *sys.argv[:3], name],
            env={**os.environ, INSIDE: "1", "PYTHONPATH": "."},
            stderr=subprocess.PIPE,
            text=True,
            check=True,
        )
        events = re.search(r"Collected : ([\d ]+)", done.stderr)
        if events is None:
            raise SystemExit(f"Callgrind counted nothing for {name}:\n{done.stderr}")
        counts = dict(zip(FIELDS, map(int, events[1].split()), strict=True))
        branches, wrong = counts["Bc"] + counts["Bi"], counts["Bcm"] + counts["Bim"]
        row = [f"{count / DRAWS:.0f}" for count in (counts["Ir"], branches, wrong)]
        print(",".join([scene, resolution, name, *row]), flush=True)


if __name__ == "__main__":
    main()
