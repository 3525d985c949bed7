"""The wheel, built from the sdist, works in a new environment without the repository."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from shapely import Polygon, box

from tests.conftest import write_geojson
from tests.paths import ROOT

UV = Path(sys.executable).with_name("uv")


def run(folder: Path, *command: str | Path) -> str:
    """Run a program without the repository on its path; return the output."""
    environment = {k: value for k, value in os.environ.items() if not k.startswith("PYTHON")}
    process = subprocess.run(
        [str(part) for part in command], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert process.returncode == 0, f"{command}: {process.stdout[-2000:]}{process.stderr[-2000:]}"
    return process.stdout


def test_wheel_works_without_the_repository(tmp_path):
    if not UV.exists():
        pytest.skip("needs uv, which make setup-test installs")
    source, environment = tmp_path / "source", tmp_path / "fresh"
    for name in subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines():
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, source / name)
    build = "from setuptools import build_meta; build_meta.build_sdist('dist')"
    run(source, sys.executable, "-c", build)
    (sdist,) = (source / "dist").glob("*.tar.gz")
    wheels = ("--no-deps", "--no-build-isolation", "-q", "--wheel-dir", tmp_path)
    run(tmp_path, sys.executable, "-m", "pip", "wheel", *wheels, sdist)
    (wheel,) = tmp_path.glob("*.whl")
    run(tmp_path, UV, "venv", "-q", "--python", sys.executable, environment)
    install = (UV, "pip", "install", "-q", "--python", environment / "bin" / "python")
    run(tmp_path, *install, wheel)
    work = tmp_path / "work"
    work.mkdir()
    shutil.rmtree(source)
    harness = environment / "bin" / "raster-harness"
    options = ("--quick", "--rasterisers", "reference", "--out")
    assert "raster-harness 1." in run(work, harness, "--version")
    table = run(work, harness, "run", "--scene", "city:buildings=20", *options, "city")
    assert "optimal:half-perimeter" in table
    run(tmp_path, *install, f"{wheel}[gis,plots,svg]")  # as README says
    polygons = write_geojson(
        work / "own.geojson", [box(0, 0, 8, 8), Polygon([(20, 0), (32, 0), (26, 9)])]
    )
    run(work, harness, "run", "--scene", polygons, *options, "own")
    run(work, harness, "run", "--scene", "glyphs:text=ab", *options, "letters")
    run(work, harness, "report", "city")
    assert (work / "city" / "report.html").exists()
    run(work, harness, "compare", "city", "city", "--gate", "counters")
    run(work, harness, "triangulate", polygons, "-o", "own.glb")
