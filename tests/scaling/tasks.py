"""Tasks for executors: they succeed, fail or end the process."""

import ctypes
import os
import time
from pathlib import Path

from harness.errors import UsageError
from harness.scaling.dataset import FilePart, PartResult
from harness.scaling.triangulated import Triangulating


def note(folder: str, name: str, seconds: float = 0.0) -> int:
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


class CrashingPart(Triangulating):
    """Triangulate, or end the process at one part, like a fault in C."""

    def write_part(self, part: FilePart, path: Path, threads: int | None) -> PartResult:
        if part.label.endswith("0.parquet, rows 40 to 79"):
            ctypes.string_at(0)
        return super().write_part(part, path, threads)


def times(folder: Path) -> dict[str, int]:
    return {file.name: len(file.read_text()) for file in folder.iterdir()}
