"""Limits on the size of a file, so that one that would fill the memory is refused in one line."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

from scenes.scene import SceneError

LARGEST = 2**30
"""Bytes of the largest file that is read whole; `RASTER_HARNESS_LARGEST_FILE` sets another limit.

Formats that are read in chunks have no limit: those of GDAL, GeoParquet, WKT, CityJSON sequences.
"""

VARIABLE = "RASTER_HARNESS_LARGEST_FILE"

_RATIO = 100
"""A usual archive is at most this many times smaller than its content, a ZIP bomb 1000 times."""


def largest() -> int:
    """The limit in bytes. Raises SceneError if the environment variable is not a number."""
    text = os.environ.get(VARIABLE, "")
    if not text:
        return LARGEST
    if not text.isdecimal():
        raise SceneError(f"{VARIABLE}={text!r} is not a number of bytes: give one like {LARGEST}")
    return int(text)


def check_size(path: Path) -> None:
    """Raise SceneError for a file too large to be read whole."""
    size, limit = path.stat().st_size, largest()
    if size > limit:
        raise SceneError(
            f"{path} has {_shown(size)}, but files of its format are held in memory and the limit "
            f"is {_shown(limit)}: give a part of it, or set {VARIABLE}={size}"
        )


def check_archive(path: Path) -> None:
    """Raise SceneError for a ZIP archive whose content is over the limit and far over its own size.

    Some formats are ZIP archives with another suffix; this holds for them too.
    """
    with path.open("rb") as stream:
        if stream.read(4) != b"PK\x03\x04" or not zipfile.is_zipfile(path):
            return
    with zipfile.ZipFile(path) as archive:
        size = sum(entry.file_size for entry in archive.infolist())
    if size > max(largest(), _RATIO * path.stat().st_size):
        raise SceneError(
            f"{path} unpacks to {_shown(size)}, more than {_RATIO} times its size: "
            "unpack it yourself and give the file that you want from it"
        )


def _shown(size: int) -> str:
    return f"{size / 2**30:.3g} GiB" if size >= 2**30 else f"{size / 2**20:.3g} MiB"
