"""`harness doctor`: examine this machine's devices, each in a worker process."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from harness.errors import HarnessError, NoRasteriserError

if TYPE_CHECKING:
    from harness.rasterisers.base import Device

STATUS_COLOURS = {"ok": "green", "warning": "yellow", "missing": "red"}

EXAMINED = {  # devices by rasteriser, also if not found; GPUs that are found are added
    "opengl": ("gpu0", "llvmpipe", "softpipe", "zink"),
    "bounding-box": ("llvmpipe",),
    "webgpu": ("gpu0", "lavapipe", "llvmpipe", "swiftshader"),
    "osmesa": ("osmesa",),
    "pyrender": ("llvmpipe",),
}

REQUIRED = ("opengl", "llvmpipe")  # "missing" if absent; other absent devices: "warning"
TIMEOUT_S = 120.0

HIDING_VARIABLES = (  # restrict the loaders of OpenGL and Vulkan to some drivers
    "LIBGL_DRIVERS_PATH",
    "__EGL_VENDOR_LIBRARY_DIRS",
    "__EGL_VENDOR_LIBRARY_FILENAMES",
    "VK_DRIVER_FILES",
    "VK_ICD_FILENAMES",
)

# Exists if NVIDIA's kernel driver is loaded, even in a container without its OpenGL libraries.
NVIDIA_NODE = Path("/dev/nvidiactl")

NVIDIA_REMEDY = (
    "NVIDIA's kernel driver is loaded: in a container set NVIDIA_DRIVER_CAPABILITIES=graphics (or "
    "all), and check that /usr/share/glvnd/egl_vendor.d/10_nvidia.json exists"
)

Status = Literal["ok", "warning", "missing"]


class Finding(NamedTuple):
    """Result of the examination of a device; `fix` is a remedy, or "" if none is needed."""

    name: str  # rasteriser and device, e.g. "opengl on llvmpipe"
    status: Status
    detail: str
    fix: str = ""


def doctor() -> None:
    """Check devices, drivers, extensions and timers; print a remedy for each problem."""
    from rich.text import Text  # the workers, which import this module, do not need it

    from harness import rasterisers
    from harness.progress import Screen
    from harness.rasterisers import devices

    devices.clear_cache()
    console = Screen(highlight=False)
    findings = examine_devices()
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        line = Text(f"{finding.status:<8}", style=STATUS_COLOURS[finding.status])
        line.append(f"{finding.name:<{width}}  {finding.detail}", style="default")
        console.print(line, soft_wrap=True)
        if finding.fix:
            console.print(f"{'':<8}{'':<{width}}  -> {finding.fix}", markup=False, soft_wrap=True)
    if not any(rasterisers.get(name).devices() for name in ("opengl", "webgpu")):
        raise NoRasteriserError("no OpenGL or WebGPU device works here; see the remedies above")


def examine_devices() -> list[Finding]:
    """Examine all devices, which takes some seconds; a missing device raises no error."""
    from harness import rasterisers

    findings: list[Finding] = []
    for rasteriser, expected in EXAMINED.items():
        present = (device.name for device in rasterisers.get(rasteriser).devices())
        gpus = (name for name in present if name.startswith("gpu"))
        names = dict.fromkeys((*expected, *gpus))
        findings += [examine_device(rasteriser, name) for name in names]
    return findings


def examine_device(rasteriser: str, name: str) -> Finding:
    """Open and test a device; return its status, with a remedy if needed."""
    from harness import rasterisers
    from harness.rasterisers import devices
    from harness.worker import Worker

    title = f"{rasteriser} on {name}"
    kind = rasterisers.get(rasteriser)
    absent: Status = "missing" if (rasteriser, name) == REQUIRED else "warning"
    device = kind.find(name)
    if device is None:
        probes = {"opengl": devices.list_egl_devices, "webgpu": devices.list_webgpu_devices}
        reports = probes[rasteriser]()[1] if rasteriser in probes else ()
        problems = [problem for problem in reports if problem.startswith(name.rstrip("0"))]
        return Finding(title, absent, "; ".join(problems) or "not found", _find_remedy(kind, name))
    try:
        with Worker(title, device.environment) as worker:
            detail, differs = worker.call(_try_device, rasteriser, device, timeout_s=TIMEOUT_S)
    except HarnessError as error:
        return Finding(title, absent, str(error), _find_remedy(kind, name))
    if differs:
        detail += f"; differs from the reference: {differs[0]}"
        fix = "none: the driver rounds edges differently; compare its counts only with each other"
        return Finding(title, "warning", detail, fix)
    agrees = "counts equal the reference's" if kind.counters else "draws, but cannot count"
    return Finding(title, "ok", f"{detail}; {agrees}")


def _find_remedy(kind: Any, name: str) -> str:
    remedy = str(kind.remedy(name))
    if name.startswith("gpu") and NVIDIA_NODE.exists():
        remedy = NVIDIA_REMEDY
    if hiding := [variable for variable in HIDING_VARIABLES if os.environ.get(variable)]:
        return f"unset {', '.join(hiding)}, which may hide an installed driver; otherwise {remedy}"
    return remedy


def _try_device(rasteriser: str, device: Device) -> tuple[str, list[str]]:
    """Test a device in the worker process; return driver and timer, and differing counts."""
    import numpy as np

    from harness import rasterisers
    from harness.frame import make_bare_frame
    from harness.grid import SUBPIXEL
    from harness.measuring.tasks import select_device_timer
    from harness.rasterisers.base import Options
    from harness.rasterisers.reference import Reference, find_disagreements

    opened = rasterisers.get(rasteriser)(device)
    half = SUBPIXEL // 2  # many edges pass through pixel centres
    corners = np.random.default_rng(0).integers(2, 254, (300, 2), np.int32) * half
    frame, rows = make_bare_frame(128, corners, 3), np.arange(300, dtype=np.int32).reshape(-1, 3)
    drawn = opened.draw_and_count(frame, rows, Options())
    if "hits" in drawn:
        drawn["fragments"] = drawn["hits"]
    differs = find_disagreements(frame, drawn, Reference().draw_and_count(frame, rows, Options()))
    details = opened.device.details
    detail = f"{details['renderer']}, {details.get('version', '')}".rstrip(", ")
    timer = select_device_timer(opened)
    return f"{detail}; timer: {timer.timer}, as {timer.reason}", differs
