"""Lines of a text file that may be anything: a line without end must not fill the memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from scenes.scene import SceneError

LONGEST = 64 * 2**20
"""Characters of the longest line that is read; a coastline of a million vertices has 40 million."""


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
