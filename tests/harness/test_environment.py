"""A run tells the commit of the user's repository, and the harness's beside it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from harness.machine import environment
from harness.machine.environment import COMMITS, commit_of
from harness.stored.folder import read_run


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
    """Make a repository with a triangulator in `code`; returns its commit."""
    (folder / "code").mkdir(parents=True)
    (folder / "code/of_a_project.py").write_text("def cut(polygon): ...\n")
    git(folder, "init", "-q")
    git(folder, "add", ".")
    git(folder, "commit", "-q", "-m", "first")
    return git(folder, "rev-parse", "HEAD")


def test_the_repository_of_the_current_folder_is_the_users(tmp_path, monkeypatch):
    commit = repository(tmp_path / "project")
    monkeypatch.chdir(tmp_path / "project/code")
    facts = {"environment": environment.collect(0)}
    assert facts["environment"]["project"] == {"name": "project", "commit": commit, "dirty": False}
    assert commit_of(facts) == commit[:12]
    own = facts["environment"]["git"]
    assert commit_of(facts, "git").startswith("" if own is None else own["commit"][:12])
    (tmp_path / "project/code/of_a_project.py").write_text("changed = True\n")
    assert commit_of({"environment": environment.collect(0)}).endswith(" with local changes")


def test_else_that_of_a_triangulators_module(tmp_path, monkeypatch):
    commit = repository(tmp_path / "project")
    monkeypatch.syspath_prepend(str(tmp_path / "project/code"))
    found = environment.project(["optimal:overdraw", "nowhere:cut", "of_a_project:cut"])
    assert found is not None
    assert found["commit"] == commit
    assert environment.project(["delaunay"]) is None


@pytest.mark.parametrize("name", COMMITS)
def test_without_git_the_service_tells_the_commit(monkeypatch, name):
    assert environment.project([]) is None
    monkeypatch.setenv(name, "0123456789abcdef0123456789abcdef01234567")
    found = environment.project([])
    assert commit_of({"environment": {"project": found, "git": None}}) == "0123456789ab"


def test_a_run_that_knows_the_harness_alone_tells_of_it():
    facts = {"environment": {"git": {"commit": "ab" * 20, "dirty": True}}}
    assert commit_of(facts) == "abababababab with local changes"
    assert commit_of({}) == ""


def test_comparison_and_history_tell_the_users_commit(tmp_path):
    from harness.compare.comparison import compare_runs
    from harness.compare.wording import run_lines
    from harness.history.plots import run_label
    from tests.compare.runs import MACHINE, write_run

    ours, theirs = {"commit": "a" * 40, "dirty": False}, {"commit": "b" * 40, "dirty": False}
    facts = {"environment": {"harness": "0.1.0", "git": ours, "project": theirs, **MACHINE}}
    runs = [
        read_run(write_run(tmp_path / name, seed=seed, facts=facts))
        for name, seed in (("base", 1), ("head", 2))
    ]
    line = run_lines(compare_runs(*runs))[1]
    assert f"commit {'b' * 12}, raster-harness 0.1.0 at {'a' * 12}" in line
    assert run_label(runs[0]).startswith("b" * 8)
