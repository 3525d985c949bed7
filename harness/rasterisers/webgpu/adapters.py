"""The devices WebGPU can run on, its adapters, and the environment each of them needs."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

from harness.rasterisers import probing
from harness.rasterisers.base import Device
from harness.rasterisers.opengl import egl

PROBE = Path(__file__).with_name("webgpu_probe.py")

BACKENDS = {"darwin": ("Metal",), "win32": ("DX12", "Vulkan")}
LINUX = ("Vulkan", "GL")
"""What WebGPU stands on, by system, best first: what browsers choose there."""

REPORTED = {"DX12": "D3D12", "GL": "OpenGL"}
"""How an adapter calls what is asked for by another name."""

SOFTWARE = {
    ("llvmpipe", "Vulkan"): "lavapipe",
    ("llvmpipe", "OpenGL"): "llvmpipe",
    ("swiftshader", "Vulkan"): "swiftshader",
    ("basic render", "D3D12"): "warp",
}
"""Names of rasterisers that run on a CPU, by a word of their adapter's name and its backend."""


def recipes() -> list[tuple[str, tuple[str, ...], dict[str, str]]]:
    """Return where to look: a kind of device, the backends it may have, its environment."""
    found: list[tuple[str, tuple[str, ...], dict[str, str]]] = [
        ("gpu", BACKENDS.get(sys.platform, LINUX), {})
    ]
    if sys.platform == "win32":
        found.append(("warp", ("DX12",), {}))
    if sys.platform == "linux":
        if vulkan := egl.vulkan_environment(egl.LAVAPIPE):
            found.append(("lavapipe", ("Vulkan",), vulkan))
        found.append(("llvmpipe", ("GL",), egl.LLVMPIPE))
        if vulkan := egl.vulkan_environment(egl.SWIFTSHADER):
            found.append(("swiftshader", ("Vulkan",), vulkan))
    return found


def software(adapter: Mapping[str, str]) -> str | None:
    """Return the name of a rasteriser that runs on a CPU, None for a GPU.

    adapter : what WebGPU tells of it, `device` and `backend_type` above all
    """
    for (word, backend), name in SOFTWARE.items():
        if word in adapter["device"].lower() and adapter["backend_type"] == backend:
            return name
    if adapter["adapter_type"] == "CPU" or egl.is_software(adapter["device"]):
        return "cpu"
    return None


@cache
def probe() -> tuple[tuple[Device, ...], tuple[str, ...]]:
    """Find the adapters that there are, GPUs first, and what went wrong with others."""
    looked_for = recipes()
    answers = probing.ask(
        [
            probing.Question(PROBE, ",".join(backends), environment)
            for _, backends, environment in looked_for
        ]
    )
    devices: list[Device] = []
    problems: list[str] = []
    for (kind, backends, environment), result in zip(looked_for, answers, strict=True):
        problems.extend(f"{kind}: {problem}" for problem in result["problems"])
        found = result["devices"]
        wanted = _gpus(found, backends) if kind == "gpu" else _called(kind, found)
        for number, adapter in enumerate(wanted):
            name = f"gpu{number}" if kind == "gpu" else kind
            devices.append(Device(name, software(adapter) is not None, environment, adapter))
    return tuple(devices), tuple(problems)


def _gpus(
    found: Sequence[Mapping[str, str]], backends: Sequence[str]
) -> Sequence[Mapping[str, str]]:
    """Return the GPUs, each once: those of the best backend that has any."""
    for backend in backends:
        reported = REPORTED.get(backend, backend)
        gpus = [
            each for each in found if each["backend_type"] == reported and software(each) is None
        ]
        if gpus:
            return gpus
    return []


def _called(name: str, found: Sequence[Mapping[str, str]]) -> Sequence[Mapping[str, str]]:
    return [adapter for adapter in found if software(adapter) == name][:1]
