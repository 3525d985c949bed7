"""Runs have the user's commit and the processor; times of different processors are separate."""

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from harness.commands import merge
from harness.compare.comparison import compare_runs
from harness.compare.wording import list_runs
from harness.errors import IncompatibleRunsError
from harness.history import format_run_label, read_series
from harness.machine import environment
from harness.machine.git import COMMITS, describe_project, get_commit
from harness.metrics import groups
from harness.results.run_folder import Run, read_run
from harness.worker import get_third_party_limits
from tests.compare.runs import MACHINE, add_time, make_case, read_pair, write_run
from tests.conftest import MEASURED_OTHERS_S, MEASURED_STOLEN_S, require_ok


@pytest.fixture(autouse=True)
def _outside_ci(monkeypatch, tmp_path):
    for name in COMMITS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))


def git(folder: Path, *arguments: str) -> str:
    who = ("-c", "user.name=a", "-c", "user.email=a@b.example")
    command = ["git", "-C", str(folder), *who, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def repository(folder: Path) -> str:
    """Make a repository with a triangulator in `code`; return the commit."""
    (folder / "code").mkdir(parents=True)
    (folder / "code/of_a_project.py").write_text("def cut(polygon): ...\n")
    git(folder, "init", "-q")
    git(folder, "add", ".")
    git(folder, "commit", "-q", "-m", "first")
    return git(folder, "rev-parse", "HEAD")


def test_the_current_folders_repository_is_the_users(tmp_path, monkeypatch):
    commit = repository(tmp_path / "project")
    monkeypatch.chdir(tmp_path / "project/code")
    facts = {"environment": environment.collect_facts(0)}
    assert facts["environment"]["project"] == {"name": "project", "commit": commit, "dirty": False}
    assert get_commit(facts) == commit[:12]
    harness_state = facts["environment"]["git"] or {"commit": ""}
    assert get_commit(facts, "git").startswith(harness_state["commit"][:12])
    (tmp_path / "project/code/of_a_project.py").write_text("changed = True\n")
    assert get_commit({"environment": environment.collect_facts(0)}).endswith(" with local changes")


def test_otherwise_the_repository_of_a_triangulators_module_is_used(tmp_path, monkeypatch):
    commit = repository(tmp_path / "project")
    monkeypatch.syspath_prepend(str(tmp_path / "project/code"))
    project = describe_project(["optimal:overdraw", "nowhere:cut", "of_a_project:cut"])
    assert project["commit"] == commit
    assert describe_project(["delaunay"]) is None


@pytest.mark.parametrize("name", COMMITS)
def test_without_git_the_ci_service_has_the_commit(monkeypatch, name):
    assert describe_project([]) is None
    monkeypatch.setenv(name, "0123456789abcdef0123456789abcdef01234567")
    project = describe_project([])
    assert get_commit({"environment": {"project": project, "git": None}}) == "0123456789ab"


def test_runs_without_project_have_the_commit_of_the_harness():
    facts = {"environment": {"git": {"commit": "ab" * 20, "dirty": True}}}
    assert get_commit(facts) == "abababababab with local changes"
    assert get_commit({}) == ""


def test_comparison_and_history_have_the_users_commit(tmp_path):
    ours, theirs = {"commit": "a" * 40, "dirty": False}, {"commit": "b" * 40, "dirty": False}
    facts = {"environment": {"harness": "0.1.0", "git": ours, "project": theirs, **MACHINE}}
    runs = read_pair(tmp_path, {"facts": facts}, facts=facts)
    line = list_runs(compare_runs(*runs))[1]
    assert f"commit {'b' * 12}, raster-harness 0.1.0 at {'a' * 12}" in line
    assert format_run_label(runs[0]).startswith("b" * 8)


INTEL = """processor\t: 0
vendor_id\t: GenuineIntel
cpu family\t: 6
model\t\t: 143
model name\t: Intel(R) Xeon(R) Processor @ 2.10GHz
stepping\t: 8
flags\t\t: fpu sse2 avx avx2 avx512f

processor\t: 1
model\t\t: 0
"""
ARM = "processor\t: 0\nFeatures\t: fp asimd\nCPU implementer\t: 0x41\nCPU architecture: 8\n"
ARM += "CPU part\t: 0xd0c\nCPU revision\t: 1\n"
XEON = "Intel(R) Xeon(R) Processor @ 2.10GHz 6/143, 512-bit"
EPYC = "AMD EPYC 25/17, 512-bit"


@pytest.mark.parametrize(
    ("text", "label", "stepping"),
    [
        (INTEL, XEON, "8"),
        (INTEL.replace(" avx512f", ""), XEON.replace("512", "256"), "8"),
        (ARM, "0x41 8/0xd0c, 128-bit", "1"),
        ("", "unknown processor", None),
    ],
)
def test_processor_labels_have_the_vector_width(text, label, stepping, tmp_path, monkeypatch):
    file = tmp_path / "cpuinfo"
    file.write_text(text)
    monkeypatch.setattr(environment, "CPUINFO", file)
    monkeypatch.setattr("platform.processor", lambda: "")
    processor = environment.describe_processor.__wrapped__()
    assert (processor["label"], processor["stepping"]) == (label, stepping)


def test_cache_sizes_are_in_bytes(tmp_path):
    for number, (level, kind, size) in enumerate([(1, "Data", "48K"), (2, "Unified", "2048K")]):
        path = tmp_path / f"index{number}"
        path.mkdir()
        for name, value in (("level", level), ("type", kind), ("size", size)):
            (path / name).write_text(f"{value}\n")
    assert dict(environment._read_caches(tmp_path)) == {"L1d": 48 * 1024, "L2": 2048 * 1024}


@pytest.mark.parametrize("name", ["module.py", "shaders/count.glsl", "shaders/count.wgsl"])
def test_the_code_hash_changes_with_modules_and_shaders(tmp_path, name):
    file = tmp_path / "package" / name
    file.parent.mkdir(parents=True)
    file.write_text("before")
    before = environment.hash_sources(tmp_path / "package")
    file.write_text("after")
    assert environment.hash_sources(tmp_path / "package") != before


def test_missing_processor_facts_are_compatible():
    assert groups.may_be_same_processor("AMD EPYC", EPYC)
    assert groups.may_be_same_processor("", EPYC)
    assert not groups.may_be_same_processor(XEON, EPYC)
    assert groups.list_distinct_processors(["AMD EPYC", EPYC]) == []
    assert groups.list_distinct_processors(["AMD EPYC", EPYC, XEON, XEON]) == [EPYC, XEON]
    assert groups.read_processor({"environment": {"cpu": "AMD EPYC"}}) == "AMD EPYC"
    assert groups.read_processor({"cpu": "damaged", "environment": 3}) == ""


@pytest.fixture
def two_runs(tmp_path) -> list[Run]:
    scene = {"hash": make_case("fan", seed=1)["scene_hash"]}
    epyc, xeon = ({"cpu": {"label": label}, "scene": scene} for label in (EPYC, XEON))
    return read_pair(tmp_path, {"facts": epyc}, facts=xeon)


def test_merge_refuses_two_processors_without_hosts(two_runs, tmp_path):
    with pytest.raises(IncompatibleRunsError, match="keep the runs apart with --hosts") as caught:
        merge.merge_runs(two_runs, tmp_path / "merged")
    assert all(label in str(caught.value) for label in (EPYC, XEON))
    assert not (tmp_path / "merged").exists()


def test_gains_and_comparisons_report_two_processors(two_runs, harness):
    folders = [str(run.path) for run in two_runs]
    out, _ = require_ok(harness("study", "gains", *folders, "--out", "gains"))
    assert f"several processors, compared separately: llvmpipe on {EPYC}, {XEON}" in out
    table = Path("gains/gains.csv").read_text()
    assert f'"llvmpipe ({EPYC})"' in table
    assert ",llvmpipe," not in table
    notes = compare_runs(*two_runs).notes
    lines = [line for line in notes if "time ratios of software devices" in line]
    assert [f"llvmpipe on {EPYC}, {XEON}" in line for line in lines] == [True]
    notes = compare_runs(two_runs[0], two_runs[0]).notes
    assert not any("time ratios of software devices" in line for line in notes)


def test_history_ignores_changes_of_the_processor(tmp_path):
    """Ten runs, of which five on another processor that draws delaunay 12 % slower."""
    runs = []
    for number in range(10):
        edits = {"delaunay": add_time(0.12)} if number >= 5 else {}
        run = read_run(write_run(tmp_path / str(number), seed=number, edits=edits))
        label = EPYC if number < 5 else XEON
        runs.append(replace(run, facts={**run.facts, "cpu": {"label": label}}))
    changed = {s.metric for s in read_series(runs) if s.changes}
    assert changed == set()
    one = [replace(run, facts=runs[0].facts) for run in runs]
    assert {s.metric for s in read_series(one) if s.changes} == {"time"}


def test_system_without_proc_has_unknown_facts_and_no_error(monkeypatch):
    def fail(*_: object, **__: object) -> None:
        raise FileNotFoundError(2, "No such file or directory", "/proc/meminfo")

    for name in ("virtual_memory", "cpu_times", "cpu_count", "getloadavg", "Process"):
        monkeypatch.setattr(f"psutil.{name}", fail)
    facts = environment.collect_facts(0)
    assert facts["memory_gib"] is facts["cores"] is facts["load"] is None
    assert facts["threads"] >= 1
    assert not any("busy" in line for line in environment.list_warnings(facts))
    assert get_third_party_limits().memory_bytes is None
    assert MEASURED_STOLEN_S() == MEASURED_OTHERS_S() == 0.0
