"""The command line `raster-harness`; `harness.commands` has a file for each command."""

import contextlib
import io
import logging
import os
import platform
import sys
import traceback
from pathlib import Path
from typing import Annotated, Any

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
    UsageError,
    format_os_error,
    is_memory_error,
)
from harness.machine import system
from harness.machine.process import LOG_VARIABLE, start_log
from harness.progress import detach_terminal
from triangulators.errors import TriangulationError

ClickException: Any = next(  # typer bundles click, and does not export this class
    kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"
)

HELP = ("-h", "--help")
COMPLETION = {"--show-completion", "--install-completion"}
DEBUG_VARIABLE = "RASTER_HARNESS_DEBUG"  # print the traceback of errors, unless empty or 0
COMPLETION_VARIABLE = "_RASTER_HARNESS_COMPLETE"  # set by a shell that asks for completions

_LOG = logging.getLogger(__name__)

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
def _read_options(
    context: typer.Context,
    version: bool = typer.Option(
        False, "--version", help="Show the versions of this program and of OpenGL on each device."
    ),
    debug: Annotated[
        bool,
        typer.Option("--debug", help=f"Print the traceback of errors, as {DEBUG_VARIABLE}=1 does."),
    ] = False,
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Append events with time stamps to a file: workers, time limits, retries, cache "
            f"hits; as {LOG_VARIABLE}=FILE does.",
        ),
    ] = None,
) -> None:
    if version:
        typer.echo(_format_versions())
        raise typer.Exit
    if debug:
        os.environ[DEBUG_VARIABLE] = "1"
    if log is not None:
        os.environ[LOG_VARIABLE] = str(log.absolute())
    start_log()
    if context.invoked_subcommand is None:
        raise UsageError(f"no command given; see: {PROGRAM} --help")
    _LOG.info("%s %s: %s", PROGRAM, __version__, " ".join(sys.argv[1:]))


def _format_versions() -> str:
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
    """Run the command line; report errors in one line, never with exit code 1 (a regression)."""
    if sys.argv[1:2] == ["run"] and not set(HELP) & set(sys.argv):
        from harness import serving

        serving.start_server()  # imports packages while this process imports others
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # names of files may have any character
            with contextlib.suppress(OSError):
                stream.reconfigure(errors="backslashreplace")
    with system.handle_signals(_stop):
        try:
            _received.clear()
            code = app(standalone_mode=False, prog_name=PROGRAM)
            if code == REGRESSION and COMPLETION & {*sys.argv}:
                code = BAD_INPUT  # typer does not support this shell
            sys.stdout.flush()
            if _received:  # typer turns the exception into a silent exit
                raise KeyboardInterrupt
        except BaseException as error:
            _LOG.info("ended by %s", type(error).__name__, exc_info=error)
            if _is_debugging() and not isinstance(error, (SystemExit, BrokenPipeError)):
                _print_traceback(error)
            code = _report_error(error)
    _LOG.info("exit code %s", code or 0)
    sys.exit(code)


def _is_debugging() -> bool:
    """Return whether errors are printed with a traceback."""
    return os.environ.get(DEBUG_VARIABLE, "") not in ("", "0")


def _print_traceback(error: BaseException) -> None:
    """Print the traceback of an error and its causes, including causes in a worker process."""
    traceback.print_exception(error)
    cause: BaseException | None = error
    while cause is not None:
        if detail := getattr(cause, "detail", ""):
            print(f"In the worker process:\n{detail}", file=sys.stderr)
        cause = cause.__cause__ or cause.__context__


def _report_error(error: BaseException) -> int | str | None:
    if isinstance(error, typer.Abort) and error.__cause__ is not None:
        error = error.__cause__
    match error:
        case SystemExit() if COMPLETION & {*sys.argv} or COMPLETION_VARIABLE in os.environ:
            return error.code  # the regular end of a completion
        # Typer and Rich exit when standard output is closed.
        case BrokenPipeError() | SystemExit(__context__=BrokenPipeError()):
            # Discard the buffered output: at exit Python would fail to write it, and complain.
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            return BROKEN_PIPE
        case SystemExit():
            return _print_and_return(f"error: a plugin called sys.exit({error.code})", BAD_INPUT)
        case KeyboardInterrupt():
            return _print_and_return("stopped", INTERRUPTED)
        case HarnessError():
            return _print_and_return(f"error: {error}", error.exit_code)
        case ClickException():
            return _print_and_return(*_format_misuse(error))
        case OSError():
            return _print_and_return(f"error: {format_os_error(error)}", BAD_INPUT)
        case MemoryError() | ImportError() | RuntimeError() if is_memory_error(error):
            return _print_and_return(
                "error: out of memory; try a smaller scene, e.g. limit=1000", BAD_INPUT
            )
        case _ if _is_input_error(error):
            return _print_and_return(f"error: {error}", BAD_INPUT)
        case _:
            if not _is_debugging():
                _print_traceback(error)
            summary = f"{type(error).__name__}: {error}".splitlines()[0]
            return _print_and_return(f"error: internal error, please report: {summary}", DEFECT)


def _is_input_error(error: BaseException) -> bool:
    """Return whether the error is one by which scenes or triangulators refuse an input."""
    # `scenes.scene` is slow to import; if it is not imported, it has not raised the error.
    scenes = sys.modules.get("scenes.scene")
    refusals = (TriangulationError, *([scenes.SceneError] if scenes else []))
    return isinstance(error, refusals)


def _format_misuse(error: ClickException) -> tuple[str, int]:
    message = " ".join(error.format_message().split())
    context = getattr(error, "ctx", None)
    command = context.command_path if context else PROGRAM
    if not message or type(error).__name__ == "NoArgsIsHelpError":
        return context.get_help() if context else "", BAD_INPUT
    return f"error: {message.rstrip('.')}; see: {command} --help", BAD_INPUT


def _print_and_return(line: str, code: int) -> int:
    with contextlib.suppress(OSError, SystemExit):  # the terminal was closed
        Console(stderr=True, highlight=False, emoji=False).print(
            line, style="red" if line.startswith("error") else None, markup=False, soft_wrap=True
        )
    return code


_received: list[int] = []
"""Signals received so far. If `_stop` raises its exception in a destructor or a library's callback,
Python only prints it; this list still makes the program exit as interrupted."""


def _stop(number: int, _: object) -> None:
    _received.append(number)
    if number == system.HANGUP:
        detach_terminal()
    raise KeyboardInterrupt
