"""The command line: `python -m harness`. Commands live in `harness.commands`, one file each."""

from __future__ import annotations

import platform
import sys

import typer
from rich.console import Console

from harness import __version__
from harness.commands import (
    calibrate,
    catalogue,
    compare,
    doctor,
    enumeration,
    examples,
    export,
    gains,
    history,
    inspect,
    pareto,
    repeat,
    report,
    run,
    validate,
)
from harness.errors import BAD_INPUT, HarnessError
from scenes import SceneError

app = typer.Typer(
    name="harness",
    help="Measures what a polygon's triangulation costs to rasterise.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (
    run,
    validate,
    calibrate,
    compare,
    history,
    report,
    enumeration,
    inspect,
    export,
    gains,
    pareto,
    repeat,
    doctor,
    catalogue,
):
    command.add_to(app)
examples.add_to(app)


@app.callback(invoke_without_command=True)
def _options(
    version: bool = typer.Option(
        False, "--version", help="Show the version, and OpenGL's on each device, and exit."
    ),
) -> None:
    if version:
        typer.echo(_versions())
        raise typer.Exit


def _versions() -> str:
    from harness.rasterisers import egl

    lines = [f"raster-harness {__version__} on Python {platform.python_version()}"]
    devices, problems = egl.probe()
    for device in devices:
        driver = [str(device.details.get(name)) for name in ("renderer", "version")]
        lines.append(f"OpenGL on {device.name}: {', '.join(driver)}")
    if not devices:
        lines.append(f"no OpenGL here ({'; '.join(problems) or 'no device'}); see: harness doctor")
    return "\n".join(lines)


def main() -> None:
    """Run the command line; errors that a user can cause are one line and an exit code."""
    try:
        app()
    except (HarnessError, SceneError) as error:
        Console(stderr=True, highlight=False).print(
            f"error: {error}", style="red", markup=False, soft_wrap=True
        )
        sys.exit(error.exit_code if isinstance(error, HarnessError) else BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(130)
