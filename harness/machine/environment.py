"""The machine and software a run was measured with, and what about them makes times shaky.

To a software rasteriser the processor is the device. Virtual machines mask its name ("AMD EPYC"),
so family, model and stepping are taken along, with the caches, and the width of its vectors, on
which the code depends that llvmpipe generates.
"""

import hashlib
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import psutil

from harness import __version__
from harness.machine.git import describe_project, git_state

ROOT = Path(__file__).resolve().parent.parent.parent

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


def collect(seed: int, triangulators: Sequence[str] = ()) -> dict[str, Any]:
    """Return the facts about this machine, JSON-ready; what cannot be read is None.

    triangulators : as named; the folders of their modules show whose repository is measured
    """
    memory = psutil.virtual_memory()
    return {
        "harness": __version__,
        "code": code_version(),
        "git": git_state(ROOT) if (ROOT / ".git").exists() else None,
        "project": describe_project(triangulators),
        "command": ["harness", *sys.argv[1:]],
        "seed": seed,
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in PACKAGES},
        "kernel": f"{platform.system()} {platform.release()}",
        "cpu": processor()["name"],
        "cores": psutil.cpu_count(logical=False),
        "threads": psutil.cpu_count(),
        "governor": _read(GOVERNOR).strip() or None,
        "load": list(psutil.getloadavg()),
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
    return source_hash(*(ROOT / package for package in ("harness", "scenes", "triangulators")))


def source_hash(*packages: Path) -> str:
    """Return 16 hexadecimal digits that change with any source file of the packages' folders."""
    digest = hashlib.sha256()
    for folder in packages:
        files = (Path(place, name) for place, _, names in os.walk(folder) for name in names)
        for file in sorted(file for file in files if file.suffix in (".py", ".glsl")):
            digest.update(str(file.relative_to(folder.parent)).encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


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


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


CPUINFO = Path("/proc/cpuinfo")
GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
CACHES = Path("/sys/devices/system/cpu/cpu0/cache")

FIELDS = {
    "vendor": ("vendor_id", "CPU implementer"),
    "name": ("model name",),
    "family": ("cpu family", "CPU architecture"),
    "model": ("model", "CPU part"),
    "stepping": ("stepping", "CPU revision"),
}
"""Each fact by what x86 and ARM call it."""

VECTORS = (("avx512f", 512), ("avx2", 256), ("avx", 256), ("sse2", 128), ("asimd", 128))
"""Flags with the bits of a register, the widest first."""


@cache
def processor() -> dict[str, Any]:
    """Return the facts about this machine's processor, JSON-ready; what is not told is None.

    vendor, name, family, model, stepping : as the system tells them
    caches : bytes by level and type, e.g. "L2"; vector_bits : of its widest vectors
    label : all of it in short, e.g. AMD EPYC 25/17, 512-bit
    """
    facts = _of_cpuinfo(_read(CPUINFO)) | {"caches": dict(_caches(CACHES))}
    facts["name"] = facts["name"] or platform.processor() or None
    return {**facts, "label": _label(facts)}


def _of_cpuinfo(text: str) -> dict[str, Any]:
    first = text.split("\n\n", 1)[0]
    pairs = (line.partition(":") for line in first.splitlines())
    told = {name.strip(): value.strip() for name, _, value in pairs}
    facts: dict[str, Any] = {
        name: next((told[key] for key in keys if key in told), None)
        for name, keys in FIELDS.items()
    }
    flags = (told.get("flags") or told.get("Features") or "").split()
    facts["vector_bits"] = next((bits for flag, bits in VECTORS if flag in flags), None)
    return facts


def _caches(folder: Path) -> Iterator[tuple[str, int]]:
    for place in sorted(folder.glob("index*")):
        level, kind, size = (_read(place / name).strip() for name in ("level", "type", "size"))
        letter = {"Data": "d", "Instruction": "i"}.get(kind, "")
        if size.endswith("K") and size[:-1].isdigit():
            yield f"L{level}{letter}", int(size[:-1]) * 1024


def _label(facts: Mapping[str, Any]) -> str:
    numbers = "/".join(str(facts[name]) for name in ("family", "model") if facts[name])
    words = " ".join(part for part in (facts["name"] or facts["vendor"], numbers) if part)
    bits = f"{facts['vector_bits']}-bit" if facts["vector_bits"] else ""
    return ", ".join(part for part in (words, bits) if part) or "unknown processor"


def label_of(facts: Mapping[str, Any]) -> str:
    """Return the processor of a run, of its `run.json`; "" where it does not say.

    Runs from before processors were described tell the name alone.
    """
    told, environment = (facts.get(name) for name in ("cpu", "environment"))
    label = told.get("label") if isinstance(told, Mapping) else None
    return str(label or (environment.get("cpu") if isinstance(environment, Mapping) else "") or "")


def same(one: str, other: str) -> bool:
    """Whether two labels may be of one processor: where one tells less, it tells nothing else."""
    return not one or not other or one.startswith(other) or other.startswith(one)


def differ(labels: Iterable[str]) -> list[str]:
    """Return the labels that are of different processors; [] where all may be of one."""
    kinds: list[str] = []
    for label in sorted(set(labels), key=len, reverse=True):
        if not any(same(label, kind) for kind in kinds):
            kinds.append(label)
    return sorted(kinds) if len(kinds) > 1 else []


def _read(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8")
    except OSError:
        return ""
