"""Examines what this machine can rasterise with: each part, its state, its fix if it is missing.

Every device is opened in a process of its own, counted on and timed.
"""

import importlib.util
import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from harness import rasterisers
from harness.errors import HarnessError
from harness.frame import SUBPIXEL, Frame, bare_frame
from harness.measuring.tasks import choose_timer
from harness.measuring.worker import Worker
from harness.rasterisers import Device, Options, Rasteriser, osmesa
from harness.rasterisers import devices as probed
from harness.rasterisers.opengl import GLRasteriser
from harness.rasterisers.reference import Reference, disagreements, predict
from harness.rasterisers.simulated import DESIGNS, design
from harness.rasterisers.simulated.building import INSTALL
from scenes.spec import install

Status = Literal["ok", "warning", "missing"]

VENDOR_FOLDERS = ("/etc/glvnd/egl_vendor.d", "/usr/share/glvnd/egl_vendor.d")
EXTENSIONS = (
    "GL_ARB_shader_storage_buffer_object",
    "GL_ARB_derivative_control",
    "GL_ARB_ES3_1_compatibility",
    "GL_ARB_compute_shader",
    "GL_ARB_gpu_shader_int64",
    "GL_ARB_timer_query",
)
INSTALL_EGL = f"run: {probed.INSTALL}"
OPTIONAL = {"gpu0", "zink", "softpipe", "webgpu"}
TIMEOUT_S = 120.0
TIMED_PX = 512


@dataclass(frozen=True)
class Finding:
    """One part of the machine.

    status : "ok"; "warning", usable with a caveat or not needed; "missing"
    fix : what to do about it, "" where nothing needs doing
    """

    name: str
    status: Status
    detail: str
    fix: str = ""


def examine() -> list[Finding]:
    """Examine everything; takes some seconds. Never raises for what is missing."""
    return [
        *_egl(),
        *(_devices("opengl", kind) for kind in ("gpu", "llvmpipe", "softpipe", "zink")),
        _compute(),
        *(_devices("webgpu", kind) for kind in ("gpu", "lavapipe", "llvmpipe", "swiftshader")),
        _osmesa(),
        _pyrender(),
        _reference(),
        *map(_simulated, DESIGNS),
    ]


def _egl() -> list[Finding]:
    """EGL's devices and the files that tell the loader where the drivers are."""
    files = [file for folder in VENDOR_FOLDERS for file in sorted(Path(folder).glob("*.json"))]
    libraries = [json.loads(file.read_bytes())["ICD"]["library_path"] for file in files]
    named = ", ".join(f"{file} ({name})" for file, name in zip(files, libraries, strict=True))
    found = probed.egl_listing()
    shown = ", ".join(
        f"{device['egl_index']}: {'software' if device['software'] else device['file'] or 'GPU'}"
        for device in found["devices"]
    )
    none = f"none in {' or '.join(VENDOR_FOLDERS)}", "; ".join(found["problems"]) or "none"
    return [
        Finding(name, "ok", there) if there else Finding(name, "missing", lacking, INSTALL_EGL)
        for name, there, lacking in (
            ("EGL vendor files", named, none[0]),
            ("EGL devices", shown, none[1]),
        )
    ]


def _devices(rasteriser: str, kind: str) -> Finding:
    """All devices of a kind; a GPU and the slower software drivers may be missing."""
    name = f"{rasteriser} on {kind}"
    devices = [
        device
        for device in rasterisers.get(rasteriser).devices()
        if device.name == kind or (kind == "gpu" and device.name.startswith("gpu"))
    ]
    if not devices:
        wanted = "gpu0" if kind == "gpu" else kind
        told = (probed.of_egl if rasteriser == "opengl" else probed.of_webgpu)()[1]
        problems = [problem for problem in told if problem.startswith(f"{kind}:")]
        optional = wanted in OPTIONAL or rasteriser in OPTIONAL
        status: Status = "warning" if optional else "missing"
        remedy = rasterisers.get(rasteriser).remedy(wanted)
        return Finding(name, status, "; ".join(problems) or "not found", remedy)
    findings = [_opened(f"{rasteriser} on {device.name}", rasteriser, device) for device in devices]
    if len(findings) == 1:
        return findings[0]
    worst = "ok" if all(finding.status == "ok" for finding in findings) else "warning"
    detail = " | ".join(f"{finding.name}: {finding.detail}" for finding in findings)
    return Finding(name, worst, detail, findings[0].fix)  # type: ignore[arg-type]


def _compute() -> Finding:
    """The compute-shader rasterisers, on the best device."""
    try:
        device = rasterisers.find_device("bounding-box")
    except HarnessError as error:
        return Finding("bounding-box, scanline", "missing", str(error), INSTALL_EGL)
    return _opened(f"bounding-box on {device.name}", "bounding-box", device)


def _osmesa() -> Finding:
    devices = rasterisers.get("osmesa").devices()
    if devices:
        return _opened("osmesa", "osmesa", devices[0])
    return Finding("osmesa", "warning", "not installed", f"run: {osmesa.INSTALL}")


def _pyrender() -> Finding:
    fix = f"run: {install('pyrender')}, or make setup"
    missing = [name for name in ("pyrender", "trimesh") if importlib.util.find_spec(name) is None]
    if missing:
        return Finding("pyrender", "warning", f"not installed: {', '.join(missing)}", fix)
    try:
        device = rasterisers.find_device("pyrender")
        with Worker("pyrender", device.environment) as worker:
            detail = worker.call(_draw_roofs, device, timeout_s=TIMEOUT_S)
    except HarnessError as error:
        return Finding("pyrender", "warning", str(error), fix)
    return Finding("pyrender", "ok", f"{detail}; it draws, but cannot count")


