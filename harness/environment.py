"""The machine and software a run was measured with, and what about them makes times shaky."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import psutil

from harness import __version__

ROOT = Path(__file__).resolve().parent.parent

PACKAGES = (
    "glcontext",
    "manifold3d",
    "mapbox-earcut",
    "moderngl",
    "numba",
    "numpy",
    "pyogrio",
    "pyopengl",
    "pyrender",
    "scipy",
    "shapely",
)

VARIABLES = (
    "GALLIUM_DRIVER",
    "LIBGL_ALWAYS_SOFTWARE",
    "LP_NUM_THREADS",
    "MESA_GL_VERSION_OVERRIDE",
    "NUMBA_NUM_THREADS",
    "VK_ICD_FILENAMES",
    "__EGL_VENDOR_LIBRARY_FILENAMES",
)

BUSY = 0.5
"""Load a core above which other programs are likely to disturb the times."""


def collect(seed: int) -> dict[str, Any]:
    """Return the facts about this machine, JSON-ready; what cannot be read is None."""
    memory = psutil.virtual_memory()
    return {
        "harness": __version__,
        "code": code_version(),
        "git": _git(),
        "command": ["harness", *sys.argv[1:]],
        "seed": seed,
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES},
        "kernel": f"{platform.system()} {platform.release()}",
        "cpu": cpu_name(),
        "cores": psutil.cpu_count(logical=False),
        "threads": psutil.cpu_count(),
        "governor": _read(Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")),
        "load": list(os.getloadavg()),
        "memory_gib": round(memory.total / 2**30, 1),
        "memory_free_gib": round(memory.available / 2**30, 1),
        "gpus": _nvidia(),
        "variables": {name: os.environ[name] for name in VARIABLES if name in os.environ},
    }


def warnings(facts: dict[str, Any]) -> list[str]:
    """Say, a line each, what about the machine makes its times less trustworthy."""
    found = []
    load, threads = facts["load"][0], facts["threads"] or 1
    if load > BUSY * threads:
        found.append(
            f"the machine is busy (load {load:.1f} on {threads} threads): times will scatter; "
            "close other programs"
        )
    if facts["governor"] not in (None, "performance"):
        found.append(
            f"the CPU governor is '{facts['governor']}', so the clock varies; "
            "run: sudo cpupower frequency-set -g performance"
        )
    return found


def code_version() -> str:
    """Return 16 hexadecimal digits that change with any source file of the three packages."""
    digest = hashlib.sha256()
    for package in ("harness", "scenes", "triangulators"):
        folder = ROOT / package
        for file in sorted([*folder.rglob("*.py"), *folder.rglob("*.glsl")]):
            digest.update(str(file.relative_to(ROOT)).encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _git() -> dict[str, Any] | None:
    """Return the commit of the project and whether it has local changes; None outside git."""
    if not (ROOT / ".git").exists():
        return None
    commit = _run("git", "-C", str(ROOT), "rev-parse", "HEAD")
    changes = _run("git", "-C", str(ROOT), "status", "--porcelain", "--untracked-files=no")
    if commit is None or changes is None:
        return None
    return {"commit": commit, "dirty": bool(changes)}


def _nvidia() -> list[dict[str, str]] | None:
    fields = ("name", "driver_version", "clocks.sm", "clocks.max.sm", "clocks.mem")
    text = _run("nvidia-smi", f"--query-gpu={','.join(fields)}", "--format=csv,noheader")
    if text is None:
        return None
    return [dict(zip(fields, row.split(", "), strict=False)) for row in text.splitlines()]


def _run(*command: str) -> str | None:
    program = shutil.which(command[0])
    if program is None:
        return None
    try:
        done = subprocess.run(
            [program, *command[1:]], capture_output=True, text=True, timeout=10, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def cpu_name() -> str | None:
    """Return the processor's model as the system names it, None where it does not."""
    for line in (_read(Path("/proc/cpuinfo")) or "").splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor() or None


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _read(file: Path) -> str | None:
    try:
        return file.read_text().strip()
    except OSError:
        return None
