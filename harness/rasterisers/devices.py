"""Devices available to OpenGL (through EGL) and to WebGPU, and the environment each needs.

Mesa reads its settings once, when loaded, so each kind of device is probed in a separate process;
all probes run at once. As probes take seconds, their answers are cached until drivers, device nodes
or the environment variables that drivers read change.
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
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from harness import atomic
from harness.machine import system
from harness.rasterisers.base import Device
from triangulators.gpu import is_software, selects_renderer

PROBE = Path(__file__).with_name("probe.py")
INSTALL = "apt-get install -y libegl1 libgl1 libgl1-mesa-dri"
INSTALL_VULKAN = "apt-get install -y libvulkan1 mesa-vulkan-drivers"

SOFTWARE = {"LIBGL_ALWAYS_SOFTWARE": "1", "LP_NUM_THREADS": "0"}
LLVMPIPE = {**SOFTWARE, "GALLIUM_DRIVER": "llvmpipe"}  # Mesa on the CPU, in the calling thread

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
"""Patterns of manifests, by which Vulkan's loader finds a driver; Chromium includes SwiftShader."""

BACKENDS = {"darwin": ("Metal",), "win32": ("DX12", "Vulkan")}
LINUX_BACKENDS = ("Vulkan", "GL")  # of WebGPU, in order of preference, as in browsers

REPORTED_BACKENDS = {"DX12": "D3D12", "GL": "OpenGL"}  # names that adapters report

# Device names of CPU rasterisers, by (word in the adapter's name, backend).
SOFTWARE_ADAPTERS = {
    ("llvmpipe", "Vulkan"): "lavapipe",
    ("llvmpipe", "OpenGL"): "llvmpipe",
    ("swiftshader", "Vulkan"): "swiftshader",
    ("basic render", "D3D12"): "warp",
}

Devices = tuple[tuple[Device, ...], tuple[str, ...]]
"""Devices in order of preference, and the problems of unavailable devices."""

Reports = Sequence[Mapping[str, Any]]  # properties of each device that a probe has found


class DeviceKind(NamedTuple):
    """A kind of device to probe for; of kinds with the same name, the first available is used."""

    name: str
    environment: Mapping[str, str]
    arguments: tuple[str, str]


def find_vulkan_environment(patterns: Sequence[str]) -> dict[str, str] | None:
    """Return variables that restrict Vulkan to the first driver of the `patterns`, or None."""
    manifests = (sorted(Path("/").glob(pattern.lstrip("/"))) for pattern in patterns)
    icd = next(chain.from_iterable(manifests), None)
    if icd is None:
        return None
    # Newer Vulkan loaders read VK_DRIVER_FILES, older loaders VK_ICD_FILENAMES.
    return {"VK_ICD_FILENAMES": str(icd), "VK_DRIVER_FILES": str(icd), "LP_NUM_THREADS": "0"}


def _filter_reports(kind: DeviceKind, reports: Reports) -> Reports:
    if kind.arguments[0] == "egl":
        return [report for report in reports if selects_renderer(kind.name, report["renderer"])]
    if kind.name != "gpu":
        return [report for report in reports if identify_software_adapter(report) == kind.name][:1]
    # A GPU is listed once per backend; the best backend that lists a GPU is used.
    gpus = [report for report in reports if identify_software_adapter(report) is None]
    for backend in (REPORTED_BACKENDS.get(name, name) for name in kind.arguments[1].split(",")):
        if matching := [report for report in gpus if report["backend_type"] == backend]:
            return matching
    return []


def _list_egl_kinds() -> Iterator[DeviceKind]:
    software = ("egl", "software")
    yield DeviceKind("gpu", {}, ("egl", "hardware"))
    yield DeviceKind("llvmpipe", LLVMPIPE, software)
    yield DeviceKind("softpipe", {**SOFTWARE, "GALLIUM_DRIVER": "softpipe"}, software)
    if vulkan := find_vulkan_environment(LAVAPIPE):
        yield DeviceKind("zink", {**SOFTWARE, "GALLIUM_DRIVER": "zink", **vulkan}, software)
        # Some Mesa versions read only GALLIUM_DRIVER, some only MESA_LOADER_DRIVER_OVERRIDE.
        yield DeviceKind("zink", {"MESA_LOADER_DRIVER_OVERRIDE": "zink", **vulkan}, software)


def _list_webgpu_kinds() -> Iterator[DeviceKind]:
    yield DeviceKind("gpu", {}, ("webgpu", ",".join(BACKENDS.get(sys.platform, LINUX_BACKENDS))))
    if sys.platform == "win32":
        yield DeviceKind("warp", {}, ("webgpu", "DX12"))
    if sys.platform == "linux":
        if vulkan := find_vulkan_environment(LAVAPIPE):
            yield DeviceKind("lavapipe", vulkan, ("webgpu", "Vulkan"))
        yield DeviceKind("llvmpipe", LLVMPIPE, ("webgpu", "GL"))
        if vulkan := find_vulkan_environment(SWIFTSHADER):
            yield DeviceKind("swiftshader", vulkan, ("webgpu", "Vulkan"))


