"""Measures another version of the user's code, BASE, beside the present one, HEAD.

Both triangulate the same frames, each by its own code, and all drawings are timed together in the
same rounds: whatever the machine did, it did to both. Two run folders come of it, HEAD's and in it
BASE's, whose records pair sample by sample.

To the runner, BASE's triangulations are triangulators with a mark before their names. What it
writes of them goes to BASE's folder under their own names. Scenes and rasterisers are HEAD's.
"""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, cast

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from harness.errors import UsageError
from harness.machine.environment import project_folder, source_hash
from harness.measuring.other_version import Place, package_of, triangulate_elsewhere
from harness.measuring.plan import Case
from harness.measuring.processes import Backend, Bench, home_of
from harness.measuring.tasks import Candidate
from harness.measuring.timing import Times, TimingSettings
from harness.measuring.worker import OpenWorker
from harness.stored.drawings import FOLDER as FRAMES
from harness.stored.folder import FACTS, POLYGONS, Record, Run, Store, read_arrays, read_run
from harness.triangulating.frames import FrameTriangulation
from harness.triangulating.recipes import Recipe

MARK = "BASE "
"""Before the name of a triangulator as BASE has it."""

FOLDER = "base"
"""Folder of BASE's run inside that of HEAD's."""


@dataclass(frozen=True)
class Earlier(Recipe):
    """A triangulator as BASE has it."""

    @property
    def plain(self) -> Recipe:
        """The same as HEAD has it."""
        return Recipe(**vars(self))

    def __str__(self) -> str:
        """The marked name."""
        return MARK + super().__str__()

    @property
    def builtin(self) -> bool:
        """Never one of the product's own, which run where HEAD's do."""
        return False


@dataclass(frozen=True)
class Beside:
    """What a run is measured beside.

    twice : draw also those triangulations twice that BASE and HEAD have alike
    """

    place: Place
    twice: bool = False

    def recipes(self, recipes: Sequence[Recipe]) -> tuple[Recipe, ...]:
        """Return the triangulators of HEAD and of BASE."""
        return (*recipes, *(Earlier(**vars(recipe)) for recipe in recipes))

    def bench(self, open_worker: OpenWorker, timeout_s: float, database: Path | None) -> Bench:
        """Return a bench that triangulates by both versions."""
        return _Bench(self, open_worker, timeout_s, database)

    def facts(self) -> dict[str, Any]:
        """Return what HEAD's `run.json` tells of BASE."""
        return {"base": self.place.name, "commit": self.place.commit, "twice": self.twice}


def head_records(records: Iterable[Record]) -> list[Record]:
    """Return those of HEAD's own triangulators."""
    return [record for record in records if not record["triangulator"].startswith(MARK)]


@contextmanager
def version(reference: str, triangulators: Sequence[str]) -> Iterator[Place]:
    """Give the place of another version of the user's code.

    reference : a commit, branch or tag of the user's repository, which is checked out into a
        folder of its own as long as it is needed; or a folder with other code, or with an
        environment that has it installed

    Raises
    ------
    UsageError
        if there is no such version
    """
    top = project_folder(triangulators)
    commit = None if top is None else _commit(top, reference)
    if top is not None and commit is not None:
        with _checked_out(top, commit) as folder:
            yield _place(reference, commit, folder, top)
        return
    folder = Path(reference)
    if (folder / "bin" / "python").is_file():
        python = str((folder / "bin" / "python").absolute())
        yield Place(reference, "", str(folder.resolve()), "", str(Path.cwd()), (), python)
    elif folder.is_dir():
        yield _place(reference, _commit(folder, "HEAD") or "", folder.resolve(), top or Path.cwd())
    else:
        where = f"the repository {top}" if top else f"{Path.cwd()}, which is in no git repository"
        raise UsageError(
            f"--beside {reference}: no commit of {where}, and no folder; in CI, fetch it first: "
            f"git fetch --depth=1 origin {reference}"
        )


