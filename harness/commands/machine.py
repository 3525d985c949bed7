"""`harness doctor` and `harness cache`: devices and cached triangulations of this machine."""

from typing import Annotated

import typer
from rich.text import Text

from harness.errors import NoRasteriserError, UsageError
from harness.progress import Reporter, Screen

STATUS_COLOURS = {"ok": "green", "warning": "yellow", "missing": "red"}


def doctor() -> None:
    """Check devices, drivers, extensions and timers; say how to repair what does not work."""
    from harness import rasterisers
    from harness.doctor import examine
    from harness.rasterisers import devices

    devices.clear_cache()
    console = Screen(highlight=False)
    findings = examine()
    width = max(len(finding.name) for finding in findings)
    for finding in findings:
        line = Text(f"{finding.status:<8}", style=STATUS_COLOURS[finding.status])
        line.append(f"{finding.name:<{width}}  {finding.detail}", style="default")
        console.print(line, soft_wrap=True)
        if finding.fix:
            console.print(f"{'':<8}{'':<{width}}  -> {finding.fix}", markup=False, soft_wrap=True)
    if not any(rasterisers.get(name).devices() for name in ("opengl", "webgpu")):
        raise NoRasteriserError("no OpenGL or WebGPU device works here; see what to install, above")


def cache(
    action: Annotated[
        str, typer.Argument(help="info: what the database holds; clear: empty it.")
    ] = "info",
) -> None:
    """Show or empty the model database of triangulations."""
    from harness.triangulating.database import ModelDatabase
    from triangulators.compute import compiled_files

    if action not in ("info", "clear"):
        raise UsageError(f"cache {action}: say info or clear")
    with ModelDatabase(say=Reporter().warn) as database:
        if action == "clear":
            count, old = database.clear(), compiled_files.remove_old()
            typer.echo(f"forgot {count:,} triangulations in {database.path}")
            typer.echo(f"removed compiled code of {old:,} old modules")
            return
        kinds = database.info()
    compiled = compiled_files.measure_cache()
    typer.echo(
        f"{compiled.folder}: compiled code, {compiled.file_bytes:,} bytes, "
        f"{len(compiled.old):,} old modules"
    )
    entries, file_bytes = sum(count for count, _ in kinds.values()), database.path.stat().st_size
    typer.echo(f"{database.path}: {entries:,} triangulations, {file_bytes:,} bytes")
    for name, (count, size) in kinds.items():
        typer.echo(f"  {name}: {count:,}, {size:,} bytes")
