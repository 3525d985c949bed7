"""The command `compare`: exit codes, files, settings and error messages."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from harness.compare.matching import list_changes, machines_differ
from tests.compare.runs import SCENARIOS, add_cost, add_time, make_plan, write_pair, write_run
from tests.conftest import assert_refused, require_ok
from tests.paths import ROOT
from tests.records import make_run

pytestmark = pytest.mark.usefixtures("no_plots")


@pytest.fixture
def runs(harness):
    """Return a function that writes base, and head with edits, and compares them."""

    def call(*options: str, edits=None, **keywords):
        write_pair(edits=edits, **keywords)
        return harness("compare", "base", "head", *options)

    return call


def test_a_missing_run_is_bad_usage_unless_a_missing_baseline_is_allowed(harness):
    write_run(Path("head"), seed=1)
    assert_refused(harness("compare", "base", "head"), "no baseline", "--allow-missing-baseline")
    Path("base").mkdir()  # a cache without an entry may leave an empty folder
    out, _ = require_ok(harness("compare", "base", "head", "--allow-missing-baseline"))
    assert out.startswith("No baseline yet: base has no run; store HEAD")
    answer = harness("compare", "head", "base", "--allow-missing-baseline")
    assert_refused(answer, "base has no run")


def test_a_newer_schema_is_bad_usage(runs):
    assert_refused(runs(facts={"schema_version": 999}), "999", "newer")


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        ("--gate couters", ["couters", "counters"]),
        *(("--gate ,", ["gate ','"]), ("--json /proc/none/x.json", ["/proc/none"])),
        *((f"--threshold {text}", [text, "percentage"]) for text in ("time", "time=5")),
        *(("--threshold quds=5%", ["quds", "quads"]), ("--threshold draw_ms=5%", ["draw_ms"])),
        ("--threshold outline_quads=5%", ["outline_quads", "no change"]),
    ],
)
def test_invalid_options_are_one_line_and_exit_code_2(runs, options, parts):
    assert_refused(runs(*options.split()), *parts)


def test_other_devices_are_refused_without_across_devices(runs, harness):
    def on_gpu(entry):
        entry["device"] = "gpu0"

    assert_refused(runs(edits={"*": on_gpu}), "llvmpipe", "gpu0", "--across-devices")
    out, _ = require_ok(harness("compare", "base", "head", "--across-devices"))
    assert "5 cases on gpu0" in out
    assert "no counter differs" in out


def test_the_same_device_name_on_other_hardware_is_refused(runs, harness):
    devices = {"opengl on llvmpipe": {"details": {"renderer": "NVIDIA H200/PCIe/SSE2"}}}
    assert_refused(runs(facts={"devices": devices}), "NVIDIA H200", "--across-devices")
    out, _ = require_ok(harness("compare", "base", "head", "--across-devices", "--format", "json"))
    assert json.loads(out)["machines_differ"] is True


def test_machines_differ_only_if_both_are_known():
    one, other = ({"environment": {"cpu": cpu, "threads": 2}} for cpu in ("A", "B"))
    assert machines_differ(one, other)
    assert not machines_differ(one, one)
    assert not machines_differ(one, {})
    assert not machines_differ({}, other)


def test_changed_packages_and_drivers_are_reported():
    def run(packages, version):
        devices = {"opengl on llvmpipe": {"details": {"version": version}}}
        return make_run([], environment={"packages": packages}, devices=devices)

    one, other = run({"numpy": "2.3.0"}, "4.5"), run({"numpy": "2.4.0"}, "4.6")
    assert list_changes(one, other) == [
        "environment: packages: numpy was 2.3.0, is 2.4.0",
        "devices: opengl on llvmpipe: version was 4.5, is 4.6",
    ]
    assert list_changes(one, one) == list_changes(one, run(None, None)) == []


def test_thresholds_tolerate_growth(runs, harness):
    assert runs(edits={"fan": add_cost(0.02)})[0] == 1
    loose = ("--threshold", "quads=2%", "--threshold", "helper_lanes=10%")
    assert harness("compare", "base", "head", *loose)[0] == 0
    assert harness("compare", "base", "head", *loose[:2])[0] == 1
    assert harness("compare", "base", "head", "--threshold", "counters=10%")[0] == 0
    assert harness("compare", "base", "head", "--gate", "time")[0] == 0


def test_options_override_the_settings_of_the_project(runs, harness):
    thresholds = 'threshold = {quads = "3%", helper_lanes = "10%"}\n'
    Path("pyproject.toml").write_text(f'[tool.raster-harness]\ngate = "counters"\n{thresholds}')
    assert runs(edits={"fan": add_cost(0.02), "delaunay": add_time(0.2)})[0] == 0
    assert harness("compare", "base", "head", "--gate", "counters,time")[0] == 1
    assert harness("compare", "base", "head", "--threshold", "quads=1%")[0] == 1


@pytest.mark.parametrize(
    ("table", "parts"),
    [
        ('gates = "time"', ["gates", "gate"]),
        ("gate = 3", ["gate", "3"]),
        ('threshold = { quads = "much" }', ["quads=much"]),
        ("gate = ", ["pyproject.toml"]),
        ("[tool]\nraster-harness = 1", ["not a table"]),
    ],
)
def test_bad_settings_name_the_file(runs, table, parts):
    header = "" if table.startswith("[") else "[tool.raster-harness]\n"
    Path("pyproject.toml").write_text(f"{header}{table}\n")
    assert_refused(runs(), "pyproject.toml", *parts)


def test_case_outside_heads_plan_fails_only_with_require_all(runs, harness):
    out, _ = require_ok(runs(leave_out=("fan",)))
    assert "(1 case not in HEAD's plan)" in out
    code, out, _ = harness("compare", "base", "head", "--require-all")
    assert code == 1
    assert out.startswith("Regression:")
    assert harness("compare", "head", "base", "--require-all")[0] == 0


@pytest.mark.parametrize(
    ("scenario", "option"),
    [("noise-only", "--allow-inconclusive"), ("time-regression", "--threshold=time=30%")],
)
def test_noise_and_slower_times_can_be_allowed(harness, scenario, option):
    SCENARIOS[scenario].make()
    assert harness("compare", "base", "head", option)[0] == 0


SEPARATE = ("5 cases new in HEAD", "5 cases not in HEAD's plan")


@pytest.mark.parametrize(
    ("record", "changes", "parts"),
    [
        ({"scene": "village"}, {"scene": "maps/village"}, SEPARATE),
        ({"rasteriser": "vulkan", "device": "lavapipe"}, {"rasterisers": ["vulkan"]}, SEPARATE),
        ({"scene_hash": "0" * 16}, {}, ("5 cases with changed content",)),
    ],
)
def test_runs_without_common_cases_have_nothing_comparable(runs, record, changes, parts):
    def elsewhere(entry):
        entry |= record
        add_cost(0.5)(entry)

    code, out, _ = runs(edits={"*": elsewhere}, facts={"plan": make_plan(**changes)})
    assert code == 4
    assert all(part in out for part in parts)


@pytest.mark.parametrize("seconds", [0.0005, 5.0])
def test_time_of_a_cached_triangulation_is_not_compared(runs, seconds):
    def read_back(entry):
        entry |= {"polygons_cached": 500, "triangulate_s": seconds}

    out, _ = require_ok(runs("--json", "found.json", edits={"*": read_back}))
    content = json.loads(Path("found.json").read_text())
    metrics = {change["metric"] for case in content["cases"] for change in case["counters"]}
    assert "quads" in metrics
    assert not any("triangulat" in metric for metric in metrics)
    assert "improved" not in out


def test_fewer_polygons_are_a_regression_and_more_are_not(runs, harness):
    def lost(entry):
        entry |= {"polygons": 499, "reason": "failed polygon 3: boom"}
        add_cost(-0.1)(entry)

    code, out, _ = runs(edits={"fan": lost})
    assert code == 1
    assert "500 then, 499 now" in out
    out, _ = require_ok(harness("compare", "head", "base"))
    assert "1 case with more polygons" in out


def test_headline_prefers_growth_to_a_missing_counter(runs):
    def lost(entry):
        del entry["counters"]["helper_lanes"]

    code, out, _ = runs(edits={"fan": lost, "delaunay": add_cost(0.1)})
    assert code == 1
    assert "Regression: delaunay, " in out
    assert "; 1 more case regressed" in out


def test_markdown_is_appended_to_the_step_summary(runs, monkeypatch):
    Path("summary.md").write_text("before\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", "summary.md")
    assert runs("--markdown", "out/report.md", edits={"fan": add_cost(0.1)})[0] == 1
    text = Path("summary.md").read_text()
    assert text == "before\n" + Path("out/report.md").read_text()
    assert "**Regression:** fan, city 1024 px, opengl on llvmpipe: helper lanes" in text


def test_changed_function_of_the_same_name_is_a_regression(harness, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for name, method in (("base", "delaunay"), ("head", "ear-clipping")):
        code = f"def cut(polygon):\n    return triangulate(polygon, {method!r})\n"
        (tmp_path / "mine.py").write_text(f"from triangulators import triangulate\n{code}")
        run = ("run", "--scene", "city:buildings=20", "--quick", "--quiet", "--out", name)
        names = ("--triangulators", "delaunay,mine:cut", "--rasterisers", "binning")
        require_ok(harness(*run, *names))
    code, out, _ = harness("compare", "base", "head", "--format", "markdown")
    assert code == 1
    first = out.splitlines()[0]
    assert first.startswith("**Regression:** mine:cut, city:buildings=20 1024 px, binning on cpu: ")
    assert "tiles" in first
    assert "delaunay" not in first


def test_closed_pipe_does_not_change_the_exit_code(tmp_path):
    base, head = write_pair(folder=tmp_path)
    command = f"{sys.executable} -m harness compare {base} {head}"
    # The reader closes the pipe before the first write.
    script = f"{{ sleep 0.2; {command}; echo $? >&2; }} | true"
    done = subprocess.run(["bash", "-c", script], cwd=ROOT, capture_output=True, text=True)
    assert done.stderr.strip() == "0"