def _commit(folder: Path, reference: str) -> str | None:
    wanted = f"{reference}^{{commit}}"
    command = ["git", "-C", str(folder), "rev-parse", "--verify", "--quiet", "--end-of-options"]
    try:
        done = subprocess.run([*command, wanted], capture_output=True, text=True, check=False)
    except OSError:  # no git here
        return None
    return done.stdout.strip() if done.returncode == 0 else None


@contextmanager
def _checked_out(top: Path, commit: str) -> Iterator[Path]:
    """Check `commit` out into a temporary work tree; it is removed afterwards."""
    above = Path(tempfile.mkdtemp(prefix="harness-base-")).resolve()
    folder = above / top.name
    git = ["git", "-C", str(top), "worktree"]
    try:
        done = subprocess.run(
            [*git, "add", "--detach", "--force", str(folder), commit],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise UsageError(f"--beside {commit}: {done.stderr.strip().splitlines()[-1]}")
        yield folder
    finally:
        shutil.rmtree(above, ignore_errors=True)
        subprocess.run([*git, "prune"], capture_output=True, check=False)


def _place(name: str, commit: str, folder: Path, top: Path) -> Place:
    """Return the place of code in `folder` that stands for that in `top`.

    Whatever is found in `top` here is looked for in `folder` there, in the same order; what is
    not in the version, such as an environment, stays where it is.
    """
    top = top.resolve()
    path = [str(folder), *(str(folder / part) for part in ("src",) if (folder / part).is_dir())]
    for entry in sys.path:
        here = Path(entry or ".").resolve()
        there = folder / here.relative_to(top) if here.is_relative_to(top) else here
        path.append(str(there if there.exists() else here))
    cwd = Path.cwd().resolve()
    inside = folder / cwd.relative_to(top) if cwd.is_relative_to(top) else folder
    return Place(
        name=name,
        commit=commit,
        folder=str(folder),
        instead_of=str(top),
        cwd=str(inside if inside.is_dir() else folder),
        path=tuple(dict.fromkeys(path)),
    )


class _Bench(Bench):
    """Triangulates a marked name by BASE's code; draws once what both have alike."""

    def __init__(
        self, beside: Beside, open_worker: OpenWorker, timeout_s: float, database: Path | None
    ) -> None:
        super().__init__(open_worker, timeout_s, database)
        self._beside = beside
        self._same_builtins: bool | None = None
        self._latest: tuple[Sequence[Polygon], dict[Recipe, FrameTriangulation]] = ((), {})

    def compile(self, recipe: Recipe, tick: Callable[[float], None] | None = None) -> None:
        """Have what a triangulator of HEAD needs compiled; BASE's is where it is asked."""
        if not isinstance(recipe, Earlier):
            super().compile(recipe, tick)

    def triangulate(
        self,
        recipe: Recipe,
        polygons: Sequence[Polygon],
        tick: Callable[[float], None] | None = None,
    ) -> FrameTriangulation:
        """Run a triangulator of HEAD or of BASE over polygons in px; raises as `Bench` does."""
        if not isinstance(recipe, Earlier):
            result = super().triangulate(recipe, polygons, tick)
            if self._latest[0] is not polygons:
                self._latest = (polygons, {})
            self._latest[1][recipe] = result
            return result
        if recipe.plain.builtin and self._has_same_builtins():
            known = self._latest[1].get(recipe.plain) if self._latest[0] is polygons else None
            return known or super().triangulate(recipe.plain, polygons, tick)
        with self.clocked("triangulate"):
            arguments = (recipe.plain, polygons, self._beside.place)
            home = home_of(recipe)
            return self.run(home, triangulate_elsewhere, *arguments, tick=tick)

    def _has_same_builtins(self) -> bool:
        """Whether BASE's package `triangulators` is the one of here, or equal to it."""
        if self._same_builtins is None:
            place = self._beside.place
            found = None if place.python != sys.executable else package_of(place)
            own = source_hash(Path(sys.modules["triangulators"].__path__[0]))
            self._same_builtins = found is not None and source_hash(found) == own
        return self._same_builtins

    def time(
        self,
        backend: Backend,
        candidates: Mapping[str, Candidate],
        settings: TimingSettings,
        seed: int,
        tick: Callable[[float], None] | None = None,
    ) -> tuple[dict[str, dict[str, Times]], dict[str, str]]:
        """Time the candidates together; where BASE's triangles are HEAD's, one drawing is both."""
        alike = {} if self._beside.twice else _alike(candidates)
        drawn = {name: each for name, each in candidates.items() if name not in alike}
        found, failures = super().time(backend, drawn, settings, seed, tick)
        for name, other in alike.items():
            if other in found:
                found[name] = {**found[other], name: found[other][other]}
            else:
                failures[name] = failures[other]
        return found, failures


def _alike(candidates: Mapping[str, Candidate]) -> dict[str, str]:
    """Return {marked name: name} of those that have the same triangles in the same order."""
    pairs = ((MARK + name, name) for name in candidates if MARK + name in candidates)
    return {
        marked: name
        for marked, name in pairs
        if np.array_equal(candidates[marked][1], candidates[name][1])
    }


class Halves(Store):
    """The folder of HEAD's run, with the folder of BASE's run in it.

    What is marked lies in HEAD's folder until its record is complete, then in BASE's.
    """

    _base: Store

    @classmethod
    def create(cls, path: Path) -> Self:
        """Make new folders for both; raises `UsageError` as `Store.create` does."""
        halves = cast("Self", super().create(path))
        halves._base = Store.create(path / FOLDER)
        return halves

    @classmethod
    def resume(cls, path: Path) -> Self:
        """Open the folders of both; raises `UsageError` as `Store.resume` does."""
        halves = cast("Self", super().resume(path))
        base = path / FOLDER  # without facts where a kill came between the two
        halves._base = (Store.resume if (base / FACTS).is_file() else Store.create)(base)
        return halves

    def write_facts(self, facts: Mapping[str, Any]) -> None:
        """Replace `run.json` of both."""
        super().write_facts(facts)
        beside = facts["beside"]
        environment = dict(facts["environment"])
        project = {**(environment.get("project") or {}), "commit": beside["commit"], "dirty": False}
        environment["project"] = project if beside["commit"] else None
        told = {**beside, "is_base": True}
        self._base.write_facts({**facts, "environment": environment, "beside": told})

    def append(self, record: Record) -> None:
        """Add a record to the run that it is of."""
        name = record["triangulator"]
        if not name.startswith(MARK):
            super().append(record)
            return
        own = Case.of({**record, "triangulator": name.removeprefix(MARK)})
        columns = read_arrays(Run(self.path, {}, []), record["key"])
        if columns is not None:
            self._base.write_arrays(own.key, columns)
            (self.path / POLYGONS / f"{record['key']}.npz").unlink()
        self._base.append({**record, **own.identity()})

    def write_arrays(
        self, key: str, arrays: Mapping[str, NDArray[Any]], folder: str = POLYGONS
    ) -> None:
        """Store a case's columns, or what was drawn in a view, each in the run that it is of."""
        if folder == FRAMES:
            mark = f" {MARK}"
            marked = {name: each for name, each in arrays.items() if mark in name}
            shared = {name: each for name, each in arrays.items() if " " not in name}
            plain = {name.replace(mark, " ", 1): each for name, each in marked.items()}
            before = read_arrays(Run(self._base.path, {}, []), key, folder) or {}
            if np.array_equal(before.get("points", ()), shared["points"]):
                plain = {**before, **plain}
            self._base.write_arrays(key, {**plain, **shared}, folder)
            arrays = {name: each for name, each in arrays.items() if name not in marked}
        super().write_arrays(key, arrays, folder)

    def finished(self) -> dict[str, Record]:
        """Return what both runs hold, by the keys that their cases have in a run of both."""
        found = {record["key"]: record for record in read_run(self.path).records}
        for record in read_run(self._base.path).records:
            marked = {**record, "triangulator": MARK + record["triangulator"]}
            key = Case.of(marked).key
            found[key] = {**marked, "key": key}
        return found

    def close(self) -> None:
        """Close the files of both."""
        super().close()
        self._base.close()
