"""Programs that are built from a design's sources, each once and kept in the user's cache."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping, Sequence
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