def _reference() -> Finding:
    """How fast the CPU reference fills, in pixels of bounding boxes."""
    frame, triangles = _scattered(TIMED_PX, 2000)
    with Reference().prepare(frame, triangles, Options()) as drawing:
        drawing.sample(1)
        seconds = min(drawing.sample(1).wall for _ in range(5))
    tests = int(predict(frame.points, triangles)["bbox_tests"].sum())
    detail = f"{tests / seconds / 1e6:,.0f} million bounding-box pixels a second, on one core"
    return Finding("reference", "ok", detail)


def _simulated(name: str) -> Finding:
    """A published design: what it is built with, and whether it counts as the reference does."""
    title = f"simulated on {name}"
    if problem := design(name).problem():
        return Finding(title, "warning", *problem)
    frame, triangles = _scattered(128, 100, grid=SUBPIXEL // 2)
    try:
        opened = rasterisers.get("simulated")(Device(name, software=True))
        drawn = opened.count(frame, triangles, Options())
    except HarnessError as error:
        return Finding(title, "warning", str(error), f"run {INSTALL}")
    expected = Reference().count(frame, triangles, Options())
    detail = f"{opened.device.details['version']}; its time is a count of cycles"
    if found := disagreements(frame, drawn, expected):
        return Finding(title, "warning", f"{detail}; differs from the reference: {found[0]}")
    return Finding(title, "ok", f"{detail}; counts equal the reference's")


def _opened(name: str, rasteriser: str, device: Device) -> Finding:
    """Open a device in a worker and report what was found there."""
    try:
        with Worker(name, device.environment) as worker:
            found = worker.call(_try_device, rasteriser, device, timeout_s=TIMEOUT_S)
    except HarnessError as error:
        return Finding(name, "missing", str(error), rasterisers.get(rasteriser).remedy(device.name))
    told = [f"timer: {found['timer']}", *found["traps"]]
    detail = "; ".join([f"{found['renderer']}, {found['version']}", *told])
    if found["lacking"]:
        detail += f"; lacks {', '.join(found['lacking'])}"
        return Finding(name, "warning", detail, "install a newer driver")
    if found["differs"]:
        detail += f"; differs from the reference: {found['differs'][0]}"
        fix = "none: the driver rounds edges differently; its counts are its own"
        return Finding(name, "warning", detail, fix)
    return Finding(name, "ok", f"{detail}; counts equal the reference's")


def _try_device(rasteriser: str, device: Device) -> dict[str, Any]:
    """Inside the worker: open, count something random, time something big."""
    opened = rasterisers.get(rasteriser)(device)
    frame, triangles = _scattered(128, 100, grid=SUBPIXEL // 2)
    expected = Reference().count(frame, triangles, Options())
    drawn = opened.count(frame, triangles, Options())
    if "hits" in drawn:
        drawn["fragments"] = drawn["hits"]
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.int32) * (TIMED_PX * SUBPIXEL)
    layer = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    timer = choose_timer(opened)
    step = timer.resolution_s
    if timer.timer == "gpu":
        with opened.prepare(bare_frame(TIMED_PX, square, 4), layer, Options()) as drawing:
            step = _step([drawing.sample(1).gpu or 0.0 for _ in range(8)])
    traps = _multisampling(opened, bare_frame(TIMED_PX, square, 4), layer)
    details = opened.device.details
    version, lacking = str(details["version"]), set()
    if isinstance(opened, GLRasteriser):
        version, lacking = f"OpenGL {version}", set(EXTENSIONS) - set(opened.ctx.extensions)
    return {
        "renderer": details["renderer"],
        "version": version,
        "lacking": sorted(lacking),
        "differs": disagreements(frame, drawn, expected),
        "timer": f"{timer.timer}, in steps of {step * 1e9:.3g} ns, as {timer.reason}",
        "traps": traps,
    }


def _step(seconds: Sequence[float]) -> float:
    """Return the step that all of a GPU's times are multiples of, in seconds; at least 1 ns."""
    return max(1, math.gcd(*(round(each * 1e9) for each in seconds))) * 1e-9


def _multisampling(opened: Rasteriser, frame: Frame, layer: NDArray[np.int32]) -> list[str]:
    """Say how often a pixel is shaded that has four samples, all covered."""
    many = Options(samples=4)
    if not opened.supports(many) or int(opened.device.details.get("max_samples", 1)) < 4:
        return []
    drawn = opened.count(frame, layer, many)
    often = float(np.sum(drawn.get("fragments", drawn.get("hits", 0)))) / frame.width**2
    return [f"with 4 samples it shades once a {'pixel' if often < 2 else 'sample'}"]


def _draw_roofs(device: Device) -> str:
    """Inside the worker: draw one square roof and return the renderer's name."""
    opened = rasterisers.get("pyrender")(device)
    square = np.array([[1, 1], [7, 1], [7, 7], [1, 7]], np.int32) * SUBPIXEL
    start = time.perf_counter()
    frame, rows = bare_frame(64, square, 4), np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    with opened.prepare(frame, rows, Options()) as drawing:
        drawing.sample(1)
    taken = time.perf_counter() - start
    opened.close()
    return f"{opened.device.details.get('renderer', device.name)}, first frame {taken:.2f} s"


def _scattered(size: int, number: int, grid: int = 1) -> tuple[Frame, np.ndarray]:
    """Random triangles with corners on multiples of grid/256 px, each a polygon of its own."""
    rng = np.random.default_rng(0)
    points = rng.integers(SUBPIXEL // grid, (size - 1) * SUBPIXEL // grid, (3 * number, 2)) * grid
    return bare_frame(size, points.astype(np.int32), 3), np.arange(
        3 * number, dtype=np.int32
    ).reshape(-1, 3)
