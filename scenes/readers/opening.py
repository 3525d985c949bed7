"""What may be opened, and read by lines: nothing that might never end, or fill the memory."""

from __future__ import annotations

import stat
from collections.abc import Iterable, Iterator
from pathlib import Path

from scenes.scene import SceneError

LONGEST = 64 * 2**20
"""Characters of the longest line that is read; a coastline of a million vertices has 40 million."""


def existing(path: str) -> Path:
    """The file; raises SceneError, in one line, where there is none, or it is empty or no file."""
    if "\0" in path:
        raise SceneError("a path cannot hold a NUL character: give another")
    file = Path(path)
    try:
        mode = file.stat().st_mode
        if not stat.S_ISDIR(mode):
            _refuse_special(path, mode)
            with file.open("rb") as stream:
                if not stream.read(1):
                    raise SceneError(f"{path} is empty (0 bytes): give a file with polygons")
    except (FileNotFoundError, NotADirectoryError):
        raise SceneError(f"there is no file {path}: check the path") from None
    except OSError as error:
        raise SceneError(f"{path} cannot be opened: {error.strerror or error}") from error
    return file


def refuse_special(paths: Iterable[Path]) -> None:
    """Raise SceneError for a pipe, socket or device among the paths; others need not exist."""
    for path in paths:
        try:
            mode = path.stat().st_mode
        except (OSError, ValueError):  # whoever opens it says so
            continue
        if not stat.S_ISDIR(mode):
            _refuse_special(str(path), mode)


def _refuse_special(path: str, mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise SceneError(f"{path} is a pipe, socket or device, not a file: save it as a file first")


def numbered_lines(path: Path) -> Iterator[tuple[int, str]]:
    """(number from 1, text) of each line. Raises SceneError for a line longer than `LONGEST`."""
    with path.open(encoding="utf-8-sig", errors="replace") as stream:
        number = 0
        while line := stream.readline(LONGEST):
            number += 1
            if len(line) == LONGEST:
                raise SceneError(
                    f"{path} line {number} has more than {LONGEST} characters: it is damaged, "
                    "or not a text file"
                )
            yield number, line
