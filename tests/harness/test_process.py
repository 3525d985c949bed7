"""The current folder is imported from only for functions that the user names, and last."""

import multiprocessing
import subprocess
from pathlib import Path

import pytest

from harness.worker import Worker
from tests.conftest import assert_one_line
from tests.paths import ROOT, run_python

LIBRARIES = ("typer", "numpy", "numba", "pyarrow", "multiprocessing")
FOREIGN_MODULES = (*LIBRARIES, "triangulators", "scenes")
"""Foreign modules in a data folder with names that the program imports."""

INSTALLED = (
    "import sys; sys.path.pop(0); sys.path.append(sys.argv.pop(1))\n"
    "from harness.__main__ import main\nmain()"
)
"""Starts the program as the script does."""

CUT = """
from triangulators import triangulate
def cut(polygon):
    return triangulate(polygon, "ear-clipping")
def squares():
    from shapely import box
    return [box(0, 0, 3, 2)]
"""
RUN = ("run", "--scene", "mine:squares", "--triangulators", "fan,mine:cut", "--resolution", "64")
REFERENCE = ("--rasterisers", "reference", "--quick", "--out", "out", "--no-cache")


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """Make a folder with foreign modules that leave a trace when imported."""
    monkeypatch.chdir(tmp_path)
    for name in FOREIGN_MODULES:
        Path(f"{name}.py").write_text(f"open('imported-{name}', 'w').close()\n")
    Path("mine.py").write_text(CUT)
    return tmp_path


def test_foreign_modules_are_not_imported(folder):
    """Nor in workers, which load the rasteriser and triangulator."""
    for start in (("-m", "harness", "list", "criteria"), ("-c", INSTALLED, ROOT, *RUN, *REFERENCE)):
        done = run_python(*start, cwd=folder)
        assert done.returncode == 0, done.stderr
    assert '"triangulator": "mine:cut", "rasteriser"' in Path("out/cases.jsonl").read_text()
    assert list(folder.glob("imported-*")) == []


@pytest.mark.parametrize(
    ("reference", "parts"),
    [
        ("triangulators:cut", ("triangulators.py", "package of raster-harness", "rename the file")),
        ("numpy:cut", ("numpy.py is hidden by", "rename the file", "PYTHONPATH=.")),
    ],
)
def test_name_clashes_are_errors(folder, harness, reference, parts):
    code, _, err = harness("run", "--scene", "paper", "--triangulators", reference)
    assert code == 2
    assert_one_line(err, f"{reference}", *parts)
    assert list(folder.glob("imported-*")) == []


def test_dask_workers_do_not_import_foreign_modules(folder):
    """Python starts Dask's workers by `python -c`, which searches the current folder first."""
    program = (
        "import sys; sys.path[:] = [sys.argv.pop(1), *sys.path[1:]]\n"
        "from functools import partial\n"
        "from harness.scaling.executors import DaskExecutor\n"
        "executor = DaskExecutor('local:1')\n"
        "print([answer.value for _, answer in executor.run_all({'a': partial(abs, -3)})])\n"
        "executor.close()\n"
    )
    done = run_python("-c", program, ROOT, cwd=folder)
    assert done.stdout.strip().endswith("[3]"), done.stderr
    assert list(folder.glob("imported-*")) == []


def test_a_checkout_works_at_any_path(tmp_path):
    root = tmp_path / 'it\'s $(touch made) "here"'
    program = root / ".venv/bin/raster-harness"
    program.parent.mkdir(parents=True)
    python = program.with_name("python")
    python.write_text("#!/bin/sh\nprintf '%s\\n' \"$@\"\n")
    python.chmod(0o700)
    setup = (ROOT / "scripts/setup.sh").read_text()
    start = setup.index("write_program() {")
    function = setup[start : setup.index("\n}\n", start) + 3]
    subprocess.run(["bash", "-euc", f"{function}write_program"], cwd=root, check=True)
    done = subprocess.run([program, "list", "a b"], cwd=tmp_path, capture_output=True, text=True)
    lines = done.stdout.splitlines()
    assert lines[:2] == ["-P", "-c"]
    assert lines[3:] == [str(root), "list", "a b"]
    assert not [*tmp_path.rglob("made")]


def test_workers_started_from_scratch_do_not_import_strangers_modules(folder, monkeypatch):
    """As on macOS and Windows, where Python starts them by `python -c`."""
    context = multiprocessing.get_context("spawn")
    monkeypatch.setattr("harness.serving.start_server", lambda: context)
    with Worker("worker") as worker:
        assert worker.call(abs, -3) == 3
    assert list(folder.glob("imported-*")) == []
