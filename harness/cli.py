"""The command line: `raster-harness`. Commands live in `harness.commands`, one file each."""

import contextlib
import os
import platform
import signal
import sys
import traceback
from typing import Any

import typer
from rich.console import Console

from harness import __version__
from harness.commands.index import PROGRAM, CommandGroup
from harness.errors import (
    BAD_INPUT,
    BROKEN_PIPE,
    DEFECT,
    INTERRUPTED,
    REGRESSION,
    HarnessError,
    of_system,
)
from harness.machine import system
from harness.progress import let_go_of_terminal

ClickException: Any = next(  # typer has its own copy of click, and names this part of it nowhere
    kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"
)

HELP = ("-h", "--help")
COMPLETION = {"--show-completion", "--install-completion"}
COMPLETES = "_RASTER_HARNESS_COMPLETE"
"""What a shell sets to be told how a word goes on."""

REFUSED = {"SceneError", "UnknownName", "TriangulationError"}
"""Errors of scenes and triangulators, which are loaded only where they are used, about input."""

app = typer.Typer(
    name=PROGRAM,
    cls=CommandGroup,
    help="Measures what a polygon's triangulation costs to rasterise.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": list(HELP)},
)


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
    from harness.rasterisers.devices import list_egl_devices

    lines = [f"raster-harness {__version__} on Python {platform.python_version()}"]
    devices, problems = list_egl_devices()
    for device in devices:
        driver = [str(device.details.get(name)) for name in ("renderer", "version")]
        lines.append(f"OpenGL on {device.name}: {', '.join(driver)}")
    if not devices:
        lines.append(
            f"no OpenGL here ({'; '.join(problems) or 'no device'}); see: raster-harness doctor"
        )
    return "\n".join(lines)


def main() -> None:
    """Run the command line; every error is one line and an exit code, which is never 1.

    1 means a regression, so nothing but `compare` may end with it, on purpose.
    """
    if sys.argv[1:2] == ["run"] and not set(HELP) & set(sys.argv):
        from harness.measuring import serving

        serving.start()  # it loads what takes long while this process does, too
    # Unless it was started to ignore a signal.
    with system.stopped_by(_stop, lambda before: before != signal.SIG_IGN):
        try:
            _asked.clear()
            code = app(standalone_mode=False, prog_name=PROGRAM)
            if code == REGRESSION and COMPLETION & {*sys.argv}:
                code = BAD_INPUT  # typer knows no completion for this shell
            sys.stdout.flush()
            if _asked and code != INTERRUPTED:
                raise KeyboardInterrupt
        except BaseException as error:
            code = _explain(error)
    sys.exit(code)


def _explain(error: BaseException) -> int | str | None:
    """Say in one line what went wrong; returns the exit code."""
    if isinstance(error, typer.Abort) and error.__cause__ is not None:
        error = error.__cause__
    match error:
        case SystemExit() if COMPLETION & {*sys.argv} or COMPLETES in os.environ:
            return error.code  # typer ends so when its work is done
        # Typer and Rich end the program where nobody reads what it writes.
        case BrokenPipeError() | SystemExit(__context__=BrokenPipeError()):
            # What is left to write goes nowhere, or Python would complain as it ends.
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            return BROKEN_PIPE
        case SystemExit():
            what = f"something that was called ended the program (exit code {error.code})"
            return _say(f"error: {what}", BAD_INPUT)
        case KeyboardInterrupt():
            return _say("stopped", INTERRUPTED)
        case HarnessError():
            return _say(f"error: {error}", error.exit_code)
        case ClickException():
            return _say(*_misused(error))
        case OSError():
            return _say(f"error: {of_system(error)}", BAD_INPUT)
        case MemoryError():
            return _say("error: out of memory; try a smaller scene, e.g. limit=1000", BAD_INPUT)
        case _ if REFUSED & {kind.__name__ for kind in type(error).__mro__}:
            return _say(f"error: {error}", BAD_INPUT)
        case _:
            traceback.print_exception(error)
            what = f"{type(error).__name__}: {error}".splitlines()[0]
            return _say(f"error: a defect of raster-harness, please report it: {what}", DEFECT)


def _misused(error: ClickException) -> tuple[str, int]:
    """Return what is wrong with a command's options, and the exit code."""
    message = " ".join(error.format_message().split())
    context = getattr(error, "ctx", None)
    where = context.command_path if context else PROGRAM
    if not message or type(error).__name__ == "NoArgsIsHelpError":
        return context.get_help() if context else "", BAD_INPUT
    return f"error: {message.rstrip('.')}; see: {where} --help", BAD_INPUT


def _say(line: str, code: int) -> int:
    with contextlib.suppress(OSError, SystemExit):  # a terminal that was closed reads nothing
        Console(stderr=True, highlight=False, emoji=False).print(
            line, style="red" if line.startswith("error") else None, markup=False, soft_wrap=True
        )
    return code


_asked: list[int] = []
"""Signals that asked to stop. Python only prints what is raised in a destructor or in a callback of
a library, so that a program that was stopped there would go on and end as if it were not."""


def _stop(number: int, _: object) -> None:
    """End the program as Ctrl-C does."""
    _asked.append(number)
    if number == system.HANGUP:
        let_go_of_terminal()
    raise KeyboardInterrupt
