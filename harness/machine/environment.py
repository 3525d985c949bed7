"""Facts about a run's machine and software, and warnings that times may be unreliable.

A software rasteriser is as fast as its processor. Virtual machines mask the processor's name ("AMD
EPYC"), so family, model, stepping and caches are recorded as well, and the vector width, on which
the code that llvmpipe generates depends.
"""

import hashlib
import os
import platform
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import psutil

from harness import __version__
from harness.machine import system
from harness.machine.git import describe_project, read_git_state
from triangulators.compute import compiled_files

ROOT = compiled_files.SOURCES

RECORDED_PACKAGES = (
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

RECORDED_VARIABLES = (
    "GALLIUM_DRIVER",
    "LIBGL_ALWAYS_SOFTWARE",
    "LP_NUM_THREADS",
    "MESA_GL_VERSION_OVERRIDE",
    "NUMBA_NUM_THREADS",
    "VK_ICD_FILENAMES",
    "__EGL_VENDOR_LIBRARY_FILENAMES",
)

MAX_LOAD_PER_CORE = 0.5  # above this, other programs are likely to disturb times


def collect_facts(seed: int, triangulators: Sequence[str] = ()) -> dict[str, Any]:
    """Return facts about this machine and the user's repository, JSON-ready; None if unknown."""
    memory = system.query_psutil(psutil.virtual_memory)
    return {
        "harness": __version__,
        "code": hash_code(),
        "git": read_git_state(ROOT) if (ROOT / ".git").exists() else None,
        "project": describe_project(triangulators),
        "command": ["harness", *sys.argv[1:]],
        "seed": seed,
        "python": platform.python_version(),
        "packages": {name: get_version(name) for name in RECORDED_PACKAGES},
        "kernel": f"{platform.system()} {platform.release()}",
        "cpu": describe_processor()["name"],
        "cores": system.query_psutil(lambda: psutil.cpu_count(logical=False)),
        "threads": os.cpu_count(),
        "governor": _read_text(GOVERNOR).strip() or None,
        "load": list(system.query_psutil(psutil.getloadavg) or []) or None,
        "memory_gib": round(memory.total / 2**30, 1) if memory else None,
        "memory_free_gib": round(memory.available / 2**30, 1) if memory else None,
        "gpus": _query_nvidia(),
        "variables": {name: os.environ[name] for name in RECORDED_VARIABLES if name in os.environ},
    }


def list_warnings(facts: dict[str, Any]) -> list[str]:
    """Return reasons for which times may scatter on the machine of `facts`, a line each."""
    warnings = []
    load, threads = (facts["load"] or [0.0])[0], facts["threads"] or 1
    if load > MAX_LOAD_PER_CORE * threads:
        warnings.append(
            f"the machine is busy (load {load:.1f} on {threads} threads): times will scatter; "
            "close other programs"
        )
    if facts["governor"] not in (None, "performance"):
        warnings.append(
            f"the CPU governor is '{facts['governor']}', so the clock varies; "
            "run: sudo cpupower frequency-set -g performance"
        )
    return warnings


def hash_code() -> str:
    """Return a hash, 16 hexadecimal digits, of the source files of this program's packages."""
    return hash_sources(*(ROOT / package for package in sorted(compiled_files.PACKAGES)))


def hash_sources(*packages: Path) -> str:
    """Return a hash, 16 hexadecimal digits, of the source files in the packages' folders."""
    digest = hashlib.sha256()
    for folder in packages:
        files = (Path(top, name) for top, _, names in os.walk(folder) for name in names)
        for file in sorted(file for file in files if file.suffix in (".py", ".glsl", ".wgsl")):
            digest.update(str(file.relative_to(folder.parent)).encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _query_nvidia() -> list[dict[str, str]] | None:
    fields = ("name", "driver_version", "clocks.sm", "clocks.max.sm", "clocks.mem")
    query = f"--query-gpu={','.join(fields)}"
    command = ["nvidia-smi", query, "--format=csv,noheader"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    rows = done.stdout.strip().splitlines()
    return [dict(zip(fields, row.split(", "), strict=False)) for row in rows]


def get_version(package: str) -> str | None:
    """Return the version of an installed package, or None."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


CPUINFO = Path("/proc/cpuinfo")
GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
CACHES = Path("/sys/devices/system/cpu/cpu0/cache")

# For each fact, its names in /proc/cpuinfo on x86 and ARM.
CPUINFO_FIELDS = {
    "vendor": ("vendor_id", "CPU implementer"),
    "name": ("model name",),
    "family": ("cpu family", "CPU architecture"),
    "model": ("model", "CPU part"),
    "stepping": ("stepping", "CPU revision"),
}

VECTOR_FLAGS = (("avx512f", 512), ("avx2", 256), ("avx", 256), ("sse2", 128), ("asimd", 128))
"""(CPU flag, bits of a vector register), widest first."""


@cache
def describe_processor() -> dict[str, Any]:
    """Return facts about this machine's processor, JSON-ready; unknown facts are None."""
    facts = _parse_cpuinfo(_read_text(CPUINFO)) | {"caches": dict(_read_caches(CACHES))}
    facts["name"] = facts["name"] or platform.processor() or None
    return {**facts, "label": _format_label(facts)}


def _parse_cpuinfo(text: str) -> dict[str, Any]:
    """Return the facts of `CPUINFO_FIELDS`, and "vector_bits", of the first core in the file."""
    first = text.split("\n\n", 1)[0]
    pairs = (line.partition(":") for line in first.splitlines())
    fields = {name.strip(): value.strip() for name, _, value in pairs}
    facts: dict[str, Any] = {
        name: next((fields[key] for key in keys if key in fields), None)
        for name, keys in CPUINFO_FIELDS.items()
    }
    flags = (fields.get("flags") or fields.get("Features") or "").split()
    facts["vector_bits"] = next((bits for flag, bits in VECTOR_FLAGS if flag in flags), None)
    return facts


def _read_caches(folder: Path) -> Iterator[tuple[str, int]]:
    """Yield the name (e.g. L1d) and bytes of each cache of a core, from its folder in /sys."""
    for index in sorted(folder.glob("index*")):
        level, kind, size = (_read_text(index / name).strip() for name in ("level", "type", "size"))
        letter = {"Data": "d", "Instruction": "i"}.get(kind, "")
        if size.endswith("K") and size[:-1].isdigit():
            yield f"L{level}{letter}", int(size[:-1]) * 1024


def _format_label(facts: Mapping[str, Any]) -> str:
    numbers = "/".join(str(facts[name]) for name in ("family", "model") if facts[name])
    text = " ".join(part for part in (facts["name"] or facts["vendor"], numbers) if part)
    bits = f"{facts['vector_bits']}-bit" if facts["vector_bits"] else ""
    return ", ".join(part for part in (text, bits) if part) or "unknown processor"


def _read_text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError:
        return ""
