"""Interleaved baseline (`run --beside`): another version of the user's code, BASE, next to HEAD.

All drawings are timed in the same rounds, so that machine drift affects both versions equally.
BASE's run folder is inside HEAD's; sample r of a case's record in either folder is from the same
round. BASE triangulates in a separate interpreter, by `other_version_script.py`; this module
verifies the triangulations.
"""

import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely import Polygon

from harness.errors import UsageError
from harness.machine.environment import hash_sources
from harness.machine.git import check_out, find_commit, find_project_folder
from harness.serving import TaskError
from harness.triangulating.recipes import Recipe
from harness.triangulating.triangulate import (
    FrameTriangulation,
    check_triangles,
    make_small_polygons,
)
from triangulators.errors import truncate

SCRIPT = Path(__file__).with_name("other_version_script.py")

FOLDER = "base"  # name of the baseline's run folder inside the run's folder


@dataclass(frozen=True)
class OtherVersion:
    """Location of another version of the code, and the environment to run that version.

    instead_of : folder of the current code (HEAD), which must not be imported instead, or ""
    cwd, path, python : current folder, entries of PYTHONPATH and interpreter of its processes
    twice : True to time both versions even if their triangulations are equal
    """

    name: str
    commit: str
    folder: str
    instead_of: str
    cwd: str
    path: tuple[str, ...]
    python: str = sys.executable
    twice: bool = False

    @cached_property
    def has_same_builtins(self) -> bool:
        """True if the version's package `triangulators` has the same source files as this one."""
        if self.python != sys.executable:
            return False
        file = _run_script(self, {"triangulator": None})["file"]
        head_hash = hash_sources(Path(sys.modules["triangulators"].__path__[0]))
        return file is not None and hash_sources(Path(file).parent) == head_hash


@contextmanager
def open_other_version(reference: str, triangulators: Sequence[str]) -> Iterator[OtherVersion]:
    """Yield another version of the user's code, which exists until the end of the block.

    reference : a commit, branch or tag of the user's repository, which is checked out into a
        temporary folder; a folder with the code; or an environment in which the code is installed
    """
    top = find_project_folder(triangulators)
    commit = None if top is None else find_commit(top, reference)
    if top is not None and commit is not None:
        with check_out(top, commit) as folder:
            yield _make_version(reference, commit, folder, top)
        return
    folder = Path(reference)
    python = folder / "bin" / "python"
    if python.is_file():
        environment_folder, interpreter = str(folder.resolve()), str(python.absolute())
        yield OtherVersion(reference, "", environment_folder, "", str(Path.cwd()), (), interpreter)
    elif folder.is_dir():
        commit = find_commit(folder, "HEAD") or ""
        yield _make_version(reference, commit, folder.resolve(), top or Path.cwd())
    else:
        repository = f"the repository {top}" if top else f"{Path.cwd()} (not in a git repository)"
        raise UsageError(
            f"--beside {reference}: neither a commit of {repository} nor a folder; in CI, fetch "
            f"the commit first: git fetch --depth=1 origin {reference}"
        )


def _make_version(name: str, commit: str, folder: Path, top: Path) -> OtherVersion:
    """Return the version of the code in `folder`; `top` is the folder of the current code.

    Import paths inside `top` are replaced by the same paths inside `folder`, if these exist.
    """
    top = top.resolve()
    path = [str(folder), *(str(folder / part) for part in ("src",) if (folder / part).is_dir())]
    for entry in sys.path:
        current = Path(entry or ".").resolve()
        moved = folder / current.relative_to(top) if current.is_relative_to(top) else current
        path.append(str(moved if moved.exists() else current))
    cwd = Path.cwd().resolve()
    inside = folder / cwd.relative_to(top) if cwd.is_relative_to(top) else folder
    return OtherVersion(
        name=name,
        commit=commit,
        folder=str(folder),
        instead_of=str(top),
        cwd=str(inside if inside.is_dir() else folder),
        path=tuple(dict.fromkeys(path)),
    )


def triangulate_with_other_version(
    recipe: Recipe, polygons: Sequence[Polygon], other: OtherVersion
) -> FrameTriangulation:
    """Run another version's triangulator over polygons in px, and verify the triangles here.

    Raises TaskError if the triangulator fails to run, or if HEAD's code would run instead.
    """
    answer = _run_script(
        other,
        {
            "triangulator": recipe.base,
            "parameters": recipe.parameters,
            "polygons": shapely.to_wkb(list(polygons)).tolist(),
            "warm_up": shapely.to_wkb(list(make_small_polygons())).tolist(),
        },
    )
    source = Path(answer["file"] or "").resolve()
    if (
        answer["file"]
        and other.instead_of
        and source.is_relative_to(other.instead_of)
        and not source.is_relative_to(other.folder)
        and "site-packages" not in source.parts
    ):
        raise TaskError(
            f"{other.name}: {recipe.base} is imported from HEAD ({source}), as an editable install "
            "hides BASE's code; add BASE's folder to PYTHONPATH"
        )
    result = FrameTriangulation(seconds=float(answer["seconds"]))
    for polygon, (kind, value) in zip(polygons, answer["results"], strict=True):
        part, junctions, problem = None, 0, ""
        if kind == "triangles":
            part = np.asarray(value)
            junctions, problem = check_triangles(polygon, part)
        elif kind == "skipped":
            result.skipped.append((len(result.parts), truncate(value)))
        else:
            problem = truncate(value)
        result.add(part, junctions, problem)
    return result


def _run_script(other: OtherVersion, question: Mapping[str, Any]) -> dict[str, Any]:
    """Run `other_version_script.py`, which documents question and answer."""
    with tempfile.TemporaryDirectory(prefix="harness-beside-") as folder:
        question_file, answer_file = Path(folder, "question"), Path(folder, "answer")
        question_file.write_bytes(pickle.dumps(question))
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(other.path)}
        command = [other.python, "-P", str(SCRIPT), str(question_file), str(answer_file)]
        process = subprocess.run(command, cwd=other.cwd, env=environment, stdout=2, check=False)
        if (code := process.returncode) or not answer_file.exists():
            raise TaskError(f"{other.name}: the triangulating process ended with exit code {code}")
        answer: dict[str, Any] = pickle.loads(answer_file.read_bytes())
    if "error" in answer:
        raise TaskError(f"{other.name}: {truncate(answer['error'])}")
    return answer
