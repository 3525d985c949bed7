"""The wheel contains all files of the packages, and no path of the build machine."""

import importlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile

import numpy as np
import pytest

from harness import __version__
from harness.errors import UsageError
from harness.history import find_noisy_changes
from scenes import SceneError
from scenes.projection import find_system
from tests.paths import ROOT, run_python

PACKAGES = ("harness", "triangulators", "scenes")
KINDS = ("", "-docs", "-test", "-data", "-setup")
LOCKS = tuple(f"requirements{kind}.lock" for kind in KINDS)


def test_the_wheel_has_every_file_of_the_packages(tmp_path):
    source = tmp_path / "source"
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for package in PACKAGES:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / package, source / package, ignore=ignored)
    pip = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-q"]
    command = [*pip, "--wheel-dir", tmp_path, source]
    subprocess.run(command, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("raster_harness-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
    files = (file for package in PACKAGES for file in (source / package).rglob("*"))
    assert {str(file.relative_to(source)) for file in files if file.is_file()} <= held
    licences = {f"harness/report/static/LICENSE-{name}.txt" for name in ("echarts", "d3")}
    assert licences | {"scenes/data/LICENSE-helsinki.txt"} <= held
    assert any(name.endswith("entry_points.txt") for name in held)


def test_the_locks_pin_every_package_with_hashes_and_name_no_address():
    for name in LOCKS:
        text = (ROOT / name).read_text()
        assert not re.search(r"https?://|file://|--index-url|--find-links", text)
        entries = re.split(r"\n(?=[a-z0-9])", text.partition("\n\n")[2] or text)
        pinned = [entry for entry in entries if "==" in entry.split("\n")[0]]
        assert pinned
        assert all("--hash=sha256:" in entry for entry in pinned), name


def test_measuring_needs_no_packages_of_tests_and_documents():
    texts = {kind: (ROOT / f"requirements{kind}.lock").read_text() for kind in KINDS}
    pattern = r"^([a-z0-9._-]+)=="
    pinned = {kind: set(re.findall(pattern, text, re.M)) for kind, text in texts.items()}
    assert pinned[""] < pinned["-docs"] < pinned["-test"]
    extras = {"ruptures", "plyfile", "pyarrow", "dask", "bokeh", "wgpu", "manifold3d"}
    development = {"pytest", "hypothesis", "mypy", "ruff", "setuptools", "lxml"}
    assert not pinned[""] & (extras | development | {"mkdocs", "mkdocs-material"})
    assert not pinned["-docs"] & (extras | development)


def test_all_files_name_one_version():
    patterns = {
        "pyproject.toml": r'(?m)^version = "(.*)"',
        "CITATION.cff": r"(?m)^version: (.*)",
        "ports/javascript/package.json": r'"version": "(.*?)"',
        "ports/python/pyproject.toml": r"(?m)^version = \"(.*)\"",
        "ports/cpp/CMakeLists.txt": r"flip_triangles VERSION (\S+)",
        "CHANGELOG.md": r"(?m)^## (\S+)",
        **{f"{name}/__init__.py": r'(?m)^__version__ = "(.*)"' for name in PACKAGES},
    }
    texts = {file: (ROOT / file).read_text() for file in patterns}
    versions = {file: re.findall(patterns[file], text)[0] for file, text in texts.items()}
    assert set(versions.values()) == {__version__}, versions


WITHOUT_EXTRAS = """
import sys
packages = "pyogrio pyproj pyarrow plyfile pmtiles google matplotlib fontTools OpenGL ruptures dask"
sys.modules.update(dict.fromkeys([*packages.split(), "wgpu", "manifold3d"]))  # they fail to import
"""
RUN_COMMANDS = """
import sys
from tests.conftest import run_command
for line in sys.stdin:
    print("exit code", run_command(*line.split()), file=sys.stderr)
"""


def run_without_extras(folder, *commands):
    """Run commands in a process without the packages of extras; return (exit code, errors) each."""
    (folder / "sitecustomize.py").write_text(WITHOUT_EXTRAS)
    environment = {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", "COLUMNS": "200"}
    text = "\n".join(commands)
    process = run_python("-c", RUN_COMMANDS, cwd=folder, env=environment, input=text, check=True)
    pieces = re.split(r"exit code (\d+)\n", process.stderr)
    return [(int(code), error) for error, code in zip(pieces[:-1:2], pieces[1::2], strict=True)]


def test_base_measures_and_triangulates_without_extras(tmp_path):
    (tmp_path / "a.wkt").write_text("POLYGON ((0 0, 4 0, 4 4, 2 1, 0 4))")
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\nf 1 2 3 4\n")
    run = "run --scene city:buildings=3 --rasterisers reference --resolution 64 --quick --out city"
    triangulate = ("triangulate a.wkt -o a.glb", "triangulate a.obj -o a.npz")
    results = run_without_extras(tmp_path, run, "report city", *triangulate, "list scenes")
    assert [code for code, _ in results] == [0, 0, 0, 0, 0], results
    assert (tmp_path / "city" / "report.html").exists()
    assert not (tmp_path / "city" / "plots").exists()
    assert re.search(r'plots skipped: matplotlib is not installed; .*\[plots\]"', results[1][1])


def test_missing_extras_are_one_line(tmp_path):
    (tmp_path / "a.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    (tmp_path / "a.json").write_text('{"type": "CityJSON", "version": "2.0"}')
    (tmp_path / "a.svg").write_text("<svg/>")
    (tmp_path / "a.ply").write_bytes(b"ply")
    (tmp_path / "a.parquet").write_bytes(b"PAR1PAR1")
    (tmp_path / "a.pmtiles").write_bytes(b"PMTiles\3" + bytes(200))
    commands = {
        "triangulate a.geojson -o a.glb": r"a\.geojson: pyogrio is .*\[gis\]",
        "triangulate a.svg -o a.glb": r"a\.svg: fontTools is .*\[svg\]",
        "run --scene glyphs --quick": r".*glyphs.*\[plots\]",
        "triangulate a.ply -o a.npz": r"a\.ply: plyfile is .*\[ply\]",
        "triangulate a.parquet -o a.glb": r"a\.parquet: pyarrow is .*\[geoparquet\]",
        "run --scene a.pmtiles:zoom=3 --quick": r"a\.pmtiles: pmtiles is .*\[tiles\]",
    }
    results = run_without_extras(tmp_path, *commands)
    for (code, error), expected in zip(results, commands.values(), strict=True):
        assert code == 2
        assert re.fullmatch(f'error: {expected}"', error.splitlines()[-1]), error


def test_other_missing_extras_are_one_line(monkeypatch):
    for package in ("ruptures", "pyproj"):
        monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(UsageError, match=r"pip install .*\[history\]\"$"):
        find_noisy_changes(np.zeros(100))
    with pytest.raises(SceneError, match=r"system 'EPSG:2': pyproj is not installed; .*\[gis\]\"$"):
        find_system("EPSG:2")


MENTION = r"""(?:format_install_command|import_optional)\((?:[^()]*, )?["'](\w+)["']\)"""


def test_mentioned_extras_are_declared():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    files = (file for package in PACKAGES for file in (ROOT / package).rglob("*.py"))
    named = {extra for file in files for extra in re.findall(MENTION, file.read_text())}
    assert {"gis", "history", "ply", "plots", "tiles"} <= named
    assert named <= set(declared["optional-dependencies"])


@pytest.mark.parametrize("name", sorted(f.stem for f in (ROOT / "tests/benchmarks").glob("*.py")))
def test_benchmarks_can_be_imported(name):
    """Benchmarks run by hand only, so no other test would notice a missing name."""
    importlib.import_module(f"tests.benchmarks.{name}")
