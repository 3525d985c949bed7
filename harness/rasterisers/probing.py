"""Runs programs that ask drivers what they can open, each in an environment of its own.

All of them take seconds, so what they found is kept in the user's cache folder, and asked again
when drivers, device nodes or the variables that choose between them have changed.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from harness.machine import system
from harness.stored import atomic

PROBE_SECONDS = 20.0

PLACES = (
    "usr/lib/*-linux-gnu",
    "usr/lib64",
    "usr/local/lib",
    "usr/share/vulkan/icd.d",
    "etc/vulkan/icd.d",
    "usr/share/glvnd/egl_vendor.d",
    "etc/glvnd/egl_vendor.d",
    "dev/dri",
    "dev/nvidia*",
)
"""What is written to when a driver or a device comes, changes or goes; below the root."""

VARIABLES = re.compile(
    r"(LD|LIBGL|MESA|GALLIUM|EGL|__EGL|__GLX|__NV|NVIDIA|CUDA|VK|LP|ZINK|WGPU|WAYLAND)_|DISPLAY$|"
    r"PYTHONPATH$"
)
"""Names of environment variables that drivers and their loaders read."""

ROOT = Path("/")

MOST_KEPT = 64
"""Answers that are kept: those of some ten environments."""


class Question(NamedTuple):
    """One start of a program that prints a JSON object {"devices": [...], "problems": [...]}.

    arguments : of the program
    environment : variables beside those of this process
    """

    program: Path
    arguments: tuple[str, ...]
    environment: Mapping[str, str]


def ask(questions: Sequence[Question]) -> list[dict[str, Any]]:
    """Return the answer to each question; those whose answer is not kept are asked at once."""
    kept = _read()
    keys = [_key(question) for question in questions]
    asked = dict(zip(keys, questions, strict=True))
    running = {key: start(question) for key, question in asked.items() if key not in kept}
    fresh = {key: finish(process) for key, process in running.items()}
    # What gave no answer may give one the next time.
    told = {key: answer for key, answer in fresh.items() if not answer.get("failed")}
    if told and sys.platform == "linux":
        _write(kept | told)
    return [(kept | fresh)[key] for key in keys]


def forget() -> None:
    """Ask everything anew."""
    _file().unlink(missing_ok=True)


def _file() -> Path:
    return system.cache_file("drivers.json")


def _read() -> dict[str, dict[str, Any]]:
    try:
        kept = json.loads(_file().read_text())
        return {
            key: answer
            for key, answer in kept.items()
            if isinstance(answer["devices"], list) and isinstance(answer["problems"], list)
        }
    except (OSError, ValueError, AttributeError, KeyError, TypeError):
        return {}


def _write(kept: Mapping[str, Any]) -> None:
    file = _file()
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        atomic.write(file, json.dumps(dict(list(kept.items())[-MOST_KEPT:])).encode())


def _key(question: Question) -> str:
    """Return a digest of all that an answer depends on."""
    about = (
        question.program.read_text(),
        question.arguments,
        sorted(question.environment.items()),
        sys.prefix,
        sorted(item for item in os.environ.items() if VARIABLES.match(item[0])),
        list(_states()),
    )
    return hashlib.sha256(repr(about).encode()).hexdigest()[:24]


def _states() -> Iterator[tuple[str, int]]:
    found = [path for pattern in PLACES for path in sorted(ROOT.glob(pattern))]
    for path in [*found, Path(sysconfig.get_path("platlib"))]:
        yield str(path), path.stat().st_mtime_ns


def start(question: Question) -> subprocess.Popen[str]:
    """Start a program that prints one JSON object {"devices": [...], "problems": [...]}."""
    return subprocess.Popen(
        [sys.executable, "-P", str(question.program), *question.arguments],
        env={**os.environ, **question.environment},
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
        return _failed(f"no answer within {PROBE_SECONDS:.0f} s")
    if process.returncode:
        last = complaints.strip().splitlines()[-1:] or [f"exit code {process.returncode}"]
        return _failed(f"the driver failed: {last[0]}")
    result: dict[str, Any] = json.loads(out.splitlines()[-1])
    return result


def _failed(problem: str) -> dict[str, Any]:
    return {"devices": [], "problems": [problem], "failed": True}
