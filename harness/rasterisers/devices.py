"""The devices that OpenGL (through EGL) and WebGPU can run on, and the environment each needs.

Mesa reads its settings once, when it is loaded, so each kind of device is probed in a process of
its own, all of them at once.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from harness.rasterisers import probing
from harness.rasterisers.base import Device
from triangulators.devices import is_software, matches

PROBE = Path(__file__).with_name("probe.py")
INSTALL = "apt-get install -y libegl1 libgl1 libgl1-mesa-dri"
INSTALL_VULKAN = "apt-get install -y libvulkan1 mesa-vulkan-drivers"

SOFTWARE = {"LIBGL_ALWAYS_SOFTWARE": "1", "LP_NUM_THREADS": "0"}
LLVMPIPE = {**SOFTWARE, "GALLIUM_DRIVER": "llvmpipe"}
"""What makes Mesa draw on the CPU, in the thread that asks for it."""

LAVAPIPE = (
    "/usr/local/share/vulkan/icd.d/lvp_icd*.json",
    "/etc/vulkan/icd.d/lvp_icd*.json",
    "/usr/share/vulkan/icd.d/lvp_icd*.json",
)
SWIFTSHADER = (
    "/usr/lib/chromium/vk_swiftshader_icd.json",
    "/usr/lib/chromium-browser/vk_swiftshader_icd.json",
    "/opt/google/chrome/vk_swiftshader_icd.json",
)
"""Where files may be that tell Vulkan's loader of a driver; Chromium brings SwiftShader along."""

BACKENDS = {"darwin": ("Metal",), "win32": ("DX12", "Vulkan")}
LINUX = ("Vulkan", "GL")
"""What WebGPU stands on, by system, best first: what browsers choose there."""

REPORTED = {"DX12": "D3D12", "GL": "OpenGL"}
"""How an adapter calls what is asked for by another name."""

ADAPTERS = {
    ("llvmpipe", "Vulkan"): "lavapipe",
    ("llvmpipe", "OpenGL"): "llvmpipe",
    ("swiftshader", "Vulkan"): "swiftshader",
    ("basic render", "D3D12"): "warp",
}
"""Names of rasterisers that run on a CPU, by a word of their adapter's name and its backend."""

Found = tuple[tuple[Device, ...], tuple[str, ...]]
"""Devices, best first, and what went wrong with others."""

Told = Sequence[Mapping[str, Any]]
"""What a probe tells of each device that it found."""


class Kind(NamedTuple):
    """A kind of device to look for; of a name the first that is found counts.

    asked : the probe's arguments
    wanted : which of the devices that the probe found are of this kind
    software : whether such a device draws on a CPU
    """

    name: str
    environment: Mapping[str, str]
    asked: tuple[str, str]
    wanted: Callable[[Told], Told]
    software: Callable[[Mapping[str, Any]], bool]


def vulkan_environment(places: Sequence[str]) -> dict[str, str] | None:
    """Return what makes Vulkan's loader see one driver alone, None where it is not installed.

    places : patterns of files that tell of it; the first that is there counts
    """
    found = (icd for place in places for icd in sorted(Path("/").glob(place.lstrip("/"))))
    icd = next(found, None)
    if icd is None:
        return None
    # Newer Vulkan loaders read VK_DRIVER_FILES, older ones VK_ICD_FILENAMES.
    return {"VK_ICD_FILENAMES": str(icd), "VK_DRIVER_FILES": str(icd), "LP_NUM_THREADS": "0"}


def egl_kind(name: str, environment: Mapping[str, str]) -> Kind:
    """Return a kind of device that OpenGL runs on through EGL."""

    def wanted(told: Told) -> Told:
        return [each for each in told if matches(name, each["renderer"])]

    asked = ("egl", "hardware" if name == "gpu" else "software")
    return Kind(name, environment, asked, wanted, lambda told: is_software(told["renderer"]))


