"""The sdist makes the wheel, and the wheel works in a fresh environment without the repository."""

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
    """Run a program where nothing of the repository is on the path; return what it prints."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [str(each) for each in command], cwd=folder, env=kept, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{command}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
    return done.stdout


def test_the_wheel_is_enough(tmp_path, tell):
    if not UV.exists():
        pytest.skip("needs uv, which make setup-test installs")
    source, fresh = tmp_path / "source", tmp_path / "fresh"
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
    run(tmp_path, UV, "venv", "-q", "--python", sys.executable, fresh)
    install = (UV, "pip", "install", "-q", "--python", fresh / "bin" / "python")
    run(tmp_path, *install, "--require-hashes", "--no-deps", "-r", ROOT / "requirements.lock")
    run(tmp_path, *install, "--no-deps", wheel)
    work = tmp_path / "work"
    work.mkdir()
    shutil.rmtree(source)
    harness = fresh / "bin" / "raster-harness"
    own = write_geojson(
        work / "own.geojson", [box(0, 0, 8, 8), Polygon([(20, 0), (32, 0), (26, 9)])]
    )
    brief = ("--quick", "--rasterisers", "reference", "--out")
    assert "raster-harness 1." in run(work, harness, "--version")
    table = run(work, harness, "run", "--scene", "city:buildings=20", *brief, "city")
    assert "optimal:half-perimeter" in table
    run(work, harness, "run", "--scene", own, *brief, "own")
    run(work, harness, "report", "city")
    assert (work / "city" / "report.html").exists()
    run(work, harness, "compare", "city", "city", "--gate", "counters")
    run(work, harness, "triangulate", own, "-o", "own.glb")
    tell({"MB installed": sum(f.stat().st_size for f in fresh.rglob("*") if f.is_file()) // 10**6})
