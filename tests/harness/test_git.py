"""Git runs without the caller's variables, and a repository's settings start no program."""

import os
import subprocess
from pathlib import Path

import pytest

from harness.errors import UsageError
from harness.machine.git import check_out, describe_project, find_commit, read_git_state
from tests.harness.test_environment import git, repository


@pytest.fixture
def project(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path))
    repository(tmp_path / "project")
    monkeypatch.chdir(tmp_path / "project")
    return tmp_path / "project"


def test_git_ignores_the_variables_of_a_hook(project, tmp_path, monkeypatch):
    """In a hook, GIT_INDEX_FILE is the index of the new commit."""
    commit, index = git(project, "rev-parse", "HEAD"), (project / ".git/index").read_bytes()
    repository(tmp_path / "other")
    git(tmp_path / "other", "commit", "-q", "--allow-empty", "-m", "other")
    names = git(project, "rev-parse", "--local-env-vars").split()
    for name in names:
        monkeypatch.setenv(name, "/nonexistent")
    monkeypatch.setenv("GIT_DIR", str(tmp_path / "other/.git"))
    monkeypatch.setenv("GIT_INDEX_FILE", str(project / ".git/index"))
    state = describe_project([])
    with check_out(project, commit) as folder:
        assert (folder / "code/of_a_project.py").is_file()
    for name in names:
        monkeypatch.delenv(name)
    assert state == {"name": "project", "commit": commit, "dirty": False}
    assert (project / ".git/index").read_bytes() == index


def test_git_starts_no_program_of_the_repository(project, tmp_path):
    marker, program = tmp_path / "started", tmp_path / "program"
    program.write_text(f"#!/bin/sh\necho $0 >> '{marker}'\ncat\n")
    program.chmod(0o700)
    hooks = project / ".git/hooks"
    hooks.mkdir(exist_ok=True)
    for hook in ("post-checkout", "post-index-change", "reference-transaction"):
        (hooks / hook).symlink_to(program)
    (project / ".gitattributes").write_text("*.py filter=theirs\n")
    git(project, "add", ".")
    git(project, "commit", "-q", "-m", "second")
    for kind in ("clean", "smudge", "process"):
        git(project, "config", f"filter.theirs.{kind}", str(program))
    for setting in ("core.fsmonitor", "diff.external", "core.sshCommand"):
        git(project, "config", setting, str(program))
    git(project, "config", "remote.origin.url", "ssh://host/repository")
    for setting in ("filter.theirs.required", "remote.origin.promisor"):
        git(project, "config", setting, "true")
    marker.unlink(missing_ok=True)
    source = project / "code/of_a_project.py"
    os.utime(source, (1, 1))  # git has to compare its content
    assert read_git_state(project) == {"commit": git(project, "rev-parse", "HEAD"), "dirty": False}
    assert find_commit(project, "ab" * 20) is None  # a partial clone would fetch it
    with check_out(project, "HEAD") as folder:
        assert (folder / "code/of_a_project.py").read_text() == source.read_text()
    assert not marker.exists()
    git(project, "config", "filter.a=b.clean", str(program))
    assert read_git_state(project) is None
    with pytest.raises(UsageError, match=r"name contains .*give the folder"):
        check_out(project, "HEAD").__enter__()


def test_git_applies_the_users_filters(project, tmp_path, monkeypatch):
    """Without the filter of Git LFS, for example, each of its files would count as changed."""
    settings = tmp_path / "settings"
    settings.write_text('[filter "upper"]\n clean = tr a-z A-Z\n')
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", str(settings))
    (project / ".gitattributes").write_text("*.txt filter=upper\n")
    (project / "some.txt").write_text("words")
    git(project, "add", ".")
    git(project, "commit", "-q", "-m", "second")
    os.utime(project / "some.txt", (1, 1))
    assert read_git_state(project)["dirty"] is False


@pytest.mark.parametrize("name", [b"caf\xe9", b"ends with a space ", b"two\nlines\n"])
def test_paths_of_any_bytes(name, tmp_path, monkeypatch):
    folder = tmp_path / os.fsdecode(name)
    commit = repository(folder)
    monkeypatch.chdir(folder / "code")
    state = describe_project([])
    assert state == {"name": name.decode(errors="replace"), "commit": commit, "dirty": False}
    with check_out(folder, commit) as copy:
        assert copy.name == folder.name
    pruned = subprocess.run(["git", "worktree", "prune", "-n", "-v"], capture_output=True)
    assert pruned.stderr == b""
