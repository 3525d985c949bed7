"""Programs that are built from a design's sources, each once and kept in the user's cache.

The sources are their authors'. Nothing of them is in this package: a user gets them, names their
folder by a variable of the environment, and they are held against a digest before they are used.
"""

import hashlib
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from harness.errors import NoRasteriser
from harness.machine.system import cache_file

INSTALL = "make simulated"
BUILD_S = 3600.0
LAST_LINES = 3
"""How much of a failed build's output is quoted."""


@dataclass(frozen=True)
class Sources:
    """The sources of one design, held against one digest.

    variable : names their folder
    get : how to get them, as an order
    parts : the files that are used, and the folders of which all files are
    digest : SHA-256 of a line a file, sorted by name, as sha256sum writes them
    tools : programs that build them
    """

    variable: str
    get: str
    parts: tuple[str, ...]
    digest: str
    tools: tuple[str, ...]

    def problem(self) -> str | None:
        """Say what lacks or is wrong with them, and what to do, or None."""
        given = os.environ.get(self.variable)
        if not given:
            return f"{self.variable} is not set: {self.get}"
        if self._found(Path(given)) != self.digest:
            return f"{self.variable}: {given} is not as it was published: {self.get}"
        missing = [tool for tool in self.tools if shutil.which(tool) is None]
        return f"{', '.join(missing)} not installed: run {INSTALL}" if missing else None

    def folder(self) -> Path:
        """Return the folder, absolute; raises NoRasteriser where `problem` says something."""
        if problem := self.problem():
            raise NoRasteriser(problem)
        return Path(os.environ[self.variable]).absolute()

    def _found(self, root: Path) -> str:
        found = hashlib.sha256()
        places = (file for part in self.parts for file in (root / part, *(root / part).rglob("*")))
        for file in sorted(file for file in places if file.is_file()):
            name = file.relative_to(root).as_posix()
            found.update(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {name}\n".encode())
        return found.hexdigest()


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
