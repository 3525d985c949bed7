"""Which processor this is: to a software rasteriser it is the device.

Virtual machines mask the name ("AMD EPYC"), so family, model and stepping are taken along, with the
caches, and the width of its vectors, on which the code depends that llvmpipe generates.
"""

from __future__ import annotations

import platform
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

CPUINFO = Path("/proc/cpuinfo")
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
