"""Programs that ask drivers what they can open, each in a process and environment of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

PROBE_SECONDS = 20.0


def start(program: Path, mode: str, environment: Mapping[str, str]) -> subprocess.Popen[str]:
    """Start a program that prints one JSON object {"devices": [...], "problems": [...]}."""
    return subprocess.Popen(
        [sys.executable, "-P", str(program), mode],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process: subprocess.Popen[str]) -> dict[str, Any]:
    """Wait for what the program prints; one that hangs or dies found no device."""
    try:
        out, complaints = process.communicate(timeout=PROBE_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return {"devices": [], "problems": [f"no answer within {PROBE_SECONDS:.0f} s"]}
    if process.returncode:
        last = complaints.strip().splitlines()[-1:] or [f"exit code {process.returncode}"]
        return {"devices": [], "problems": [f"the driver failed: {last[0]}"]}
    result: dict[str, Any] = json.loads(out.splitlines()[-1])
    return result
