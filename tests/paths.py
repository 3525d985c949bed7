"""The path of the repository and of third-party data, which the repository must not contain."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent


def find_shared_data(name: str) -> Path:
    """Return the path of a file of third-party data; skip the test if it is missing."""
    path = ROOT.parent / "shared" / "data" / name
    if not path.exists():
        pytest.skip(f"{name} is not in {path.parent}")
    return path


def run_python(*arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run Python in a child process with the repository on its path; the output is text."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **options.pop("env", {})}
    options = {"cwd": ROOT, "capture_output": True, "text": True, "env": environment} | options
    return subprocess.run([sys.executable, *map(str, arguments)], **options)
