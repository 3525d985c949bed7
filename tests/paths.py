"""Where the repository is, and data of other people, which may not be part of it."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent


def shared_data(name: str) -> Path:
    """Return a file of the folder beside the repository; skips the test where it is absent."""
    path = ROOT.parent / "shared" / "data" / name
    if not path.exists():
        pytest.skip(f"{name} is not in {path.parent}")
    return path


def python(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run Python, which finds the repository, in a process of its own; what it says is text."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **options.pop("env", {})}
    options = {"cwd": ROOT, "capture_output": True, "text": True, "env": environment} | options
    return subprocess.run([sys.executable, *map(str, arguments)], **options)
