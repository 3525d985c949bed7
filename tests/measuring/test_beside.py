"""Two versions of a user's code measured in the same rounds: pairs, stored facts, refusals."""

import contextlib
import shutil
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.compare.comparison import compare_runs
from harness.errors import IncompatibleRunsError
from harness.frame import View
from harness.measuring import run as running
from harness.measuring.other_version import open_other_version, triangulate_with_other_version
from harness.measuring.plan import Plan
from harness.measuring.pool import MeasuringPool
from harness.measuring.timing import TimingSettings
from harness.progress import Reporter
from harness.results.record import BASE_MARK
from harness.results.run_folder import read_geometry, read_run
from harness.triangulating.recipes import Recipe
from harness.worker import TaskError
from scenes import load
from tests.conftest import assert_refused
from tests.harness.test_environment import git
from tests.measuring.test_run import inline
from tests.mock import MockRasteriser
from tests.paths import ROOT
from tests.records import get_rows
from triangulators import registry

IMPORT = "from triangulators import triangulate\n"
MODULE = f"{IMPORT}def cut(polygon): return triangulate(polygon, {{!r}})"
GOOD, WORSE = MODULE.format("delaunay"), MODULE.format("ear-clipping")
BROKEN = "def cut(polygon): raise RuntimeError('half done')\n"
THEIRS, NEWER = Recipe("theirs:cut"), Recipe("newer:cut")
PLAN = Plan(
    scene="city:buildings=6",
    triangulators=(Recipe("fan"), THEIRS),
    rasterisers=("tests.mock:MockRasteriser",),
    timing=TimingSettings(precision=0.1, budget_s=0.001, warm_up_s=0.0, min_batch_s=1e-5),
)
POLYGONS = load("city:buildings=2", seed=0).polygons


@contextlib.contextmanager
def project(folder: Path) -> Iterator[Path]:
    """Make a repository with a commit of the good triangulation, and enter it."""
    folder.mkdir()
    (folder / "theirs.py").write_text(GOOD)
    git(folder, "init", "-q", "-b", "main")
    git(folder, "add", ".")
    git(folder, "commit", "-q", "-m", "first")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.syspath_prepend(str(folder))
        patch.setattr(sys, "dont_write_bytecode", True)
        yield folder


def measure(
    plan: Plan, out: str, reference: str = "main", *, resume: bool = False, twice: bool = False
) -> None:
    """Measure HEAD's code, imported again, with an interleaved baseline, in this process."""
    for name in ("theirs", "newer"):
        sys.modules.pop(name, None)
    registry.load.cache_clear()
    MockRasteriser.begin_run()
    with open_other_version(reference, [recipe.base for recipe in plan.triangulators]) as other:
        options = running.RunOptions(resume=resume, baseline=replace(other, twice=twice))
        running.run(plan, Path(out), Reporter(quiet=True), options, open_worker=inline)


def runs(out: Path | str):
    return read_run(Path(out) / "base"), read_run(Path(out))


@pytest.fixture(scope="module")
def measured(tmp_path_factory) -> Iterator[Path]:
    """A repository with a run of main as baseline and a worse HEAD, which has a new module."""
    with project(tmp_path_factory.mktemp("beside") / "project") as folder:
        (folder / "theirs.py").write_text(WORSE)
        git(folder, "checkout", "-q", "-b", "change")
        git(folder, "commit", "-q", "-a", "-m", "second")
        (folder / "newer.py").write_text(GOOD)
        measure(replace(PLAN, triangulators=(*PLAN.triangulators, NEWER)), "out")
        yield folder


def test_samples_pair_and_a_change_is_detected(measured):
    base, head = runs(measured / "out")
    statuses = [{r["triangulator"]: r["status"] for r in get_rows(run)} for run in (base, head)]
    assert statuses[0] == {"fan": "ok", "theirs:cut": "ok", "newer:cut": "failed"}
    assert statuses[1] == dict.fromkeys(statuses[0], "ok")
    keys = [{r["triangulator"]: r["key"] for r in get_rows(run)} for run in (base, head)]
    assert keys[0] == keys[1]
    comparison = compare_runs(base, head)
    times = {case.id.name: case.time for case in comparison.list_compared()}
    assert {time.against for time in times.values()} == {"rounds", "same-triangles"}
    assert (times["fan"].against, times["fan"].ratio) == ("same-triangles", None)
    newer = {case.id.name: case.status for case in comparison.cases}["newer:cut"]
    assert newer == "now-measured"
    (reason,) = (r["reason"] for r in get_rows(base) if r["status"] == "failed")
    assert "newer" in reason


def test_each_run_has_its_own_records(measured):
    base, head = runs(measured / "out")
    for run in (base, head):
        files = {file.stem for file in (run.path / "polygons").iterdir()}
        assert files == {r["key"] for r in get_rows(run) if r["status"] == "ok"}
    drawn = [read_geometry(run, View()).triangles for run in (base, head)]
    assert set(drawn[1]) - set(drawn[0]) == {"newer:cut", "delaunay"}
    assert not any(BASE_MARK in name for names in drawn for name in names)
    assert np.array_equal(drawn[0]["fan"], drawn[1]["fan"])
    assert not np.array_equal(drawn[0]["theirs:cut"], drawn[1]["theirs:cut"])
    assert np.array_equal(drawn[0]["theirs:cut"], drawn[1]["delaunay"])


