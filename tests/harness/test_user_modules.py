"""Nothing is imported from the current folder but the functions that the user names, and last."""

import subprocess
from pathlib import Path

import pytest

from tests.conftest import assert_one_line
from tests.paths import ROOT, run_python

STRANGERS = ("typer", "numpy", "numba", "pyarrow", "multiprocessing", "triangulators", "scenes")
"""Modules that a folder of data may hold, each with a name that the program imports."""

INSTALLED = (
    "import sys; sys.path.pop(0); sys.path.append(sys.argv.pop(1))\n"
    "from harness.__main__ import main\nmain()"
)
"""Starts the program as its script does."""

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
    """Make a folder with strangers' modules, each of which leaves a trace if it is imported."""
    monkeypatch.chdir(tmp_path)
    for name in STRANGERS:
        Path(f"{name}.py").write_text(f"open('imported-{name}', 'w').close()\n")
    Path("mine.py").write_text(CUT)
    return tmp_path


def test_strangers_modules_are_not_imported(folder):
    """Nor in workers, whose rasteriser and triangulator are loaded there."""
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
        ("nowhere:cut", ("no module 'nowhere'",)),
    ],
)
def test_a_name_that_clashes_is_an_error(folder, harness, reference, parts):
    code, _, err = harness("run", "--scene", "paper", "--triangulators", reference)
    assert code == 2
    assert_one_line(err, f"{reference}", *parts)
    assert list(folder.glob("imported-*")) == []


def test_dasks_workers_do_not_import_strangers_modules(folder):
    """Python starts them by `python -c`, which searches the current folder first."""
    program = (
        "import sys; sys.path[:] = [sys.argv.pop(1), *sys.path[1:]]\n"
        "from harness.scaling.executors import DaskExecutor\n"
        "executor = DaskExecutor('local:1')\n"
        "print([answer.value for _, answer in executor.run_all({'a': (abs, (-3,))})])\n"
        "executor.close()\n"
    )
    done = run_python("-c", program, ROOT, cwd=folder)
    assert done.stdout.strip().endswith("[3]"), done.stderr
    assert list(folder.glob("imported-*")) == []


def test_the_program_of_a_checkout_works_at_a_path_of_any_letters(tmp_path):
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
    given = done.stdout.splitlines()
    assert given[:2] == ["-P", "-c"]
    assert given[3:] == [str(root), "list", "a b"]
    assert not [*tmp_path.rglob("made")]
