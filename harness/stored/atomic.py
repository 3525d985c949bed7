"""Files that appear whole or not at all: written under another name first, then renamed."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path


def write(place: Path, content: bytes, *, forced: bool = False) -> None:
    """Write a file in an existing folder, whole or not at all.

    forced : it outlives a power cut, too

    Raises
    ------
    OSError
        if it cannot be written; what was there stays
    """
    descriptor, temporary = tempfile.mkstemp(dir=place.parent, prefix=f".{place.name}.")
    made = Path(temporary)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)
        made.chmod(0o644)
        move(made, place, forced=forced)
    except BaseException:
        made.unlink(missing_ok=True)
        raise


def move(made: Path, place: Path, *, forced: bool = False) -> None:
    """Rename a finished file to where it belongs, in the same file system.

    forced : first its content, then its name is forced to the disk, so that a name that is there
        after a power cut has all its content

    Raises
    ------
    OSError
        if the disk is full or gone, or `place` is a device, a pipe or a socket; nothing is there
        then but what was before
    """
    if place.exists() and not place.is_file() and not place.is_dir():
        raise FileExistsError(errno.EEXIST, "it is no regular file", str(place))
    if forced:
        with made.open("rb+") as file:
            os.fsync(file.fileno())
    made.replace(place)
    if forced and hasattr(os, "O_DIRECTORY"):  # Windows opens no folders
        descriptor = os.open(place.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