def identify_software_adapter(adapter: Mapping[str, str]) -> str | None:
    """Return the device name of an adapter that is a CPU rasteriser, or None for a GPU."""
    for (word, backend), name in SOFTWARE_ADAPTERS.items():
        if word in adapter["device"].lower() and adapter["backend_type"] == backend:
            return name
    software = adapter["adapter_type"] == "CPU" or is_software(adapter["device"])
    return "cpu" if software else None


@cache
def list_egl_devices() -> Devices:
    """Return the devices that EGL opens, and the problems of unavailable devices."""
    return _list_devices(list(_list_egl_kinds()))


@cache
def list_webgpu_devices() -> Devices:
    """Return the adapters of WebGPU as devices, and the problems of unavailable devices."""
    return _list_devices(list(_list_webgpu_kinds()))


def _list_devices(kinds: Sequence[DeviceKind]) -> Devices:
    answers = run_probes([(kind.arguments, kind.environment) for kind in kinds])
    devices: list[Device] = []
    problems: list[str] = []
    for kind, answer in zip(kinds, answers, strict=True):
        if any(device.name == kind.name for device in devices):
            continue
        is_egl = kind.arguments[0] == "egl"
        reports = _filter_reports(kind, answer["devices"])
        problems.extend(f"{kind.name}: {problem}" for problem in answer["problems"])
        problems.extend(
            f"{kind.name}: EGL opened '{report['renderer']}' instead"
            for report in answer["devices"]
            if is_egl and kind.name != "gpu" and report not in reports
        )
        for number, report in enumerate(reports):
            name = f"gpu{number}" if kind.name == "gpu" else kind.name
            details = {key: value for key, value in report.items() if key != "software"}
            devices.append(Device(name, kind.name != "gpu", kind.environment, details))
    return tuple(devices), tuple(problems)


PROBE_TIMEOUT_S = 20.0

# Paths, with wildcards and without "/", that change when drivers or devices are (un)installed.
DRIVER_PATHS = (
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

DRIVER_VARIABLES = re.compile(  # names of variables that drivers and loaders read
    r"(LD|LIBGL|MESA|GALLIUM|EGL|__EGL|__GLX|__NV|NVIDIA|CUDA|VK|LP|ZINK|WGPU|WAYLAND)_|DISPLAY$|"
    r"PYTHONPATH$"
)

ROOT = Path("/")

CACHE_FOLDER, MAX_CACHED_ANSWERS = "drivers", 64  # a file per answer, enough for ten environments

Probe = tuple[tuple[str, str], Mapping[str, str]]
"""Arguments of `probe.py`, and environment variables in addition to those of this process."""


def run_probes(probes: Sequence[Probe]) -> list[dict[str, Any]]:
    """Return each probe's answer, {"devices": [...], "problems": [...]}; new probes run at once."""
    files = [
        system.get_cache_file(CACHE_FOLDER) / f"{_hash_inputs(*probe)}.json" for probe in probes
    ]
    cached = [_read_answer(file) for file in files]
    running = [
        subprocess.Popen(
            [sys.executable, "-P", str(PROBE), *arguments],
            env={**os.environ, **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for (arguments, environment), answer in zip(probes, cached, strict=True)
        if answer is None
    ]
    started = iter(running)
    return [
        answer or _wait_for_answer(next(started), file)
        for file, answer in zip(files, cached, strict=True)
    ]


def clear_cache() -> None:
    """Delete all cached answers."""
    shutil.rmtree(system.get_cache_file(CACHE_FOLDER), ignore_errors=True)


def _read_answer(file: Path) -> dict[str, Any] | None:
    try:
        return json.loads(file.read_text()) or None
    except (OSError, ValueError):
        return None


def _hash_inputs(arguments: tuple[str, str], environment: Mapping[str, str]) -> str:
    paths = [path for pattern in DRIVER_PATHS for path in sorted(ROOT.glob(pattern))]
    paths.append(Path(sysconfig.get_path("platlib")))
    content = (
        PROBE.read_text(),
        arguments,
        sorted(environment.items()),
        sys.prefix,
        sorted(item for item in os.environ.items() if DRIVER_VARIABLES.match(item[0])),
        [(str(path), path.stat().st_mtime_ns) for path in paths if path.exists()],
    )
    return hashlib.sha256(repr(content).encode()).hexdigest()[:24]


def _wait_for_answer(process: subprocess.Popen[str], file: Path) -> dict[str, Any]:
    try:
        out, errors = process.communicate(timeout=PROBE_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return {"devices": [], "problems": [f"no answer within {PROBE_TIMEOUT_S:.0f} s"]}
    if process.returncode:
        last = errors.strip().splitlines()[-1:] or [f"exit code {process.returncode}"]
        return {"devices": [], "problems": [f"the driver failed: {last[0]}"]}
    answer = out.splitlines()[-1]
    if sys.platform == "linux":
        with suppress(OSError):
            file.parent.mkdir(parents=True, exist_ok=True)
            atomic.write(file, answer.encode())
            for old in sorted(file.parent.iterdir(), key=os.path.getmtime)[:-MAX_CACHED_ANSWERS]:
                old.unlink()
    result: dict[str, Any] = json.loads(answer)
    return result
