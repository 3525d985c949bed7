"""The devices OpenGL can run on through EGL, and the environment each of them needs.

Mesa reads its settings once, when it is loaded, so each kind of device is probed in a process of
its own; all of them at once, which takes about half a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

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


def recipes() -> list[tuple[str, dict[str, str]]]:
    """Return each kind of device to look for with its environment; of a kind the first counts."""
    found: list[tuple[str, dict[str, str]]] = [
        ("gpu", {}),
        ("llvmpipe", LLVMPIPE),
        ("softpipe", {**SOFTWARE, "GALLIUM_DRIVER": "softpipe"}),
    ]
    if vulkan := vulkan_environment(LAVAPIPE):
        found.append(("zink", {**SOFTWARE, "GALLIUM_DRIVER": "zink", **vulkan}))
        # Mesa versions differ in which of the two they heed.
        found.append(("zink", {"MESA_LOADER_DRIVER_OVERRIDE": "zink", **vulkan}))
    return found


@cache
def probe() -> tuple[tuple[Device, ...], tuple[str, ...]]:
    """Find the devices that open, best first, and what went wrong with the others."""
    looked_for = recipes()
    answers = probing.ask([_question(kind, environment) for kind, environment in looked_for])
    devices: list[Device] = []
    problems: list[str] = []
    for (kind, environment), result in zip(looked_for, answers, strict=True):
        if any(device.name == kind for device in devices):
            continue
        wanted = [found for found in result["devices"] if matches(kind, found["renderer"])]
        problems.extend(f"{kind}: {problem}" for problem in result["problems"])
        problems.extend(
            f"{kind}: EGL opened '{found['renderer']}' instead"
            for found in result["devices"]
            if found not in wanted and kind != "gpu"
        )
        for number, found in enumerate(wanted):
            devices.append(
                Device(
                    name=f"gpu{number}" if kind == "gpu" else kind,
                    software=is_software(found["renderer"]),
                    environment=environment,
                    details={key: value for key, value in found.items() if key != "software"},
                )
            )
    return tuple(devices), tuple(problems)


def listing() -> dict[str, Any]:
    """List EGL's own devices without opening any: {"devices": [...], "problems": [...]}."""
    return probing.ask([_question("list", {})])[0]


def _question(kind: str, environment: dict[str, str]) -> probing.Question:
    mode = {"gpu": "hardware", "list": "list"}.get(kind, "software")
    return probing.Question(PROBE, mode, environment)