def test_each_run_has_its_commit_and_work_trees_are_removed(measured):
    base, head = runs(measured / "out")
    commits = [git(measured, "rev-parse", name) for name in ("main", "change")]
    projects = [run.facts["environment"]["project"] for run in (base, head)]
    assert [project["commit"] for project in projects] == commits
    expected = {"base": "main", "commit": commits[0], "twice": False}
    assert head.facts["beside"] == expected
    assert base.facts["beside"] == {**expected, "is_base": True}
    assert len(git(measured, "worktree", "list").splitlines()) == 1


def test_resume_uses_the_same_baseline(tmp_path):
    with project(tmp_path / "project") as folder:
        plan = replace(PLAN, triangulators=(THEIRS,))
        (folder / "theirs.py").write_text(BROKEN)
        measure(plan, "out")
        base, head = runs("out")
        assert [r["status"] for r in get_rows(base) + get_rows(head)] == ["ok", "failed"]
        (folder / "theirs.py").write_text(WORSE)
        measure(plan, "out", resume=True)
        base, head = runs("out")
        assert [r["status"] for r in get_rows(base) + get_rows(head)] == ["ok", "ok"]
        # They were not timed together, so the run has no comparison of the two.
        assert compare_runs(base, head).cases[0].time.against != "rounds"
        git(folder, "commit", "-q", "-a", "-m", "second")
        with pytest.raises(IncompatibleRunsError, match="the baseline"):
            measure(plan, "out", "HEAD", resume=True)


@pytest.mark.parametrize("twice", [False, True])
def test_equal_triangulations_are_drawn_once_by_default(twice, tmp_path, monkeypatch):
    drawn: list[str] = []
    time = MeasuringPool.time_drawings

    def watched(self, backend, candidates, *arguments):
        drawn.extend(candidates)
        return time(self, backend, candidates, *arguments)

    monkeypatch.setattr(MeasuringPool, "time_drawings", watched)
    with project(tmp_path / "project") as folder:
        (folder / "theirs.py").write_text(WORSE)
        measure(PLAN, "out", twice=twice)
        times = [{r["triangulator"]: r["time"] for r in get_rows(run)} for run in runs("out")]
    names = ["fan", "theirs:cut", *([f"{BASE_MARK}fan"] if twice else []), f"{BASE_MARK}theirs:cut"]
    assert sorted(drawn) == sorted(names)
    base, head = times
    assert base["fan"] == head["fan"]
    assert set(base) == set(head) == {"fan", "theirs:cut"}


def test_the_baseline_may_be_a_folder_or_an_environment(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    other, environment = tmp_path / "other", tmp_path / "environment"
    other.mkdir()
    (other / "theirs.py").write_text(WORSE)
    (environment / "bin").mkdir(parents=True)
    python = environment / "bin" / "python"
    python.write_text(f'#!/bin/sh\nPYTHONPATH={other}:{ROOT} exec {sys.executable} "$@"\n')
    python.chmod(0o755)
    parts = []
    for reference in (str(other), str(environment)):
        with open_other_version(reference, ["theirs:cut"]) as other:
            result = triangulate_with_other_version(THEIRS, POLYGONS, other)
        assert not result.failed
        assert result.conforming
        parts.append(np.concatenate(result.parts))
    assert np.array_equal(*parts)


def test_an_editable_install_that_hides_base_is_reported(measured):
    """If BASE's name led to HEAD's code, HEAD would be compared with itself."""
    with open_other_version("main", ["theirs:cut"]) as other:
        hidden = replace(other, path=(str(measured), *other.path))
        with pytest.raises(TaskError, match=r"is imported from HEAD .*editable"):
            triangulate_with_other_version(THEIRS, POLYGONS, hidden)


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (["--beside", "nowhere"], ["--beside nowhere", "neither a commit", "git fetch"]),
        (["--draw-twice"], ["--draw-twice", "--beside"]),
    ],
)
def test_bad_usage_is_reported_in_one_line(harness, options, parts):
    assert_refused(harness("run", "--scene", "city:buildings=2", "--out", "out", *options), *parts)
    assert not Path("out").exists()


def test_only_the_created_work_tree_is_removed(measured, tmp_path):
    """A lost folder and an inaccessible work tree of another project do not matter."""
    git(measured, "worktree", "add", "-q", "--detach", str(tmp_path / "another"))
    (tmp_path / "another").rename(tmp_path / "out of reach")
    with open_other_version("main", []) as base:
        shutil.rmtree(base.folder)
    with open_other_version("main", []) as base:
        assert Path(base.folder, "theirs.py").is_file()
    listed = git(measured, "worktree", "list").splitlines()
    assert [Path(line.split()[0]).name for line in listed] == [measured.name, "another"]
    assert git(measured, "status", "--porcelain", "--untracked-files=no") == ""
    git(measured, "worktree", "remove", "--force", str(tmp_path / "another"))
