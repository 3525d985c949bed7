"""Programs that are built from a design's sources, each once and kept in the user's cache.

The sources are their authors'. Nothing of them is in this package: a user gets them, names their
folder by a variable of the environment, and each file is held against a digest before it is used.
"""

import hashlib
import json
import os
import shutil
import subprocess
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

from harness.errors import NoRasteriser
from harness.machine.system import cache_file

INSTALL = "make simulated"
BUILD_S = 3600.0
LAST_LINES = 3
"""How much of a failed build's output is quoted."""


class Lacking(NamedTuple):
    """What a design cannot be simulated without, and what to do; a clause each."""

    what: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.what}: {self.remedy}"


def lacking(tools: Sequence[str]) -> Lacking | None:
    """Say which programs are not here, or None."""
    missing = [tool for tool in tools if shutil.which(tool) is None]
    return Lacking(f"{', '.join(missing)} not installed", f"run {INSTALL}") if missing else None


@dataclass(frozen=True)
class Sources(ABC):
    """The sources of one design.

    variable : names their folder
    get : how to get them, as an order
    """

    variable: str
    get: str

    def problem(self) -> Lacking | None:
        """Say what is wrong with them, or None."""
        given = os.environ.get(self.variable)
        if not given:
            return Lacking(f"{self.variable} is not set", self.get)
        wrong = self._wrong(Path(given))
        return Lacking(f"{self.variable}: {wrong}", self.get) if wrong else None

    def folder(self) -> Path:
        """Return the folder, absolute; raises NoRasteriser where `problem` says something."""
        if problem := self.problem():
            raise NoRasteriser(str(problem))
        return Path(os.environ[self.variable]).absolute()

    @abstractmethod
    def _wrong(self, root: Path) -> str | None:
        """Say in a clause what of the folder is not as it was published, or None."""


@dataclass(frozen=True)
class Files(Sources):
    """Some files, each held against a digest.

    digests : a file as sha256sum writes it, of all files that are used
    """

    digests: Path

    def files(self) -> dict[str, str]:
        """Return the SHA-256 of each file that is used, by its name in the folder."""
        lines = self.digests.read_text().splitlines()
        return {name: digest for digest, name in (line.split(maxsplit=1) for line in lines)}

    def _wrong(self, root: Path) -> str | None:
        for name, digest in self.files().items():
            file = root / name
            if not file.is_file():
                return f"there is no {file}"
            if hashlib.sha256(file.read_bytes()).hexdigest() != digest:
                return f"{file} is not as it was published"
        return None


@dataclass(frozen=True)
class Tree(Sources):
    """Many files, held against one digest of all that their folders hold.

    parts : the folders that are used
    digest : SHA-256 of a line a file, sorted by name, as sha256sum writes them
    """

    parts: tuple[str, ...]
    digest: str

    def _wrong(self, root: Path) -> str | None:
        files = (file for part in self.parts for file in (root / part).rglob("*"))
        found = hashlib.sha256()
        for file in sorted(file for file in files if file.is_file()):
            name = file.relative_to(root).as_posix()
            found.update(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {name}\n".encode())
        return None if found.hexdigest() == self.digest else f"{root} is not as it was published"


@cache
def version(tool: str) -> str:
    """Return the first line of what a program says of its version."""
    said = subprocess.run([tool, "--version"], capture_output=True, text=True, check=True)
    return said.stdout.splitlines()[0].strip()


def digest(files: Sequence[Path], facts: Mapping[str, object]) -> str:
    """Return 16 hexadecimal digits of the files' contents and of JSON-ready facts."""
    content = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for file in files:
        content.update(hashlib.sha256(file.read_bytes()).digest())
    return content.hexdigest()[:16]


def built(name: str, key: str, commands: Callable[[Path], Sequence[Sequence[str]]]) -> Path:
    """Return the folder of what `commands` build, in the user's cache.

    name, key : what is built, and what it is built from
    commands : for the folder they are to write to, the commands, one after the other

    Two that build at once build in folders of their own; the first to end is kept.

    Raises
    ------
    NoRasteriser
        if a command fails
    """
    place = cache_file("simulated") / f"{name}-{key}"
    if place.is_dir():
        return place
    place.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f"{name}-", dir=place.parent) as folder:
        made = Path(folder) / "made"
        made.mkdir()
        for command in commands(made):
            _run(name, command)
        try:
            made.rename(place)
        except OSError:
            if not place.is_dir():  # nobody else was faster
                raise
    return place


def _run(name: str, command: Sequence[str]) -> None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=BUILD_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NoRasteriser(f"{name} cannot be built: {error}") from error
    if done.returncode:
        lines = (done.stderr.strip() or done.stdout.strip()).splitlines()[-LAST_LINES:]
        said = " | ".join(line.strip() for line in lines)
        raise NoRasteriser(f"{name} cannot be built: {command[0]} failed: {said}")
