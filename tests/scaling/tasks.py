"""Tasks for crews: some fail, some end their process."""

import ctypes
import os
import time
from pathlib import Path
from typing import Any

from harness.errors import UsageError

FAR = 100_000.0


def note(folder: str, name: str, seconds: float = 0.0) -> int:
    """Note that this was carried out; returns the process's number."""
    time.sleep(seconds)
    with (Path(folder) / name).open("a") as file:
        file.write("x")
    return os.getpid()


def fail(folder: str, name: str) -> None:
    note(folder, name)
    raise UsageError("not this one")


def crash(folder: str, name: str) -> None:
    note(folder, name)
    os.abort()


def crash_on_far(*arguments: Any) -> Any:
    """Triangulate a part; a footprint east of `FAR` ends the process as a fault in C would."""
    from harness.export import export  # these take long to load, and the other tasks need none
    from harness.scaling.triangulated import do_part

    triangulate = export.triangulate_many

    def triangulate_or_crash(polygons: Any, *more: Any, **how: Any) -> Any:
        if (polygons.coordinates[:, 0] > FAR).any():
            ctypes.string_at(0)
        return triangulate(polygons, *more, **how)

    export.triangulate_many = triangulate_or_crash
    try:
        return do_part(*arguments)
    finally:
        export.triangulate_many = triangulate


def times(folder: Path) -> dict[str, int]:
    """How often each task was carried out."""
    return {file.name: len(file.read_text()) for file in folder.iterdir()}