def _egl_kinds() -> Iterator[Kind]:
    yield egl_kind("gpu", {})
    yield egl_kind("llvmpipe", LLVMPIPE)
    yield egl_kind("softpipe", {**SOFTWARE, "GALLIUM_DRIVER": "softpipe"})
    if vulkan := vulkan_environment(LAVAPIPE):
        yield egl_kind("zink", {**SOFTWARE, "GALLIUM_DRIVER": "zink", **vulkan})
        # Mesa versions differ in which of the two they heed.
        yield egl_kind("zink", {"MESA_LOADER_DRIVER_OVERRIDE": "zink", **vulkan})


def _webgpu_kind(name: str, backends: Sequence[str], environment: Mapping[str, str]) -> Kind:
    def wanted(told: Told) -> Told:
        if name != "gpu":
            return [each for each in told if software_adapter(each) == name][:1]
        # A GPU is there once for each backend: the best backend that has any counts.
        for backend in (REPORTED.get(each, each) for each in backends):
            of = [each for each in told if each["backend_type"] == backend]
            if gpus := [each for each in of if software_adapter(each) is None]:
                return gpus
        return []

    asked = ("webgpu", ",".join(backends))
    return Kind(name, environment, asked, wanted, lambda told: bool(software_adapter(told)))


def _webgpu_kinds() -> Iterator[Kind]:
    yield _webgpu_kind("gpu", BACKENDS.get(sys.platform, LINUX), {})
    if sys.platform == "win32":
        yield _webgpu_kind("warp", ("DX12",), {})
    if sys.platform == "linux":
        if vulkan := vulkan_environment(LAVAPIPE):
            yield _webgpu_kind("lavapipe", ("Vulkan",), vulkan)
        yield _webgpu_kind("llvmpipe", ("GL",), LLVMPIPE)
        if vulkan := vulkan_environment(SWIFTSHADER):
            yield _webgpu_kind("swiftshader", ("Vulkan",), vulkan)


def software_adapter(adapter: Mapping[str, str]) -> str | None:
    """Return the name of a rasteriser that runs on a CPU, None for a GPU.

    adapter : what WebGPU tells of it, `device` and `backend_type` above all
    """
    for (word, backend), name in ADAPTERS.items():
        if word in adapter["device"].lower() and adapter["backend_type"] == backend:
            return name
    software = adapter["adapter_type"] == "CPU" or is_software(adapter["device"])
    return "cpu" if software else None


@cache
def of_egl() -> Found:
    """Find the devices that open through EGL."""
    return _found(list(_egl_kinds()))


@cache
def of_webgpu() -> Found:
    """Find WebGPU's adapters."""
    return _found(list(_webgpu_kinds()))


def egl_listing() -> dict[str, Any]:
    """List EGL's own devices without opening any: {"devices": [...], "problems": [...]}."""
    return probing.ask([probing.Question(PROBE, ("egl", "list"), {})])[0]


def _found(kinds: Sequence[Kind]) -> Found:
    answers = probing.ask([probing.Question(PROBE, kind.asked, kind.environment) for kind in kinds])
    devices: list[Device] = []
    problems: list[str] = []
    for kind, answer in zip(kinds, answers, strict=True):
        if any(device.name == kind.name for device in devices):
            continue
        wanted = kind.wanted(answer["devices"])
        problems.extend(f"{kind.name}: {problem}" for problem in answer["problems"])
        problems.extend(
            f"{kind.name}: EGL opened '{told['renderer']}' instead"
            for told in answer["devices"]
            if kind.asked[0] == "egl" and kind.name != "gpu" and told not in wanted
        )
        for number, told in enumerate(wanted):
            name = f"gpu{number}" if kind.name == "gpu" else kind.name
            details = {key: value for key, value in told.items() if key != "software"}
            devices.append(Device(name, kind.software(told), kind.environment, details))
    return tuple(devices), tuple(problems)
