"""`harness doctor`: check devices, drivers, extensions and timers."""

from rich.text import Text

from harness.errors import NoRasteriserError
from harness.progress import Screen

STATUS_COLOURS = {"ok": "green", "warning": "yellow", "missing": "red"}


def doctor() -> None:
    """Check devices, drivers, extensions and timers; print a remedy for each problem."""
    from harness import rasterisers
    from harness.doctor import examine_devices
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
