"""Third-party code may fail in any way: only its own cases fail, without delay."""

import os
import time
from pathlib import Path

import pytest

from harness.measuring.run import run
from harness.results.run_folder import read_run
from harness.worker import Worker
from tests.conftest import assert_refused, require_ok
from tests.measuring.test_run import MOCK, make_plan, measure, quiet
from tests.records import get_rows

pytestmark = pytest.mark.usefixtures("no_plots")

REASONS = {
    "segfault": "crashed: SIGSEGV",
    "hang": "exceeded the time limit",
    "exhaust_memory": "emory",
    "raise_error": "RuntimeError: no idea",
    "kill_parent": "crashed: SIGKILL",
    "flood_stdout": "crashed: exit code 1; last output: ... xxx",
    "exit_success": "SystemExit: 0",
    "exit_hard": "crashed: exit code 0",
    "raise_interrupt": "KeyboardInterrupt",
    "raise_base_exception": "CustomBaseException: enough",
    "return_none": "shape ()",
    "return_nan": "expected integer indices",
    "return_out_of_range": "indices outside",
    "return_coordinates": "expected (m, 3)",
    "return_overlapping": "polygon 0",
    "return_too_few": "polygon 0",
}
VALID = ("delaunay", "tests.broken:triangulate_clockwise", "tests.broken:fork")


def test_failures_of_third_party_code_are_failed_records(block, tmp_path, monkeypatch):
    monkeypatch.setattr("harness.worker.MEMORY_SHARE", 0.15)
    names = [f"tests.broken:{name}" for name in REASONS]
    plan = make_plan(block, triangulators=(*names, *VALID), timeout_s=3.0)
    outcome = measure(plan, tmp_path / "out", open_worker=Worker)
    records = {record["triangulator"]: record for record in get_rows(outcome)}
    for name, reason in REASONS.items():
        record = records[f"tests.broken:{name}"]
        assert record["status"] == "failed", name
        assert reason in record["reason"], name
        assert len(record["reason"]) < 1000, name
    for name in VALID:
        assert (records[name]["status"], records[name]["coverage_error"]) == ("ok", 0), name


@pytest.fixture
def module(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))

    def write(name: str, content: str) -> None:
        (tmp_path / f"{name}.py").write_text(content)

    return write


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("os.abort()", "crashed: SIGABRT"),
        ("sys.exit(0)", "SystemExit: 0"),
        ("os._exit(0)", "crashed: exit code 0"),
        ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    ],
)
def test_a_module_that_crashes_on_import_fails_its_case(block, tmp_path, module, statement, reason):
    log = tmp_path / "imported"
    module("dying", f"import os, sys\nopen({str(log)!r}, 'a').write('x')\n{statement}\n")
    plan = make_plan(block, triangulators=("dying:cut", "delaunay"), timeout_s=300.0)
    start = time.monotonic()
    records = get_rows(run(plan, tmp_path / "out", quiet(), open_worker=Worker))
    assert time.monotonic() - start < 120
    assert [record["status"] for record in records] == ["failed", "ok"]
    assert reason in records[0]["reason"]
    assert log.read_text() == "x"  # imported once, as the failure is then known


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("tests.broken:nofunc", ["nofunc"]),
        ("tests.broken:np.pi", ["not a function"]),
        ("unwritten:cut", ["SyntaxError", "line 2"]),
        ("lacking:cut", ["no_such_package"]),
        ("lacking.inner:cut", ["no_such_package"]),
        ("no_such_module:cut", ["no module 'no_such_module'; the module must be in"]),
        ("optmal:overdraw", ["optmal", "did you mean 'optimal'"]),
        ("../etc:cut", ["../etc"]),
        ("delaunay@30", ["@0"]),
    ],
)
def test_import_errors_are_reported_before_measuring(block, harness, module, name, parts):
    module("unwritten", "import os\ndef cut(:\n")
    module("lacking", "import no_such_package\n")
    arguments = ("--scene", str(block), "--triangulators", f"delaunay,{name}", "-q")
    answer = harness("run", *arguments, "--rasterisers", MOCK, "--out", "out")
    assert_refused(answer, *parts)
    assert not Path("out").exists()


RASTERISER = """
import os, sys
from pathlib import Path
from tests.mock import MockRasteriser

with (Path(__file__).parent / "imported").open("a") as file:
    file.write(f"{os.getpid()}\\n")


class Theirs(MockRasteriser):
    pass


class Dying(MockRasteriser):
    @classmethod
    def devices(cls):
        os._exit(0)


def cut(polygon):
    from tests.broken import triangulate_clockwise

    return triangulate_clockwise(polygon)
"""


def test_third_party_code_runs_in_workers_only(block, harness, module, tmp_path):
    module("theirs", RASTERISER)
    arguments = ("--scene", str(block), "--triangulators", "delaunay,theirs:cut", "--quick")
    rasterisers = ("--rasterisers", "theirs:Dying,theirs:Theirs", "--out", "out")
    _, err = require_ok(harness("run", *arguments, *rasterisers))
    assert "rasteriser 'theirs:Dying': skipped" in err
    assert "crashed: exit code 0" in err
    assert {record["status"] for record in get_rows(read_run(Path("out")))} == {"ok"}
    processes = set((tmp_path / "imported").read_text().split())
    # Two rasterisers are surveyed, one draws in another process, and a triangulator runs.
    assert len(processes) == 4
    assert str(os.getpid()) not in processes


@pytest.mark.parametrize(
    ("name", "code", "parts"),
    [
        ("theirs:Dying", 3, ["all rasterisers of the run failed"]),
        ("theirs:cut", 2, ["not a subclass of harness.rasterisers.Rasteriser"]),
        ("theirs:nothing", 2, ["import failed", "nothing"]),
    ],
)
def test_unusable_rasterisers_are_reported_in_one_line(block, harness, module, name, code, parts):
    module("theirs", RASTERISER)
    answer = harness("run", "--scene", str(block), "--rasterisers", name, "-q")
    assert_refused(answer, *parts, code=code)


def test_a_scene_that_exits_is_reported_in_one_line(harness, module, tmp_path):
    package = tmp_path / "theirs-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    points = "[raster_harness.scenes]\nexiting = theirs:build\nsquare = theirs:square\n"
    (package / "entry_points.txt").write_text(points)
    module(
        "theirs",
        "import sys\nfrom shapely import box\n"
        "def build(*, seed):\n    sys.exit(0)\n"
        "def square(*, seed):\n    return [box(0, 0, 1, 1)]\n",
    )
    answer = harness("run", "--scene", "exiting", "-q")
    assert_refused(answer, "error: scene exiting failed: it raised SystemExit(0)")
    good = ("run", "--scene", "square", "--triangulators", "fan", "--rasterisers", MOCK, "-q")
    assert harness(*good, "--quick")[0] == 0
