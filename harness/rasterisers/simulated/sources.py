"""Where a design's sources lie, and whether they are those that the counts are known for.

They are their authors'. Nothing of them is in this package: a user gets them, names their folder
by a variable of the environment, and each file is held against a digest before it is used.
"""

from __future__ import annotations

import hashlib
import os
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

from harness.errors import NoRasteriser
from harness.rasterisers.simulated.building import Lacking


@dataclass(frozen=True)
class _Sources(ABC):
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
        """Return the folder; raises NoRasteriser where `problem` says something."""
        if problem := self.problem():
            raise NoRasteriser(str(problem))
        return Path(os.environ[self.variable])

    @abstractmethod
    def _wrong(self, root: Path) -> str | None:
        """Say in a clause what of the folder is not as it was published, or None."""


@dataclass(frozen=True)
class Sources(_Sources):
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
class Tree(_Sources):
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
