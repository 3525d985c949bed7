"""The devices that OpenGL (through EGL) and WebGPU can run on, and the environment each needs.

Mesa reads its settings once, when it is loaded, so each kind of device is probed in a process of
its own, all of them at once.

All of them take seconds, so what they found is kept in the user's cache folder, and asked again
when drivers, device nodes or the variables that choose between them have changed.
"""

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from harness import atomic
from harness.machine import system
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
    """

    name: str
    environment: Mapping[str, str]
    asked: tuple[str, str]


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


def _wanted(kind: Kind, told: Told) -> Told:
    """Return which of the devices that the probe found are of the kind."""
    if kind.asked[0] == "egl":
        return [each for each in told if matches(kind.name, each["renderer"])]
    if kind.name != "gpu":
        return [each for each in told if software_adapter(each) == kind.name][:1]
    # A GPU is there once for each backend: the best backend that has any counts.
    for backend in (REPORTED.get(each, each) for each in kind.asked[1].split(",")):
        of = [each for each in told if each["backend_type"] == backend]
        if gpus := [each for each in of if software_adapter(each) is None]:
            return gpus
    return []


def _egl_kinds() -> Iterator[Kind]:
    software = ("egl", "software")
    yield Kind("gpu", {}, ("egl", "hardware"))
    yield Kind("llvmpipe", LLVMPIPE, software)
    yield Kind("softpipe", {**SOFTWARE, "GALLIUM_DRIVER": "softpipe"}, software)
    if vulkan := vulkan_environment(LAVAPIPE):
        yield Kind("zink", {**SOFTWARE, "GALLIUM_DRIVER": "zink", **vulkan}, software)
        # Mesa versions differ in which of the two they heed.
        yield Kind("zink", {"MESA_LOADER_DRIVER_OVERRIDE": "zink", **vulkan}, software)


def _webgpu_kinds() -> Iterator[Kind]:
    yield Kind("gpu", {}, ("webgpu", ",".join(BACKENDS.get(sys.platform, LINUX))))
    if sys.platform == "win32":
        yield Kind("warp", {}, ("webgpu", "DX12"))
    if sys.platform == "linux":
        if vulkan := vulkan_environment(LAVAPIPE):
            yield Kind("lavapipe", vulkan, ("webgpu", "Vulkan"))
        yield Kind("llvmpipe", LLVMPIPE, ("webgpu", "GL"))
        if vulkan := vulkan_environment(SWIFTSHADER):
            yield Kind("swiftshader", vulkan, ("webgpu", "Vulkan"))


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


def _found(kinds: Sequence[Kind]) -> Found:
    answers = ask([(kind.asked, kind.environment) for kind in kinds])
    devices: list[Device] = []
    problems: list[str] = []
    for kind, answer in zip(kinds, answers, strict=True):
        if any(device.name == kind.name for device in devices):
            continue
        wanted = _wanted(kind, answer["devices"])
        problems.extend(f"{kind.name}: {problem}" for problem in answer["problems"])
        problems.extend(
            f"{kind.name}: EGL opened '{told['renderer']}' instead"
            for told in answer["devices"]
            if kind.asked[0] == "egl" and kind.name != "gpu" and told not in wanted
        )
        for number, told in enumerate(wanted):
            name = f"gpu{number}" if kind.name == "gpu" else kind.name
            details = {key: value for key, value in told.items() if key != "software"}
            egl = kind.asked[0] == "egl"
            software = is_software(told["renderer"]) if egl else bool(software_adapter(told))
            devices.append(Device(name, software, kind.environment, details))
    return tuple(devices), tuple(problems)


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

KEPT, MOST_KEPT = "drivers", 64
"""Folder of the answers that are kept, in a file each: those of some ten environments."""


Question = tuple[tuple[str, str], Mapping[str, str]]
"""Arguments of the probe, and variables of its environment beside those of this process."""


def ask(questions: Sequence[Question]) -> list[dict[str, Any]]:
    """Return what the probe prints, {"devices": [...], "problems": [...]}, to each question.

    Those whose answer is not kept are asked at once.
    """
    files = [system.cache_file(KEPT) / f"{_key(*question)}.json" for question in questions]
    kept = [_read(file) for file in files]
    running = [
        subprocess.Popen(
            [sys.executable, "-P", str(PROBE), *arguments],
            env={**os.environ, **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for (arguments, environment), answer in zip(questions, kept, strict=True)
        if answer is None
    ]
    fresh = iter(running)
    return [answer or _answer(next(fresh), file) for file, answer in zip(files, kept, strict=True)]


def forget() -> None:
    """Ask everything anew."""
    shutil.rmtree(system.cache_file(KEPT), ignore_errors=True)


def _read(file: Path) -> dict[str, Any] | None:
    try:
        return json.loads(file.read_text()) or None
    except (OSError, ValueError):
        return None


def _key(arguments: tuple[str, str], environment: Mapping[str, str]) -> str:
    """Return a digest of all that an answer depends on."""
    places = [path for pattern in PLACES for path in sorted(ROOT.glob(pattern))]
    places.append(Path(sysconfig.get_path("platlib")))
    about = (
        PROBE.read_text(),
        arguments,
        sorted(environment.items()),
        sys.prefix,
        sorted(item for item in os.environ.items() if VARIABLES.match(item[0])),
        [(str(path), path.stat().st_mtime_ns) for path in places],
    )
    return hashlib.sha256(repr(about).encode()).hexdigest()[:24]


def _answer(process: subprocess.Popen[str], file: Path) -> dict[str, Any]:
    """Wait for what the program prints, and keep it; one that hangs or dies found no device."""
    try:
        out, complaints = process.communicate(timeout=PROBE_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return {"devices": [], "problems": [f"no answer within {PROBE_SECONDS:.0f} s"]}
    if process.returncode:
        last = complaints.strip().splitlines()[-1:] or [f"exit code {process.returncode}"]
        return {"devices": [], "problems": [f"the driver failed: {last[0]}"]}
    told = out.splitlines()[-1]
    if sys.platform == "linux":
        with suppress(OSError):
            file.parent.mkdir(parents=True, exist_ok=True)
            atomic.write(file, told.encode())
            for old in sorted(file.parent.iterdir(), key=os.path.getmtime)[:-MOST_KEPT]:
                old.unlink()
    result: dict[str, Any] = json.loads(told)
    return result
