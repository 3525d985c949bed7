"""How much a file may hold: what would fill the memory or the disk is refused in one line."""

from __future__ import annotations

import gzip
import os
import tarfile
import zipfile
from pathlib import Path

from scenes.scene import SceneError

LARGEST = 2**30
"""Bytes of the largest file that is read whole; `RASTER_HARNESS_LARGEST_FILE` sets another limit.

What is read piece by piece has none: formats of GDAL, GeoParquet, WKT lines, CityJSON sequences.
"""

VARIABLE = "RASTER_HARNESS_LARGEST_FILE"

_RATIO = 100
"""How much smaller an honest archive is at most; those made to fill memories are 1000 times."""


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
            f"{path} has {_shown(size)}, and its format is read whole: the limit is "
            f"{_shown(limit)}; give a part of it, or set {VARIABLE}={size}"
        )


def check_archive(path: Path) -> None:
    """Raise SceneError for an archive that holds far more than its own size, and above the limit.

    ZIP archives (also those that go by another suffix), gzip and tar files are looked into.
    """
    limit = max(largest(), _RATIO * path.stat().st_size)
    size = _unpacked(path, limit)
    if size is not None and size > limit:
        raise SceneError(
            f"{path} unpacks to more than {_shown(limit)}, {_RATIO} times its size or more: "
            "unpack it yourself and give the file that you want from it"
        )


def _unpacked(path: Path, limit: int) -> int | None:
    """Bytes that an archive unpacks to, counted no further than the limit; None for other files."""
    with path.open("rb") as stream:
        head = stream.read(4)
    if head[:2] == b"\x1f\x8b":
        return _inflated(path, limit)
    if head == b"PK\x03\x04" and zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            return sum(entry.file_size for entry in archive.infolist())
    if path.suffix.lower() == ".tar" and tarfile.is_tarfile(path):
        with tarfile.open(path) as archive:
            return sum(entry.size for entry in archive)
    return None


def _inflated(path: Path, limit: int) -> int:
    """The trailer of a gzip file says its size, but only below 4 GiB, and may lie: count."""
    if path.stat().st_size * 1032 <= limit:  # the most that deflate can do
        return 0
    size = 0
    with gzip.open(path) as stream:
        while size <= limit and (piece := stream.read(1 << 20)):
            size += len(piece)
    return size


def _shown(size: int) -> str:
    return f"{size / 2**30:.3g} GiB" if size >= 2**30 else f"{size / 2**20:.3g} MiB"
