"""Git: the commit of a repository, and a temporary checkout of another commit.

All calls go through `run_git`: neither an untrusted repository's settings nor this process's
environment (in a git hook) may make git start a program, use another repository or index, or remove
anything that this process has not created.
"""

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from harness.errors import UsageError

COMMITS = ("GITHUB_SHA", "CI_COMMIT_SHA", "BUILDKITE_COMMIT", "CIRCLE_SHA1", "GIT_COMMIT")
"""Environment variables in which services of continuous integration store the commit."""

KEPT_VARIABLES = (
    "GIT_CEILING_DIRECTORIES",
    "GIT_CONFIG_GLOBAL",
    "GIT_CONFIG_NOSYSTEM",
    "GIT_CONFIG_SYSTEM",
    "GIT_DISCOVERY_ACROSS_FILESYSTEM",
    "GIT_EXEC_PATH",
)
"""GIT_ variables for git's location and the user's settings; a hook's others are removed."""

NO_PROGRAMS = (
    *("-c", f"core.hooksPath={os.devnull}"),
    *("-c", "core.fsmonitor=false"),
    *("-c", "diff.external="),
    *("-c", "diff.ignoreSubmodules=dirty"),  # a submodule's settings could start programs, too
)
"""Options of git by which the repository's settings cannot start a program."""

QUERY_TIMEOUT_S = 30.0  # only for commands that read; a checkout has no limit


def run_git(folder: Path, *arguments: str) -> str:
    """Return the output of a git command in `folder`, without the last line break.

    Hooks, the file system monitor, external diff programs and the repository's own filters are off.
    Filters of the user's settings, such as Git LFS, stay on.

    Raises OSError if git is not installed, subprocess.SubprocessError if the command fails.
    """
    git = shutil.which("git")
    if git is None:
        raise FileNotFoundError("git is not installed")
    environment = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith("GIT_") or name in KEPT_VARIABLES
    }
    environment |= {"GIT_OPTIONAL_LOCKS": "0", "GIT_TERMINAL_PROMPT": "0", "LC_ALL": "C"}
    reads = arguments[0] != "worktree"
    if reads:
        # A partial clone would fetch missing objects, by a program that the clone's settings name.
        environment["GIT_ALLOW_PROTOCOL"] = "none"

    def call(*parts: str) -> bytes:
        command = [git, "-C", str(folder), *NO_PROGRAMS, *parts]
        return subprocess.run(
            command,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=QUERY_TIMEOUT_S if reads else None,
            check=True,
        ).stdout

    off = []
    if arguments[0] in ("status", "worktree"):
        settings = call("config", "--list", "--show-scope", "--name-only", "-z").split(b"\0")
        for scope, name in zip(settings[::2], settings[1::2], strict=False):
            match = re.fullmatch(rb"filter\.(.*)\.(?:clean|smudge|process|required)", name, re.S)
            if match and scope not in (b"system", b"global", b"command"):
                if b"=" in match[1]:  # git's option -c cannot name such a filter
                    raise subprocess.SubprocessError("a filter's name contains '='")
                driver = f"filter.{os.fsdecode(match[1])}"
                off += [f"{driver}.{kind}=" for kind in ("clean", "smudge", "process")]
                off.append(f"{driver}.required=false")
    switches = [part for setting in dict.fromkeys(off) for part in ("-c", setting)]
    return os.fsdecode(call(*switches, *arguments)).removesuffix("\n")


def _run_git_or_none(folder: Path, *arguments: str) -> str | None:
    try:
        return run_git(folder, *arguments)
    except (OSError, subprocess.SubprocessError):
        return None


def read_git_state(folder: Path) -> dict[str, Any] | None:
    """Return a repository's commit, and whether tracked files changed; None if git fails."""
    commit = _run_git_or_none(folder, "rev-parse", "HEAD")
    changes = _run_git_or_none(folder, "status", "--porcelain", "--untracked-files=no")
    if commit is None or changes is None:
        return None
    return {"commit": commit, "dirty": bool(changes)}


def find_commit(folder: Path, reference: str) -> str | None:
    """Return the full hash of a commit, branch or tag, or None if it does not exist."""
    options = ("--verify", "--quiet", "--end-of-options")
    return _run_git_or_none(folder, "rev-parse", *options, f"{reference}^{{commit}}") or None


@contextmanager
def check_out(top: Path, commit: str) -> Iterator[Path]:
    """Check `commit` out into a temporary work tree; raise UsageError if that fails."""
    parent = Path(tempfile.mkdtemp(prefix="harness-base-")).resolve()
    folder = parent / top.name
    try:
        try:
            run_git(top, "worktree", "add", "--detach", "--force", str(folder), commit)
        except (OSError, subprocess.SubprocessError) as error:
            output = (getattr(error, "stderr", None) or b"").decode(errors="replace").strip()
            reason = output.splitlines()[-1] if output else error
            raise UsageError(
                f"--beside {commit}: checkout failed ({reason}); check it out, and give the folder"
            ) from error
        yield folder
    finally:
        # Not `git worktree prune`, which removes work trees that are only out of reach for now.
        _run_git_or_none(top, "worktree", "remove", "--force", "--force", str(folder))
        shutil.rmtree(parent, ignore_errors=True)


def find_project_folder(triangulators: Sequence[str]) -> Path | None:
    """Return the top of the current folder's repository, or else of a triangulator module's."""
    for folder in (Path.cwd(), *_list_module_folders(triangulators)):
        top = _run_git_or_none(folder, "rev-parse", "--show-toplevel")
        if top:
            return Path(top)
    return None


def describe_project(triangulators: Sequence[str]) -> dict[str, Any] | None:
    """Return name, commit (without git, from `COMMITS`) and changes of the user's repository."""
    folder = find_project_folder(triangulators)
    if folder is not None and (state := read_git_state(folder)) is not None:
        return {"name": _make_printable(folder.name), **state}
    commit = next((os.environ[name] for name in COMMITS if os.environ.get(name)), None)
    if commit is None:
        return None
    return {"name": _make_printable(Path.cwd().name), "commit": commit, "dirty": False}


def get_commit(facts: Mapping[str, Any], repository: str = "project") -> str:
    """Return a run's commit as `0123456789ab` or `0123456789ab with local changes`; "" if unknown.

    "project" is the user's repository, or the harness's ("git") if the run has none.
    """
    environment = facts.get("environment") or {}
    state = environment.get(repository) or environment.get("git") or {}
    commit = str(state.get("commit") or "")[:12]
    return f"{commit} with local changes" if commit and state.get("dirty") else commit


def _make_printable(name: str) -> str:
    """Return a file's name as valid Unicode for JSON."""
    return os.fsencode(name).decode(errors="replace")


def _list_module_folders(triangulators: Sequence[str]) -> Iterator[Path]:
    """Yield the folders of modules in `module:function` names; import only parent packages."""
    for name in triangulators:
        module, colon, _ = name.partition(":")
        try:
            spec = find_spec(module) if colon else None
        except (ImportError, ValueError):
            continue
        if spec is not None and spec.origin and Path(spec.origin).is_file():
            yield Path(spec.origin).parent
