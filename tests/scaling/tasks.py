"""Tasks for executors: they succeed, fail or end the process."""

import os
import time
from pathlib import Path

from harness.errors import UsageError


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


def times(folder: Path) -> dict[str, int]:
    return {file.name: len(file.read_text()) for file in folder.iterdir()}
